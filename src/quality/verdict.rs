//! Whether to take an answer.

use serde::Serialize;

use super::PoseCovariance;
use crate::cloud::Transform;

/// Probability from which on a pose is accepted.
pub const ACCEPT: f64 = 0.7;
/// Odds of another pose, relative to those of the answer, from which on the answer is
/// ambiguous, if the other would be accepted too.
pub const AMBIGUOUS: f64 = 0.1;

/// What to do with a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decision {
    /// Take it.
    Accept,
    /// It, or another one that is about as good: see [`Verdict::runner_up`].
    Ambiguous,
    /// It is probably wrong; the clouds may show nothing in common.
    Reject,
}

/// Another pose that would do.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RunnerUp {
    /// Source into target frame.
    pub transform: Transform,
    /// Its probability, as if it were the only one.
    pub probability: f64,
}

/// Whether to take an answer, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// What to do.
    pub decision: Decision,
    /// The probability that the pose is right, in [0, 1].
    pub probability: f64,
    /// What speaks for and against it, in words.
    pub reasons: Vec<String>,
    /// Share of a surface that lies on the other and faces alike, the larger of both, in [0, 1].
    pub overlap: f64,
    /// The best pose that is another, if there is one.
    pub runner_up: Option<RunnerUp>,
    /// How far the pose may be off if it is the right one, and along which motions nothing
    /// holds it; `None` where too few points lie on each other to tell. A refinement that takes
    /// the verdict over has that of the pose before.
    pub covariance: Option<PoseCovariance>,
}

impl Verdict {
    /// Decides by the probabilities.
    pub fn new(
        probability: f64,
        overlap: f64,
        reasons: Vec<String>,
        runner_up: Option<RunnerUp>,
        covariance: Option<PoseCovariance>,
    ) -> Verdict {
        let odds = |probability: f64| probability / (1.0 - probability);
        let rivals = |other: RunnerUp| {
            other.probability >= ACCEPT && odds(other.probability) >= AMBIGUOUS * odds(probability)
        };
        let decision = if probability.is_nan() || probability < ACCEPT {
            Decision::Reject
        } else if runner_up.is_some_and(rivals) {
            Decision::Ambiguous
        } else {
            Decision::Accept
        };
        Verdict { decision, probability, reasons, overlap, runner_up, covariance }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_decide() {
        let decided = |probability, other: Option<f64>| {
            let transform = Transform::IDENTITY;
            let other = other.map(|probability| RunnerUp { transform, probability });
            Verdict::new(probability, 0.5, Vec::new(), other, None).decision
        };
        assert_eq!(decided(0.99, None), Decision::Accept);
        assert_eq!(decided(0.99, Some(0.01)), Decision::Accept);
        assert_eq!(decided(0.99, Some(0.95)), Decision::Ambiguous);
        // A hundred times less probable.
        assert_eq!(decided(0.9999, Some(0.95)), Decision::Accept);
        assert_eq!(decided(0.1, Some(0.05)), Decision::Reject);
        assert_eq!(decided(f64::NAN, None), Decision::Reject);
    }
}
