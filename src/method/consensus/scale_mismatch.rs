//! Whether two surfaces have one scale: a rigid pose of clouds in two units is no answer.

use super::{COARSE_REFINEMENT, ConsensusSearch};
use crate::cloud::Transform;
use crate::surface::{INLIER_DISTANCE, refine_with_scale};
use crate::verify::PoseEvidence;

/// A scale that is nearer to 1 is a sensor's, not a unit's.
const MIN_SCALE_CHANGE: f64 = 0.02;
/// How much more of the surfaces lies on each other at another scale, from which on it is told.
/// Of 135 right poses of real pairs 14 settle on a scale farther than [`MIN_SCALE_CHANGE`], and gain 0.04 at
/// most; where the scale is off by 5 % it is 0.07 to 0.24.
const MIN_OVERLAP_GAIN: f64 = 0.05;

/// A scale at which more of the surfaces lies on each other than as they are.
pub(super) struct ScaleMismatch {
    /// Of the source.
    pub(super) scale: f64,
    pub(super) overlap: f64,
}

impl ConsensusSearch<'_> {
    /// The scale that the surfaces settle on from `pose` if they may, where that is another.
    pub(super) fn find_scale_mismatch(
        &self,
        pose: &Transform,
        evidence: &PoseEvidence,
    ) -> Option<ScaleMismatch> {
        let best = &self.trials[self.best_trial];
        let ends = best.surface_refs();
        let scaled = refine_with_scale(ends, pose, INLIER_DISTANCE * self.voxel_size)?;
        let overlap = best.evidence(&scaled, COARSE_REFINEMENT.max_points).overlap;
        let other = (scaled.scale - 1.0).abs() > MIN_SCALE_CHANGE
            && overlap > evidence.overlap + MIN_OVERLAP_GAIN;
        other.then_some(ScaleMismatch { scale: scaled.scale, overlap })
    }
}
