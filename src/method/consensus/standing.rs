//! How an answer stands: what speaks for it, how many poses came to it, how well it is held.

use super::evidence::Evidence;
use super::scan::REACH;
use super::settle;
use super::{SAME, Search, apart, corners};
use crate::cloud::Transform;
use crate::quality::PoseCovariance;

/// Bounds of [`Standing::spread`]: better than the first or worse than the second tells no more.
const SPREAD: [f64; 2] = [0.02, 10.0];

/// What the probability of a pose is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Standing {
    pub(super) evidence: Evidence,
    /// Settled poses, of all that was tried, that are this one.
    pub(super) votes: usize,
    /// Standard deviation of its shift, in lengths; the upper bound where nothing tells it.
    pub(super) spread: f64,
}

impl Standing {
    /// The logarithm of the odds that an answer is right.
    ///
    /// [`Evidence::log_odds`] ranks the poses of a pair; chance has a best one for every pair, on
    /// which other seeds do not agree and which slides. Logistic, fitted on the answers to 924
    /// pairs, 470 of which have nothing in common, with the sensors' places known and not
    /// (`python-ref/verdict/verdict.sh`).
    pub(super) fn log_odds(&self) -> f64 {
        let (votes, spread) = ((self.votes as f64).ln_1p(), self.spread.ln());
        -2.67 + 0.70 * self.evidence.log_odds() + 1.43 * votes - 0.74 * spread
    }

    pub(super) fn probability(&self) -> f64 {
        // Nothing is certain: odds stay finite.
        1.0 / (1.0 + (-self.log_odds().clamp(-30.0, 30.0)).exp())
    }
}

impl Search<'_> {
    /// Of `pose`, for which `evidence` speaks.
    pub(super) fn standing(
        &self,
        pose: &Transform,
        evidence: Evidence,
        covariance: Option<&PoseCovariance>,
    ) -> Standing {
        let [least, most] = SPREAD;
        let shift = |known: &PoseCovariance| {
            let variance: f64 = (3..6).map(|i| known.matrix[i][i]).sum();
            (variance.sqrt() / self.length).clamp(least, most)
        };
        Standing { evidence, votes: self.votes(pose), spread: covariance.map_or(most, shift) }
    }

    /// Settled poses that are `pose`.
    pub(super) fn votes(&self, pose: &Transform) -> usize {
        let corners = corners(&self.attempts[self.best].surfaces[0]);
        let all = self.attempts.iter().flat_map(|attempt| &attempt.candidates);
        all.filter(|other| apart(&other.pose, pose, &corners) <= SAME * self.length).count()
    }

    /// How far `pose` may be off, if it is the right one.
    pub(super) fn covariance(&self, pose: &Transform) -> Option<PoseCovariance> {
        let ends = self.attempts[self.best].ends();
        settle::covariance(ends, pose, REACH * self.length, self.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn votes_and_a_firm_hold_make_an_answer_more_probable() {
        let evidence = Evidence { overlap: 0.3, likeness: 0.7, support: 9.0, contradicted: None };
        let told = |votes, spread| Standing { evidence, votes, spread }.probability();
        assert!(told(11, 0.3) > 0.7 && told(1, 8.0) < 0.3, "{} {}", told(11, 0.3), told(1, 8.0));
        assert!(told(2, 0.3) > told(1, 0.3) && told(2, 0.1) > told(2, 0.3));
    }
}
