//! Consensus: matches of the full connection that agree with each other, judged on the surfaces.

mod answer;
mod candidates;
mod evidence;
mod hypotheses;
mod judge;
mod scan;
mod settle;
mod standing;
mod whole;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use self::candidates::Judged;
use self::evidence::Evidence;
use self::hypotheses::Matches;
use self::scan::{REACH, Scan, Surface, View, squared_distance};
use self::settle::{Effort, Settled, settle};
use self::whole::Whole;
use super::registration::Timings;
use super::{Cached, Channel, Register, Registration};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::moments::FullConnection;
use crate::par;
use crate::pose::{Prior, ScaleEstimate};

/// Global registration of scans that overlap in part: the method for clouds of which nothing is
/// known.
///
/// The full connection of both clouds is made sparse (pairs that are each other's most alike by
/// FPFH); each match weighs the others by how many matches both are compatible with, and is
/// solved in closed form ([SC²-PCR], Chen et al., CVPR 2022); the poses are judged on the
/// surfaces themselves: how much of them lies on each other, how alike it looks there, what
/// stands where a sensor looked through. The best are settled point to plane and judged again.
/// The [`Verdict`](crate::quality::Verdict) tells how probable the answer is and what else it
/// might be.
///
/// All lengths follow from one, [`voxel`](Self::voxel), and that from the clouds: the unit does
/// not matter, nor where the clouds stand. Where the place of a sensor is known
/// ([`PointCloud::viewpoint`]) it serves twice, to orient normals and to tell what was empty;
/// where it is not, it is guessed. Returns at the limit of a sensor's range are no surface and
/// left out ([`RangeLimit`](crate::visibility::RangeLimit)).
///
/// Weights of points ([`PointCloud::with_weights`]) count where poses are solved: a match, and a
/// pair of surface points, is multiplied by those of its two points, each the mean of its cube.
/// Surfaces, and the verdict, are those of all points.
///
/// ```
/// use cfreg::method::{Consensus, Register};
/// # use cfreg::experiment::shape::boulder;
/// # let (source, target) = (boulder().sample(2000, 1)?, boulder().sample(2000, 2)?);
/// let registration = Consensus::default().register(&source, &target)?;
/// let verdict = registration.verdict.unwrap();
/// println!("{} {:.3}", verdict.decision, verdict.probability);
/// assert!(registration.transform.angle().to_degrees() < 2.0);
/// # Ok::<(), cfreg::Error>(())
/// ```
///
/// [SC²-PCR]: https://arxiv.org/abs/2203.14453
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Consensus {
    /// The length that all others follow from, in the unit of the coordinates, above 0: clouds
    /// are thinned to one point per cube of this side. Default [`filter::voxel_side`] of 5000
    /// points, of the cloud where it is longer.
    pub voxel: Option<f64>,
    /// Matches from which a pose is sought, at least 1; default 200. More find smaller
    /// overlaps, at a cost that grows with them.
    pub seeds: usize,
    /// What is known of the pose beforehand ([`Prior`]), its scale left out; default nothing.
    /// Poses of matches are exactly the best allowed; on the surfaces the nearest allowed pose
    /// is taken after each step.
    pub prior: Prior,
    /// Channels of the clouds ([`PointCloud::channels`]) by which points are compared too, as
    /// [`Describe::joined`](super::Describe::joined) says; default none. They find matches and
    /// count where surfaces look alike; the pose is settled on the shape alone.
    pub channels: Vec<Channel>,
    /// Threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for Consensus {
    fn default() -> Self {
        Consensus {
            voxel: None,
            seeds: 200,
            prior: Prior::default(),
            channels: Vec::new(),
            threads: 0,
        }
    }
}

/// Points that a cloud is thinned to.
const POINTS: usize = 5000;
/// Most matches: their graph takes the square of them in bits.
const MATCHES: usize = 2500;
/// Mutual matches below which every point of the source is matched with its most alike.
const FEW: usize = 16;
/// Points by which hypotheses are judged at first.
const GLANCE: usize = 200;
/// Hypotheses that are settled.
const SETTLED: usize = 12;
/// How they are settled, and by as many points they are judged then.
const LOOK: Effort = Effort { most: 1000, steps: 12, rest: 0.01 };
/// How the answer is settled: to where its own errors are larger than those of the last step.
const ANSWER: Effort = Effort { most: usize::MAX, steps: 100, rest: 1e-4 };
/// Log odds from which on no other way to see the clouds is tried.
const SURE: f64 = 5.0;
/// Poses that move points apart by less than this, in lengths, are one.
const SAME: f64 = 3.0;
/// And from this on a runner-up is another answer.
const OTHER: f64 = 8.0;
/// A pose that is judged is as good as the one that it settles on, if that is nearer than this.
const NEAR: f64 = 1.0;
/// Times as far from the middle as half the points are, from which on a point is a stray.
const STRAY: f64 = 30.0;

/// A pose in local frames, with what speaks for it.
#[derive(Clone, Copy)]
struct Candidate {
    pose: Transform,
    evidence: Evidence,
}

/// One way to see both clouds, and what came of it.
struct Attempt {
    surfaces: [Arc<Surface>; 2],
    matches: Matches,
    /// Most probable first; may be empty.
    candidates: Vec<Candidate>,
}

impl Attempt {
    fn ends(&self) -> [&Surface; 2] {
        self.surfaces.each_ref().map(|surface| &**surface)
    }
}

/// All that was tried on two clouds, and what came out best.
struct Search<'a> {
    /// With its length in force.
    config: Consensus,
    length: f64,
    scans: [Scan<'a>; 2],
    attempts: Vec<Attempt>,
    /// Which of them has the answer.
    best: usize,
    settled: Settled,
    evidence: Evidence,
}

impl Consensus {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] with the name of the first setting that is out of its range.
    pub fn validate(&self) -> Result<()> {
        if let Some(voxel) = self.voxel.filter(|&voxel| !(voxel > 0.0 && voxel <= 1e15)) {
            return Err(Error::config("voxel", voxel, "must be above 0 and at most 1e15"));
        }
        if self.seeds == 0 {
            return Err(Error::config("seeds", 0, "must be at least 1"));
        }
        self.channels.iter().try_for_each(Channel::validate)?;
        self.prior.validate_for(ScaleEstimate::Fixed)
    }

    /// The length that all others follow from.
    fn length(&self, ends: [&Whole<'_>; 2]) -> Result<f64> {
        if let Some(voxel) = self.voxel {
            return Ok(voxel);
        }
        let [source, target] = par::both(ends, |whole| whole.voxel_side(POINTS))?;
        let side = source.max(target);
        if side <= 0.0 {
            // All points in one place.
            return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
        }
        Ok(side)
    }

    fn run(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        let mut times = Timings::default();
        self.search(source, target, &mut times)?.answer(times)
    }

    fn search<'a>(
        &self,
        source: Cached<'a>,
        target: Cached<'a>,
        times: &mut Timings,
    ) -> Result<Search<'a>> {
        self.validate()?;
        for (end, what) in [(source, "the source"), (target, "the target")] {
            if end.cloud.len() < 3 {
                let found = end.cloud.len();
                return Err(Error::TooFewPoints { what: what.into(), found, needed: 3 });
            }
        }
        let [source, target] =
            times.time("range limit", || par::both([source, target], Whole::of))?;
        let length = times.time("thin", || self.length([&source, &target]))?;
        let config = Consensus { voxel: Some(length), ..self.clone() };
        let scans = times.time("thin", || {
            let named = [(source, "the source"), (target, "the target")];
            par::both(named, |(cloud, name)| Scan::new(cloud, length, &self.channels, name))
        })?;
        let attempts = config.attempts(&scans, length, times)?;
        let odds = |attempt: &Attempt| {
            attempt.candidates.first().map_or(f64::NEG_INFINITY, |best| best.evidence.log_odds())
        };
        // The first of those that are equally good.
        let ranked = attempts.iter().enumerate().rev();
        let best = ranked.max_by(|(_, a), (_, b)| odds(a).total_cmp(&odds(b)));
        let Some((best, at, first)) =
            best.and_then(|(best, at)| Some((best, at, at.candidates.first()?)))
        else {
            return Err(Error::NO_WEIGHT);
        };
        let ends = at.ends();
        let settled =
            times.time("refine", || settle(ends, &first.pose, REACH * length, ANSWER, &self.prior));
        let evidence = Evidence::of(ends, &at.matches, &settled.pose, LOOK.most);
        Ok(Search { config, length, scans, attempts, best, settled, evidence })
    }

    /// Tries the ways to see the clouds in turn, until one is sure.
    fn attempts(
        &self,
        scans: &[Scan<'_>; 2],
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
        let ends = || scans.each_ref();
        let sensors = times.time("viewpoints", || par::both(ends(), |scan| scan.sensor()))?;
        if let [Some(source), Some(target)] = sensors
            && attempt([source, target], times)?
        {
            return Ok(attempts);
        }
        if attempt([View::Outward; 2], times)? {
            return Ok(attempts);
        }
        let [source, target] =
            times.time("viewpoints", || par::both(ends(), |scan| scan.guesses()))?;
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
        let [source, target] = times.time("descriptors", || {
            let seen = [(&scans[0], from), (&scans[1], onto)];
            let mut surfaces = par::both(seen, |(scan, view)| scan.surface(view))?;
            Surface::compare(&mut surfaces, &self.channels)?;
            Ok::<_, Error>(surfaces)
        })?;
        let matches = times.time("matches", || matched(&source, &target, length))?;
        let found = times.time("hypotheses", || matches.hypotheses(self.seeds, &self.prior));
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
fn matched(source: &Surface, target: &Surface, length: f64) -> Result<Matches> {
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
        length,
    })
}

/// Eight points spread over the surface, in the order of its points; less those that are as far
/// away from the others as a stray return, which would tell poses apart by itself.
fn corners(surface: &Surface) -> Vec<Vec3> {
    let all: Vec<Vec3> = (0..8).map(|k| surface.place(k * (surface.len() - 1) / 7)).collect();
    let middle = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let center = [0, 1, 2].map(|axis| middle(all.iter().map(|place| place[axis]).collect()));
    let off = |place: &Vec3| math::norm(math::sub(*place, center));
    let most = STRAY * middle(all.iter().map(off).collect());
    all.into_iter().filter(|place| off(place) <= most).collect()
}

/// Mean distance between where two poses put `places`.
fn apart(a: &Transform, b: &Transform, places: &[Vec3]) -> f64 {
    let off = |&place: &Vec3| math::norm(math::sub(a.apply(place), b.apply(place)));
    places.iter().map(off).sum::<f64>() / places.len() as f64
}

/// A pose between local frames as one between the clouds' own.
fn global(pose: &Transform, from: &Surface, onto: &Surface) -> Transform {
    let there = math::add(pose.translation, onto.origin);
    Transform { translation: math::sub(there, pose.rotate(from.origin)), ..*pose }
}

/// A pose between the clouds' own frames as one between local ones.
fn local(pose: &Transform, from: &Surface, onto: &Surface) -> Transform {
    Transform { translation: math::sub(pose.apply(from.origin), onto.origin), ..*pose }
}

impl Register for Consensus {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        par::with_threads(self.threads, || self.run(source, target))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_name_the_field() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let found = Consensus { voxel: Some(bad), ..Consensus::default() }.validate();
            assert!(matches!(found, Err(Error::Config { field: "voxel", .. })), "{bad}");
        }
        let found = Consensus { seeds: 0, ..Consensus::default() }.validate();
        assert!(matches!(found, Err(Error::Config { field: "seeds", .. })));
    }
}
