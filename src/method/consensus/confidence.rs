//! How an answer stands: what speaks for it, how many poses came to it, how well it is held.

use super::evidence::PoseEvidence;
use super::refine;
use super::scan::INLIER_DISTANCE;
use super::{ConsensusSearch, DUPLICATE_POSE, mean_displacement, probe_points};
use crate::cloud::Transform;
use crate::verify::PoseCovariance;

/// Bounds of [`Confidence::translation_std`]: better than the first or worse than the second tells no more.
const TRANSLATION_STD_RANGE: [f64; 2] = [0.02, 10.0];

/// What the probability of a pose is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Confidence {
    pub(super) evidence: PoseEvidence,
    /// Settled poses, of all that was tried, that are this one.
    pub(super) supporting_hypotheses: usize,
    /// Standard deviation of its shift, in lengths; the upper bound where nothing tells it.
    pub(super) translation_std: f64,
}

impl Confidence {
    /// The logarithm of the odds that an answer is right.
    ///
    /// [`PoseEvidence::log_odds`] ranks the poses of a pair; chance has a best one for every pair, on
    /// which other seeds do not agree and which slides. Logistic, fitted on the answers to 924
    /// pairs, 470 of which have nothing in common, with the sensors' places known and not
    /// (`python-ref/verdict.sh`).
    pub(super) fn log_odds(&self) -> f64 {
        let (votes, spread) =
            ((self.supporting_hypotheses as f64).ln_1p(), self.translation_std.ln());
        -2.67 + 0.70 * self.evidence.log_odds() + 1.43 * votes - 0.74 * spread
    }

    pub(super) fn probability(&self) -> f64 {
        // Nothing is certain: odds stay finite.
        1.0 / (1.0 + (-self.log_odds().clamp(-30.0, 30.0)).exp())
    }
}

impl ConsensusSearch<'_> {
    /// Of `pose`, for which `evidence` speaks.
    pub(super) fn compute_confidence(
        &self,
        pose: &Transform,
        evidence: PoseEvidence,
        covariance: Option<&PoseCovariance>,
    ) -> Confidence {
        let [least, most] = TRANSLATION_STD_RANGE;
        let shift = |known: &PoseCovariance| {
            let variance: f64 = (3..6).map(|i| known.matrix[i][i]).sum();
            (variance.sqrt() / self.voxel_size).clamp(least, most)
        };
        Confidence {
            evidence,
            supporting_hypotheses: self.count_supporting_hypotheses(pose),
            translation_std: covariance.map_or(most, shift),
        }
    }

    /// Settled poses that are `pose`.
    pub(super) fn count_supporting_hypotheses(&self, pose: &Transform) -> usize {
        let corners = probe_points(&self.trials[self.best_trial].surfaces[0]);
        let all = self.trials.iter().flat_map(|attempt| &attempt.candidates);
        all.filter(|other| {
            mean_displacement(&other.pose, pose, &corners) <= DUPLICATE_POSE * self.voxel_size
        })
        .count()
    }

    /// How far `pose` may be off, if it is the right one.
    pub(super) fn covariance(&self, pose: &Transform) -> Option<PoseCovariance> {
        let ends = self.trials[self.best_trial].surface_refs();
        refine::estimate_covariance(ends, pose, INLIER_DISTANCE * self.voxel_size, self.voxel_size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn votes_and_a_firm_hold_make_an_answer_more_probable() {
        let evidence = PoseEvidence {
            overlap: 0.3,
            descriptor_distinctiveness: 0.7,
            inlier_score: 9.0,
            free_space_violation: None,
        };
        let told = |votes, spread| {
            Confidence { evidence, supporting_hypotheses: votes, translation_std: spread }
                .probability()
        };
        assert!(told(11, 0.3) > 0.7 && told(1, 8.0) < 0.3, "{} {}", told(11, 0.3), told(1, 8.0));
        assert!(told(2, 0.3) > told(1, 0.3) && told(2, 0.1) > told(2, 0.3));
    }
}
