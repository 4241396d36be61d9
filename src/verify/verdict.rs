//! The verdict on a pose: accept, ambiguous, uncertain or reject.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::PoseCovariance;
use super::evidence::Evidence;
use super::model::{Thresholds, VerdictModel};
use crate::cloud::Transform;
use crate::error::{Error, Result};

/// What to do with a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decision {
    /// The pose is correct with high probability.
    Accept,
    /// The pose has an alternative that may be correct instead: see [`Verdict::runner_up`]; or it
    /// has [`unobservable`](PoseCovariance::unobservable) motions, along which all poses fit.
    Ambiguous,
    /// The pose is neither probable enough to accept nor improbable.
    Uncertain,
    /// The pose is probably wrong; the clouds may not overlap.
    Reject,
}

impl Decision {
    /// All decisions.
    pub const ALL: [Decision; 4] =
        [Decision::Accept, Decision::Ambiguous, Decision::Uncertain, Decision::Reject];
}

impl std::str::FromStr for Decision {
    type Err = Error;

    /// Parses the word that [`Display`](fmt::Display) writes.
    fn from_str(word: &str) -> Result<Decision> {
        let found = Decision::ALL.into_iter().find(|decision| decision.to_string() == word);
        let rule = "must be accept, ambiguous, uncertain or reject";
        found.ok_or_else(|| Error::config("decision", word, rule))
    }
}

/// Returns whether a pose may be used: it has no warnings (`trusted`), its verdict, if any, is
/// [`Decision::Accept`], its numbers are finite, and it is a proper rotation, a positive scale and
/// a translation.
///
/// Every part of the crate that uses poses calls this function: graphs, summaries, reports, exit
/// status.
///
/// ```
/// use cfreg::{Transform, verify::{Decision, is_usable}};
/// let pose = Transform::IDENTITY;
/// assert!(is_usable(&pose, true, None) && is_usable(&pose, true, Some(Decision::Accept)));
/// assert!(!is_usable(&pose, false, Some(Decision::Accept)));
/// ```
pub fn is_usable(pose: &Transform, trusted: bool, decision: Option<Decision>) -> bool {
    let accepted = decision.is_none_or(|decision| decision == Decision::Accept);
    trusted && accepted && Transform::from_matrix(pose.matrix()).is_ok()
}

impl fmt::Display for Decision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Decision::Accept => "accept",
            Decision::Ambiguous => "ambiguous",
            Decision::Uncertain => "uncertain",
            Decision::Reject => "reject",
        })
    }
}

/// Another pose that would do.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct RunnerUp {
    /// Source into target frame.
    pub transform: Transform,
    /// The probability that the alternative is correct.
    pub probability: f64,
}

/// Whether to take an answer, and why.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Verdict {
    /// The decision.
    pub decision: Decision,
    /// The probability that the pose is correct, in [0, 1]; with that of the runner-up at most 1.
    pub probability: f64,
    /// Reasons for and against the pose, in words.
    pub reasons: Vec<String>,
    /// Share of a surface that overlaps the other and faces the same way, the larger of both
    /// directions, in [0, 1].
    pub overlap: f64,
    /// All measurements for and against the pose; `None` in results of earlier versions.
    #[serde(default)]
    pub evidence: Option<Evidence>,
    /// The best alternative pose, if there is one.
    pub runner_up: Option<RunnerUp>,
    /// Covariance of the pose if it is correct, with its unobservable motions; `None` if too few
    /// points overlap for an estimate. A refinement that keeps the verdict has the covariance of
    /// the pose before the refinement.
    pub covariance: Option<PoseCovariance>,
    /// A scale of the source, other than its own, at which clearly more of the source would overlap
    /// the target: a rigid pose of the unscaled clouds is then ambiguous.
    pub other_scale: Option<f64>,
    /// Whether the mirror image of the source fits the target better than the source, at this pose
    /// or one like it: a rigid pose is then ambiguous.
    #[serde(default)]
    pub mirrored: bool,
    /// Version of the [`VerdictModel`] that gave the probabilities and the decision.
    #[serde(default)]
    pub model: String,
    /// Thresholds of the model.
    #[serde(skip)]
    pub(crate) thresholds: Thresholds,
}

impl Verdict {
    /// Decides by the thresholds of `model`. `probability` and that of the runner-up each assume
    /// that no other pose exists; at most one of the two poses is correct, so the verdict has
    /// exclusive probabilities.
    ///
    /// A pose below the threshold `reject`, alone or with an alternative, is rejected; a pose below
    /// `accept` is uncertain; a pose with an alternative, or with an unobservable motion, is
    /// ambiguous.
    pub fn new(
        model: &VerdictModel,
        probability: f64,
        evidence: Evidence,
        reasons: Vec<String>,
        mut runner_up: Option<RunnerUp>,
        covariance: Option<PoseCovariance>,
    ) -> Verdict {
        let Thresholds { accept, reject, ambiguous_odds } = model.thresholds;
        let alone = runner_up.map_or(0.0, |other| other.probability);
        let [shared, other] = exclusive_probabilities(probability, alone);
        let has_rival = alone >= accept && other >= ambiguous_odds * shared;
        // The pose is correct only if the alternative is wrong, which is very improbable.
        let is_beaten = alone >= accept && shared < ambiguous_odds * other;
        let slides = covariance.as_ref().is_some_and(|known| !known.unobservable.is_empty());
        let decision = if probability.is_nan() || probability < reject || is_beaten {
            Decision::Reject
        } else if probability < accept {
            Decision::Uncertain
        } else if has_rival || slides || shared < accept {
            Decision::Ambiguous
        } else {
            Decision::Accept
        };
        if let Some(runner_up) = &mut runner_up {
            runner_up.probability = other;
        }
        Verdict {
            decision,
            probability: shared,
            reasons,
            overlap: evidence.overlap,
            evidence: Some(evidence),
            runner_up,
            covariance,
            other_scale: None,
            mirrored: false,
            model: model.version.clone(),
            thresholds: model.thresholds,
        }
    }

    /// Changes an accepted pose to ambiguous because wrong rotations fit as well: their fitness is
    /// `chance`.
    pub(crate) fn with_high_chance_fitness(mut self, chance: f64) -> Verdict {
        if self.decision == Decision::Accept {
            self.decision = Decision::Ambiguous;
        }
        let percent = 100.0 * chance;
        self.reasons.push(format!(
            "turned by quarter turns, {percent:.0} % of the source still lies on the target"
        ));
        self
    }

    /// Changes a pose that is not rejected to ambiguous because the mirrored source would have this `overlap`
    /// with the target, and less conflict.
    pub(crate) fn with_mirrored(mut self, overlap: f64) -> Verdict {
        if self.decision != Decision::Reject {
            self.decision = Decision::Ambiguous;
        }
        let percent = 100.0 * overlap;
        self.reasons.push(format!(
            "the mirror image of the source fits better: {percent:.0} % of it would overlap (is an \
             axis of one cloud reversed?)"
        ));
        Verdict { mirrored: true, ..self }
    }

    /// Changes a pose that is not rejected to ambiguous because the source scaled by `scale` would have this
    /// `overlap` with the target.
    pub(crate) fn with_scale_mismatch(mut self, scale: f64, overlap: f64) -> Verdict {
        if self.decision != Decision::Reject {
            self.decision = Decision::Ambiguous;
        }
        let percent = 100.0 * overlap;
        self.reasons.push(format!(
            "scaled by {scale:.3}, {percent:.0} % of the source would overlap: do both clouds have \
             one unit?"
        ));
        Verdict { other_scale: Some(scale), ..self }
    }
}

impl fmt::Display for Verdict {
    /// Writes one line: the decision, the probability, the reasons.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Verdict { decision, probability, reasons, .. } = self;
        write!(f, "{decision}: right with probability {probability:.3}; {}", reasons.join("; "))
    }
}

/// Returns the probabilities of two poses of which at most one is correct: each pose and not the
/// other, given that not both are correct.
fn exclusive_probabilities(first: f64, second: f64) -> [f64; 2] {
    let alone = [first * (1.0 - second), second * (1.0 - first)];
    let all = alone[0] + alone[1] + (1.0 - first) * (1.0 - second);
    // Two certain poses are equally probable.
    if all == 0.0 { [0.5; 2] } else { alone.map(|share| share / all) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::Twist;
    use crate::verify::evidence::tests::EVIDENCE;

    #[test]
    fn probabilities_decide() {
        let told = |probability, other: Option<f64>| {
            let transform = Transform::IDENTITY;
            let other = other.map(|probability| RunnerUp { transform, probability });
            Verdict::new(&VerdictModel::default(), probability, EVIDENCE, Vec::new(), other, None)
        };
        let decided = |probability, other| told(probability, other).decision;
        assert_eq!(decided(0.99, None), Decision::Accept);
        assert_eq!(decided(0.99, Some(0.01)), Decision::Accept);
        assert_eq!(decided(0.99, Some(0.95)), Decision::Ambiguous);
        // About 500 times less probable.
        assert_eq!(decided(0.9999, Some(0.95)), Decision::Accept);
        assert_eq!(decided(0.05, Some(0.02)), Decision::Reject);
        assert_eq!(decided(0.63, None), Decision::Uncertain);
        assert_eq!(decided(0.3, None), Decision::Uncertain);
        assert_eq!(decided(0.09, None), Decision::Reject);
        assert_eq!(decided(0.5, Some(0.9999)), Decision::Reject);
        // Probable by itself, but 500 times less so than the alternative.
        assert_eq!(decided(0.95, Some(0.9999)), Decision::Reject);
        assert_eq!(decided(f64::NAN, None), Decision::Reject);
        // No alternative that would be accepted, but both cannot be correct.
        assert_eq!(decided(0.85, Some(0.75)), Decision::Ambiguous);
        let equal = told(0.998, Some(0.998));
        let other = equal.runner_up.unwrap().probability;
        assert!((equal.probability - 0.4995).abs() < 1e-4 && other == equal.probability);
        assert_eq!(told(0.8, None).probability, 0.8);
    }

    #[test]
    fn certain_poses_share_what_there_is() {
        let told = |probability, other| {
            let other = RunnerUp { transform: Transform::IDENTITY, probability: other };
            let verdict = Verdict::new(
                &VerdictModel::default(),
                probability,
                EVIDENCE,
                Vec::new(),
                Some(other),
                None,
            );
            (verdict.probability, verdict.runner_up.unwrap().probability, verdict.decision)
        };
        assert_eq!(
            Verdict::new(&VerdictModel::default(), 1.0, EVIDENCE, Vec::new(), None, None)
                .probability,
            1.0
        );
        assert_eq!(told(1.0, 0.95), (1.0, 0.0, Decision::Accept));
        assert_eq!(told(0.95, 1.0), (0.0, 1.0, Decision::Reject));
        // At most one of two certain poses is correct, and both are equally probable.
        assert_eq!(told(1.0, 1.0), (0.5, 0.5, Decision::Ambiguous));
        assert_eq!(told(0.0, 1.0), (0.0, 1.0, Decision::Reject));
    }

    #[test]
    fn decisions_are_words_as_in_json() {
        for decision in Decision::ALL {
            assert_eq!(serde_json::to_value(decision).unwrap(), decision.to_string());
            assert_eq!(decision.to_string().parse::<Decision>().unwrap(), decision);
        }
    }

    #[test]
    fn a_pose_is_used_that_nothing_speaks_against() {
        let pose = Transform::IDENTITY;
        for (trusted, decision, usable) in [
            (true, None, true),
            (false, None, false),
            (true, Some(Decision::Accept), true),
            (false, Some(Decision::Accept), false),
            (true, Some(Decision::Ambiguous), false),
            (true, Some(Decision::Uncertain), false),
            (true, Some(Decision::Reject), false),
        ] {
            assert_eq!(is_usable(&pose, trusted, decision), usable, "{trusted} {decision:?}");
        }
        let mut mirrored = pose;
        mirrored.rotation[0][0] = -1.0;
        let mut sheared = pose;
        sheared.rotation[0][1] = 0.1;
        let nowhere = Transform { translation: [0.0, f64::NAN, 0.0], ..pose };
        let nothing = Transform { scale: 0.0, ..pose };
        for broken in [mirrored, sheared, nowhere, nothing] {
            assert!(!is_usable(&broken, true, None), "{broken:?}");
        }
        assert!("Accept".parse::<Decision>().is_err());
    }

    #[test]
    fn a_pose_that_slides_is_not_accepted() {
        let motion = Twist { rotation: [0.0; 3], translation: [1.0, 0.0, 0.0] };
        let known = |undetermined| PoseCovariance {
            matrix: [[0.0; 6]; 6],
            center: [0.0; 3],
            unobservable: undetermined,
        };
        let decided = |known| {
            Verdict::new(&VerdictModel::default(), 0.99, EVIDENCE, Vec::new(), None, Some(known))
                .decision
        };
        assert_eq!(decided(known(Vec::new())), Decision::Accept);
        assert_eq!(decided(known(vec![motion])), Decision::Ambiguous);
    }
}
