//! Reports of iterations: each step, and the reason for the end.

use serde::{Deserialize, Serialize};

use crate::cloud::Transform;

/// Why a method stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum StopReason {
    /// The method solves once, without iterations.
    OneStep,
    /// The pose no longer changed.
    PoseSettled,
    /// The objective no longer changed.
    ObjectiveSettled,
    /// The schedule of the weights (bandwidth, control parameter) ended.
    ScheduleEnded,
    /// The largest number of iterations was reached first: the pose gets a warning.
    IterationLimit,
}

/// One iteration: weights made at a pose, solved for the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct IterationRecord {
    /// Number of the iteration, from 1.
    pub iteration: u32,
    /// The pose after this step.
    pub transform: Transform,
    /// The method's objective; the method documents its definition and direction.
    pub objective: f64,
    /// Σw of the step.
    pub weight: f64,
    /// Bandwidth in force (σ of the Gaussian kernels, in the target's unit); `null` if the method
    /// has none.
    pub bandwidth: Option<f64>,
}
