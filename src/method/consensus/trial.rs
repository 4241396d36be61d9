//! One pair of viewpoint hypotheses, and the poses found with it.

use std::sync::Arc;

use super::hypotheses::MAX_CORRESPONDENCES;
use super::hypotheses::{Correspondences, PointPair};
use super::scan::{Scan, ViewpointHypothesis, append_channels};
use super::{COARSE_REFINEMENT, Consensus, DUPLICATE_POSE, mean_displacement, probe_points};
use crate::cloud::{Descriptors, Transform};
use crate::error::Result;
use crate::method::given_descriptors::DescriptorRole;
use crate::method::registration::Timings;
use crate::moments::FullConnection;
use crate::par;
use crate::surface::{INLIER_DISTANCE, Surface, refine};
use crate::verify::{PoseEvidence, VerdictModel, squared_descriptor_distance};

/// Mutual matches below which every point of the source is matched with its most alike.
const MIN_MUTUAL: usize = 16;
/// Number of points in the first scoring of hypotheses. Chosen by hand.
const COARSE_POINTS: usize = 200;
/// Number of hypotheses that are refined. Chosen by hand.
const REFINED_HYPOTHESES: usize = 12;
/// Log odds from which on no other viewpoints are tried. Chosen by hand.
const EARLY_EXIT_LOG_ODDS: f64 = 5.0;

/// A pose in local frames, with its evidence.
#[derive(Clone, Copy)]
pub(super) struct LocalScoredPose {
    pub(super) pose: Transform,
    pub(super) evidence: PoseEvidence,
    /// Log odds of the pose by the evidence alone.
    pub(super) log_odds: f64,
}

impl LocalScoredPose {
    pub(super) fn new(pose: Transform, evidence: PoseEvidence, model: &VerdictModel) -> Self {
        LocalScoredPose { pose, evidence, log_odds: model.pose_log_odds(&evidence) }
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

    /// Measures the evidence for `pose` on at most `max_points` of each surface.
    pub(super) fn evidence(&self, pose: &Transform, max_points: usize) -> PoseEvidence {
        score_pose(self.surface_refs(), &self.correspondences, pose, max_points)
    }
}

impl Consensus {
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
            let odds = found.candidates.first().map(|best| best.log_odds);
            attempts.push(found);
            Ok(odds.is_some_and(|odds| odds >= EARLY_EXIT_LOG_ODDS))
        };
        if let [Some(source), Some(target)] = sensors
            && attempt([source, target], times)?
        {
            return Ok(attempts);
        }
        if attempt([ViewpointHypothesis::Outward; 2], times)? {
            return Ok(attempts);
        }
        let [source, target] = times.time("viewpoints", || {
            par::join_pair(scans.each_ref(), |scan| scan.estimate_viewpoints())
        })?;
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
        let beside =
            self.given_descriptors.is_some_and(|given| given.role == DescriptorRole::Beside);
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
        let [source, target] = surfaces;
        let corners = probe_points(&source);
        let mut distinct: Vec<Transform> = Vec::new();
        for hypothesis in found {
            let new = |pose: &Transform| {
                mean_displacement(pose, &hypothesis.pose, &corners) > DUPLICATE_POSE * length
            };
            if distinct.iter().all(new) {
                distinct.push(hypothesis.pose);
            }
        }
        let ends = [&*source, &*target];
        let model = self.verdict_model();
        let judged = |pose: Transform, most| {
            LocalScoredPose::new(pose, score_pose(ends, &matches, &pose, most), model)
        };
        let sorted = |mut all: Vec<LocalScoredPose>| {
            all.sort_by(|a, b| b.log_odds.total_cmp(&a.log_odds));
            all
        };
        let candidates = times.time("judge", || {
            let glance = par::map(distinct.len(), || (), |_, i| judged(distinct[i], COARSE_POINTS));
            let mut best = sorted(glance);
            best.truncate(REFINED_HYPOTHESES);
            sorted(par::map(
                best.len(),
                || (),
                |_, i| {
                    judged(
                        refine(
                            ends,
                            &best[i].pose,
                            INLIER_DISTANCE * length,
                            COARSE_REFINEMENT,
                            &self.prior,
                        )
                        .pose,
                        COARSE_REFINEMENT.max_points,
                    )
                },
            ))
        });
        Ok(ViewpointTrial { surfaces: [source, target], correspondences: matches, candidates })
    }
}

/// Measures the evidence for `pose` on at most `max_points` of each surface.
fn score_pose(
    surfaces: [&Surface; 2],
    correspondences: &Correspondences,
    pose: &Transform,
    max_points: usize,
) -> PoseEvidence {
    let inlier_score = correspondences.inlier_score(pose);
    PoseEvidence::compute(surfaces, pose, inlier_score, correspondences.voxel_size, max_points)
}

/// Returns mutual nearest neighbours by the descriptors of a `table`; if there are too many, the most similar ones.
fn match_features(
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
