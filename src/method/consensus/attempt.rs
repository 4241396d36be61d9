//! One way to see both clouds, and the poses that come of it.

use std::sync::Arc;

use super::evidence::Evidence;
use super::hypotheses::Matches;
use super::scan::{REACH, Scan, Surface, View, squared_distance};
use super::settle::settle;
use super::{Consensus, LOOK, SAME, apart, corners};
use crate::cloud::Transform;
use crate::error::Result;
use crate::method::registration::Timings;
use crate::moments::FullConnection;
use crate::par;

/// Most matches: their graph takes the square of them in bits.
const MATCHES: usize = 2500;
/// Mutual matches below which every point of the source is matched with its most alike.
const FEW: usize = 16;
/// Points by which hypotheses are judged at first.
const GLANCE: usize = 200;
/// Hypotheses that are settled.
const SETTLED: usize = 12;
/// Log odds from which on no other way to see the clouds is tried.
const SURE: f64 = 5.0;

/// A pose in local frames, with what speaks for it.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    pub(super) pose: Transform,
    pub(super) evidence: Evidence,
}

/// One way to see both clouds, and what came of it.
pub(super) struct Attempt {
    pub(super) surfaces: [Arc<Surface>; 2],
    pub(super) matches: Matches,
    /// Most probable first; may be empty.
    pub(super) candidates: Vec<Candidate>,
}

impl Attempt {
    pub(super) fn ends(&self) -> [&Surface; 2] {
        self.surfaces.each_ref().map(|surface| &**surface)
    }
}

impl Consensus {
    /// Tries the ways to see the clouds in turn, until one is sure.
    pub(super) fn attempts(
        &self,
        scans: &[Scan<'_>; 2],
        sensors: [Option<View>; 2],
        length: f64,
        times: &mut Timings,
    ) -> Result<Vec<Attempt>> {
        let mut attempts = Vec::new();
        let mut attempt = |views: [View; 2], times: &mut Timings| -> Result<bool> {
            let found = self.attempt(scans, views, length, times)?;
            let odds = found.candidates.first().map(|best| best.evidence.log_odds());
            attempts.push(found);
            Ok(odds.is_some_and(|odds| odds >= SURE))
        };
        if let [Some(source), Some(target)] = sensors
            && attempt([source, target], times)?
        {
            return Ok(attempts);
        }
        if attempt([View::Outward; 2], times)? {
            return Ok(attempts);
        }
        let [source, target] =
            times.time("viewpoints", || par::both(scans.each_ref(), |scan| scan.guesses()))?;
        for (source, target) in source.into_iter().zip(target) {
            if let (Some(source), Some(target)) = (source, target)
                && attempt([source, target], times)?
            {
                break;
            }
        }
        Ok(attempts)
    }

    fn attempt(
        &self,
        scans: &[Scan<'_>; 2],
        [from, onto]: [View; 2],
        length: f64,
        times: &mut Timings,
    ) -> Result<Attempt> {
        let mut surfaces = times.time("descriptors", || {
            let seen = [(&scans[0], from), (&scans[1], onto)];
            par::both(seen, |(scan, view)| scan.surface(view))
        })?;
        let find = |matches: &Matches| matches.hypotheses(self.seeds, &self.prior);
        // Channels tell the poses that shapes propose apart: they shall not hide one of them.
        let mut found = Vec::new();
        if !self.channels.is_empty() {
            let bare = times.time("matches", || matched(&surfaces, length))?;
            found = times.time("hypotheses", || find(&bare));
            times.time("descriptors", || Surface::compare(&mut surfaces, &self.channels))?;
        }
        let matches = times.time("matches", || matched(&surfaces, length))?;
        found.extend(times.time("hypotheses", || find(&matches)));
        let [source, target] = surfaces;
        let corners = corners(&source);
        let mut distinct: Vec<Transform> = Vec::new();
        for hypothesis in found {
            let new = |pose: &Transform| apart(pose, &hypothesis.pose, &corners) > SAME * length;
            if distinct.iter().all(new) {
                distinct.push(hypothesis.pose);
            }
        }
        let ends = [&*source, &*target];
        let judged = |pose: Transform, most| Candidate {
            pose,
            evidence: Evidence::of(ends, &matches, &pose, most),
        };
        let sorted = |mut all: Vec<Candidate>| {
            all.sort_by(|a, b| b.evidence.log_odds().total_cmp(&a.evidence.log_odds()));
            all
        };
        let candidates = times.time("judge", || {
            let glance = par::map(distinct.len(), || (), |_, i| judged(distinct[i], GLANCE));
            let mut best = sorted(glance);
            best.truncate(SETTLED);
            sorted(par::map(
                best.len(),
                || (),
                |_, i| {
                    judged(
                        settle(ends, &best[i].pose, REACH * length, LOOK, &self.prior).pose,
                        LOOK.most,
                    )
                },
            ))
        });
        Ok(Attempt { surfaces: [source, target], matches, candidates })
    }
}

/// Pairs of points that are each other's most alike, the most alike first where there are many.
fn matched([source, target]: &[Arc<Surface>; 2], length: f64) -> Result<Matches> {
    let connection = FullConnection::new(source.described(), target.described())?;
    let mut pairs = connection.mutual();
    if pairs.len() < FEW {
        pairs = connection.nearest_targets().into_iter().zip(0..).map(|(j, i)| (i, j)).collect();
    }
    if pairs.len() > MATCHES {
        let distance = |&(i, j): &(u32, u32)| {
            let rows = (source.descriptors.row(i as usize), target.descriptors.row(j as usize));
            squared_distance(rows.0, rows.1)
        };
        pairs.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        pairs.truncate(MATCHES);
    }
    let weight = |&(i, j): &(u32, u32)| source.weight(i as usize) * target.weight(j as usize);
    pairs.retain(|pair| weight(pair) > 0.0);
    Ok(Matches {
        weights: pairs.iter().map(weight).collect(),
        source: pairs.iter().map(|&(i, _)| source.points[i as usize]).collect(),
        target: pairs.iter().map(|&(_, j)| target.points[j as usize]).collect(),
        pairs,
        length,
    })
}
