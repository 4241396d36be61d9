//! The best pose of all trials: the first candidates, refined until their own errors remain.

use super::trial::{LocalScoredPose, ViewpointTrial, sort_by_odds};
use super::{Consensus, FINE_REFINEMENT};
use crate::cloud::Transform;
use crate::par;
use crate::surface::{INLIER_DISTANCE, Refined, refine};

/// Number of candidates that are refined finely, before the best of them is chosen. Chosen by hand.
const FINE_POSES: usize = 3;
/// Difference of the log odds from the best candidate up to which others are refined finely. Chosen
/// by hand.
const CLOSE_LOG_ODDS: f64 = 3.0;
/// Probability of a pose above which its alternatives are looked for. Chosen by hand.
pub(super) const MIN_PROBABILITY_FOR_ALTERNATIVES: f64 = 0.3;

/// A finely refined pose, and its score.
pub(super) struct FinePose {
    pub(super) refined: Refined,
    pub(super) scored: LocalScoredPose,
}

/// Returns the number of the trial with the best candidate, the first of equally good trials.
pub(super) fn best_trial(trials: &[ViewpointTrial]) -> Option<usize> {
    let odds = |trial: &ViewpointTrial| {
        trial.candidates.first().map_or(f64::NEG_INFINITY, |best| best.log_odds)
    };
    let ranked = trials.iter().enumerate().rev();
    ranked.max_by(|(_, a), (_, b)| odds(a).total_cmp(&odds(b))).map(|(best, _)| best)
}

impl Consensus {
    /// Refines the candidates of a trial that are nearly as good as its first one, and returns the
    /// best of them; `None` without a candidate.
    pub(super) fn refine_candidates(
        &self,
        trial: &ViewpointTrial,
        voxel_size: f64,
    ) -> Option<FinePose> {
        let first = trial.candidates.first()?.log_odds;
        let near = |candidate: &&LocalScoredPose| candidate.log_odds > first - CLOSE_LOG_ODDS;
        let close: Vec<_> = trial.candidates.iter().take(FINE_POSES).take_while(near).collect();
        let refined = |k: usize| self.refine_finely(&close[k].pose, trial, voxel_size);
        let mut all = par::map(close.len(), || (), |_, k| refined(k));
        // The first of equally good ones.
        all.reverse();
        all.into_iter().max_by(|a, b| a.scored.log_odds.total_cmp(&b.scored.log_odds))
    }

    /// Returns the alternatives of `best`, most probable first; the first of them, if it is more
    /// probable than `best`, is refined and changes places with it.
    pub(super) fn find_alternatives(
        &self,
        best: &mut FinePose,
        trial: &ViewpointTrial,
        voxel_size: f64,
    ) -> Vec<LocalScoredPose> {
        let mut alternatives = self.alternatives(trial, &best.scored.pose, voxel_size);
        if let Some(other) = alternatives.first()
            && other.log_odds > best.scored.log_odds
        {
            let beaten = best.scored;
            *best = self.refine_finely(&other.pose, trial, voxel_size);
            alternatives[0] = beaten;
            sort_by_odds(&mut alternatives);
        }
        alternatives
    }

    fn refine_finely(&self, pose: &Transform, trial: &ViewpointTrial, voxel_size: f64) -> FinePose {
        let max_distance = INLIER_DISTANCE * voxel_size;
        let ends = trial.surface_refs();
        let refined = refine(ends, pose, max_distance, FINE_REFINEMENT, &self.prior);
        FinePose { refined, scored: trial.score(&refined.pose, self) }
    }
}
