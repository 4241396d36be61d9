//! One pair of viewpoint hypotheses, and the poses found with it.

use std::sync::Arc;

use super::hypotheses::MAX_CORRESPONDENCES;
use super::hypotheses::{Correspondences, Hypothesis, PointPair};
use super::scan::{Scan, ViewpointHypothesis, append_channels};
use super::{COARSE_REFINEMENT, Consensus, DUPLICATE_POSE, mean_displacement, probe_points};
use crate::cloud::{Descriptors, Transform};
use crate::error::Result;
use crate::math::Vec3;
use crate::method::GivenDescriptors;
use crate::method::registration::Timings;
use crate::moments::FullConnection;
use crate::par;
use crate::surface::{INLIER_DISTANCE, Surface, refine};
use crate::verify::{Confidence, Evidence, Measurement, squared_descriptor_distance};

/// Mutual matches below which every point of the source is matched with its most alike.
const MIN_MUTUAL: usize = 16;
/// Number of points in the first scoring of hypotheses. Chosen by hand.
const COARSE_POINTS: usize = 200;
/// Number of hypotheses that are refined. Chosen by hand.
const REFINED_HYPOTHESES: usize = 12;
/// Scoring of hypotheses: their poses are off by some voxels. Chosen by hand.
const GLANCE: Measurement = Measurement { max_points: COARSE_POINTS, pose_error: 2.0 };
/// Scoring of refined poses. Chosen by hand.
const REFINED: Measurement =
    Measurement { max_points: COARSE_REFINEMENT.max_points, pose_error: 0.0 };
/// Probability of a pose from which on no other viewpoints are tried. Chosen by hand.
const EARLY_EXIT_PROBABILITY: f64 = 0.98;
/// Factor by which descriptors count more where channels are compared with them: who names channels
/// says that they tell poses apart. Chosen by hand.
const CHANNEL_WEIGHT: f64 = 5.0;
/// Supporting hypotheses of most correct answers of real pairs (`cfreg benchmark --candidates`).
const USUAL_HYPOTHESES: usize = 5;
/// Standard deviation of the translation of most correct answers of the same pairs, in voxels.
const USUAL_TRANSLATION_STD: f64 = 0.1;
/// Margin of most correct answers of the same pairs.
const USUAL_MARGIN: f64 = 4.0;

/// A pose in local frames, with its evidence.
#[derive(Clone, Copy)]
pub(super) struct LocalScoredPose {
    pub(super) pose: Transform,
    pub(super) evidence: Evidence,
    /// Log odds of the pose by the evidence alone.
    pub(super) log_odds: f64,
}

impl LocalScoredPose {
    fn new(pose: Transform, evidence: Evidence, config: &Consensus) -> Self {
        LocalScoredPose { pose, evidence, log_odds: config.pose_log_odds(&evidence) }
    }
}

/// One pair of viewpoint hypotheses, and its results.
pub(super) struct ViewpointTrial {
    pub(super) surfaces: [Arc<Surface>; 2],
    pub(super) correspondences: Correspondences,
    /// Most probable first; may be empty.
    pub(super) candidates: Vec<LocalScoredPose>,
}

impl ViewpointTrial {
    pub(super) fn surface_refs(&self) -> [&Surface; 2] {
        self.surfaces.each_ref().map(|surface| &**surface)
    }

    /// Scores a refined `pose`.
    pub(super) fn score(&self, pose: &Transform, config: &Consensus) -> LocalScoredPose {
        let surfaces = self.surface_refs();
        score_pose(surfaces, &self.correspondences, pose, REFINED, config)
    }
}

impl Consensus {
    /// Ranks the poses of a pair by their evidence: returns the log odds of a pose beside others.
    pub(super) fn pose_log_odds(&self, evidence: &Evidence) -> f64 {
        let model = self.verdict_model();
        match self.channels[..] {
            [] => model.pose_log_odds(evidence),
            _ => model.pose_log_odds_by_channels(evidence, CHANNEL_WEIGHT),
        }
    }

    /// Returns the probability of a pose with this evidence, if it is as well constrained as usual, as
    /// many hypotheses support it, and it ranks as far before others.
    pub(super) fn usual_probability(&self, evidence: Evidence) -> f64 {
        let confidence = Confidence {
            evidence,
            supporting_hypotheses: USUAL_HYPOTHESES,
            translation_std: Some(USUAL_TRANSLATION_STD),
            margin: Some(USUAL_MARGIN),
        };
        self.verdict_model().probability(&confidence)
    }

    /// Tries the viewpoint hypotheses in turn, until a pose is certain enough.
    pub(super) fn run_trials(
        &self,
        scans: &[Scan<'_>; 2],
        sensors: [Option<ViewpointHypothesis>; 2],
        given: Option<&[PointPair]>,
        length: f64,
        times: &mut Timings,
    ) -> Result<Vec<ViewpointTrial>> {
        let mut attempts = Vec::new();
        let mut attempt = |views: [ViewpointHypothesis; 2], times: &mut Timings| -> Result<bool> {
            let found = self.run_trial(scans, views, given, length, times)?;
            let best = found.candidates.first().map(|best| best.evidence);
            attempts.push(found);
            Ok(best.is_some_and(|best| self.usual_probability(best) >= EARLY_EXIT_PROBABILITY))
        };
        if let [Some(source), Some(target)] = sensors
            && attempt([source, target], times)?
        {
            return Ok(attempts);
        }
        let mut estimates = None;
        let stored = scans.each_ref().map(Scan::has_stored_normals);
        if stored != [false; 2] {
            // The side of the other cloud, if it has no normals: that of its sensor, known or not.
            let mut side = |k: usize| -> Result<ViewpointHypothesis> {
                if stored[k] {
                    return Ok(ViewpointHypothesis::Stored);
                }
                let estimate = match sensors[k] {
                    Some(known) => Some(known),
                    None => estimate_viewpoints(scans, &mut estimates, times)?[k][0],
                };
                Ok(estimate.unwrap_or(ViewpointHypothesis::Outward))
            };
            if attempt([side(0)?, side(1)?], times)? {
                return Ok(attempts);
            }
        }
        if attempt([ViewpointHypothesis::Outward; 2], times)? {
            return Ok(attempts);
        }
        let [source, target] = estimate_viewpoints(scans, &mut estimates, times)?;
        for (source, target) in source.into_iter().zip(target) {
            if let (Some(source), Some(target)) = (source, target)
                && attempt([source, target], times)?
            {
                break;
            }
        }
        Ok(attempts)
    }

    fn run_trial(
        &self,
        scans: &[Scan<'_>; 2],
        [from, onto]: [ViewpointHypothesis; 2],
        given: Option<&[PointPair]>,
        length: f64,
        times: &mut Timings,
    ) -> Result<ViewpointTrial> {
        let mut surfaces = times.time("descriptors", || {
            let seen = [(&scans[0], from), (&scans[1], onto)];
            par::join_pair(seen, |(scan, view)| scan.surface(view))
        })?;
        let find = |matches: &Correspondences| matches.generate_hypotheses(self.seeds, &self.prior);
        // Tables rank the poses that each alone proposes; they must not hide one of them.
        let mut found = Vec::new();
        let beside = self.given_descriptors.is_some_and(GivenDescriptors::is_beside);
        if given.is_none() && (!self.channels.is_empty() || beside) {
            let mut tables: Vec<fn(&Surface) -> &Descriptors> = vec![Surface::matching_descriptors];
            if beside {
                tables.push(|side| &side.descriptors);
            }
            for table in tables {
                let bare = times.time("matches", || match_features(&surfaces, table, length))?;
                found.extend(times.time("hypotheses", || find(&bare)));
            }
            times.time("descriptors", || append_channels(&mut surfaces, self))?;
        }
        let matches = times.time("matches", || match given {
            Some(pairs) => Ok(Correspondences::from_pairs(&surfaces, pairs, length)),
            None => match_features(&surfaces, Surface::matching_descriptors, length),
        })?;
        found.extend(times.time("hypotheses", || find(&matches)));
        let ends = surfaces.each_ref().map(|surface| &**surface);
        let candidates = times
            .time("verify", || self.score_hypotheses(ends, &matches, found, REFINED_HYPOTHESES));
        Ok(ViewpointTrial { surfaces, correspondences: matches, candidates })
    }

    /// Scores distinct hypotheses, refines the best `most` of them, and scores them again: most
    /// probable first.
    pub(super) fn score_hypotheses(
        &self,
        ends: [&Surface; 2],
        matches: &Correspondences,
        hypotheses: Vec<Hypothesis>,
        most: usize,
    ) -> Vec<LocalScoredPose> {
        let length = matches.voxel_size;
        let probes = probe_points(ends[0]);
        let poses = hypotheses.iter().map(|hypothesis| hypothesis.pose);
        let distinct = distinct_poses(poses, &probes, usize::MAX, length);
        let glance = |pose: &Transform| score_pose(ends, matches, pose, GLANCE, self);
        let refined = |pose: &Transform| {
            let max_distance = INLIER_DISTANCE * length;
            let refined = refine(ends, pose, max_distance, COARSE_REFINEMENT, &self.prior);
            score_pose(ends, matches, &refined.pose, REFINED, self)
        };
        let mut best = par::map(distinct.len(), || (), |_, i| glance(&distinct[i]));
        sort_by_odds(&mut best);
        best.truncate(most);
        let mut best = par::map(best.len(), || (), |_, i| refined(&best[i].pose));
        sort_by_odds(&mut best);
        best
    }
}

/// The viewpoints of each scan, from outside and from inside.
type Estimates = [[Option<ViewpointHypothesis>; 2]; 2];

/// Estimates the viewpoints of both scans, unless they were.
fn estimate_viewpoints(
    scans: &[Scan<'_>; 2],
    known: &mut Option<Estimates>,
    times: &mut Timings,
) -> Result<Estimates> {
    if let Some(known) = known {
        return Ok(*known);
    }
    let found = times.time("viewpoints", || {
        par::join_pair(scans.each_ref(), |scan| scan.estimate_viewpoints())
    })?;
    Ok(*known.insert(found))
}

/// Returns the first `most` poses that are no duplicates of each other.
pub(super) fn distinct_poses(
    poses: impl Iterator<Item = Transform>,
    probes: &[Vec3],
    most: usize,
    voxel_size: f64,
) -> Vec<Transform> {
    let mut distinct: Vec<Transform> = Vec::new();
    for pose in poses {
        let is_new = |other: &Transform| {
            mean_displacement(other, &pose, probes) > DUPLICATE_POSE * voxel_size
        };
        if distinct.iter().all(is_new) {
            distinct.push(pose);
            if distinct.len() == most {
                break;
            }
        }
    }
    distinct
}

/// Sorts the most probable first.
pub(super) fn sort_by_odds(all: &mut [LocalScoredPose]) {
    all.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
}

/// Scores `pose`, local frame to local frame.
fn score_pose(
    surfaces: [&Surface; 2],
    correspondences: &Correspondences,
    pose: &Transform,
    measurement: Measurement,
    config: &Consensus,
) -> LocalScoredPose {
    let inlier_score = correspondences.inlier_score(pose);
    let voxel_size = correspondences.voxel_size;
    let evidence = Evidence::compute(surfaces, pose, inlier_score, voxel_size, measurement);
    LocalScoredPose::new(*pose, evidence, config)
}

/// Returns mutual nearest neighbours by the descriptors of a `table`; if there are too many, the most
/// similar ones.
pub(super) fn match_features(
    [source, target]: &[Arc<Surface>; 2],
    table: impl Fn(&Surface) -> &Descriptors,
    length: f64,
) -> Result<Correspondences> {
    let (from, onto) = (table(source), table(target));
    let connection = FullConnection::new(source.feature_view(from), target.feature_view(onto))?;
    let mut pairs = connection.mutual_nearest();
    if pairs.len() < MIN_MUTUAL {
        pairs = connection.nearest_targets().into_iter().zip(0..).map(|(j, i)| (i, j)).collect();
    }
    if pairs.len() > MAX_CORRESPONDENCES {
        let distance = |&(i, j): &(u32, u32)| {
            squared_descriptor_distance(from.row(i as usize), onto.row(j as usize))
        };
        pairs.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        pairs.truncate(MAX_CORRESPONDENCES);
    }
    let weight = |&(i, j): &(u32, u32)| source.weight(i as usize) * target.weight(j as usize);
    pairs.retain(|pair| weight(pair) > 0.0);
    Ok(Correspondences {
        weights: pairs.iter().map(weight).collect(),
        source: pairs.iter().map(|&(i, _)| source.points[i as usize]).collect(),
        target: pairs.iter().map(|&(_, j)| target.points[j as usize]).collect(),
        pairs,
        voxel_size: length,
    })
}
