//! Check that two surfaces have one scale: a rigid pose of clouds in two units is wrong.

use super::ConsensusSearch;
use crate::cloud::Transform;
use crate::surface::{INLIER_DISTANCE, refine_with_scale};
use crate::verify::Evidence;

/// Smallest deviation of a scale from 1 that is reported: smaller ones are errors of a sensor, not
/// of a unit. Chosen by hand.
const MIN_SCALE_CHANGE: f64 = 0.02;
/// Smallest gain of the log odds at another scale that is reported. Poses of 72 real pairs gain at most
/// 0.87 (every ninth of `pairs.csv` and `pairs_more.csv`); those of clouds whose scale is off by 5 to 12
/// %, 24 made pairs of `python -m verdict.made_pairs`, gain 1.75 to 15, but for one with 0.8.
const MIN_LOG_ODDS_GAIN: f64 = 1.5;

/// A scale at which the surfaces fit better than unscaled.
pub(super) struct ScaleMismatch {
    /// Scale of the source.
    pub(super) scale: f64,
    pub(super) overlap: f64,
}

impl ConsensusSearch<'_> {
    /// Refines `pose` with a free scale; returns the scale if it differs and the pose is more probable
    /// by its evidence.
    pub(super) fn find_scale_mismatch(
        &self,
        pose: &Transform,
        evidence: &Evidence,
    ) -> Option<ScaleMismatch> {
        let best = &self.trials[self.best_trial];
        let ends = best.surface_refs();
        let scaled = refine_with_scale(ends, pose, INLIER_DISTANCE * self.voxel_size)?;
        let scored = best.score(&scaled, &self.config);
        let gain = scored.log_odds - self.config.pose_log_odds(evidence);
        let fits_better = (scaled.scale - 1.0).abs() > MIN_SCALE_CHANGE && gain > MIN_LOG_ODDS_GAIN;
        let overlap = scored.evidence.overlap;
        fits_better.then_some(ScaleMismatch { scale: scaled.scale, overlap })
    }
}
