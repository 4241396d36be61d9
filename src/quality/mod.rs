//! Is a pose right? Measures on the clouds themselves, errors against a known truth, and
//! grounds for doubt.

mod covariance;
mod warning;
mod evaluate;
mod evaluation_report;
mod pose_error;
mod verdict;

pub use covariance::{SurfacePair, Twist, PoseCovariance};
pub use warning::{
    Warning, MIN_THIRD_SINGULAR_VALUE, MAX_CHANCE_FITNESS, MAX_CHANCE_FITNESS_VERIFIED, MIN_CHANCE_CORRECTED_FITNESS, MIN_CHANCE_CORRECTED_FITNESS_LOCAL,
    MIN_KEYPOINTS, MIN_SECOND_SINGULAR_VALUE, find_warnings,
};
pub(crate) use evaluate::default_distance_from_resolutions;
pub use evaluate::{DISTANCE_IN_RESOLUTIONS, Evaluation, default_distance, evaluate};
pub use evaluation_report::{EvaluationReport, evaluate_with_truth};
pub use pose_error::{PoseError, pose_error};
pub use verdict::{MIN_ACCEPTED_PROBABILITY, MIN_AMBIGUOUS_ODDS, Decision, RunnerUp, Verdict, is_usable};
