//! Verification of poses: evidence on the surfaces, the verdict with its probability, warnings,
//! covariance, and errors against a known truth.

mod covariance;
mod evaluate;
mod evaluation_report;
mod evidence;
mod model;
mod pose_error;
mod surface_conflict;
mod surface_patches;
mod verdict;
mod warning;

pub use covariance::{PoseCovariance, Twist};
pub(crate) use evaluate::default_distance_from_resolutions;
pub use evaluate::{DISTANCE_IN_RESOLUTIONS, Evaluation, default_distance, evaluate};
pub use evaluation_report::{EvaluationReport, evaluate_with_truth};
pub use evidence::Evidence;
pub(crate) use evidence::{Measurement, squared_descriptor_distance};
pub(crate) use model::Confidence;
pub use model::{AnswerCoefficients, EvidenceCoefficients, Thresholds, VerdictModel};
pub use pose_error::{PoseError, pose_error};
pub use verdict::{Decision, RunnerUp, Verdict, is_usable};
pub use warning::{
    FitnessRule, MAX_CHANCE_FITNESS, MAX_CHANCE_FITNESS_VERIFIED, MIN_CHANCE_CORRECTED_FITNESS,
    MIN_CHANCE_CORRECTED_FITNESS_LOCAL, MIN_KEYPOINTS, MIN_SECOND_SINGULAR_VALUE,
    MIN_THIRD_SINGULAR_VALUE, Warning, check_singular_values,
};
