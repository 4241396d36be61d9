//! Is a pose right? Measures on the clouds themselves, errors against a known truth, and
//! grounds for doubt.

mod covariance;
mod doubt;
mod evaluate;
mod judge;
mod truth;
mod verdict;

pub use covariance::{Contact, Motion, PoseCovariance};
pub use doubt::{
    Doubt, FLAT, MIN_AGREEMENT, MIN_AGREEMENT_BY_POSITION, MIN_KEYPOINTS, MIN_SINGULAR_VALUE,
    doubts,
};
pub(crate) use evaluate::distance_of_resolutions;
pub use evaluate::{DISTANCE_IN_RESOLUTIONS, Evaluation, default_distance, evaluate};
pub use judge::{Judgement, judge};
pub use truth::{TruthError, truth_error};
pub use verdict::{ACCEPT, AMBIGUOUS, Decision, RunnerUp, Verdict, is_usable};
