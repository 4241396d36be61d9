//! What iterations report: each step, and why they ended.

use serde::{Deserialize, Serialize};

use crate::cloud::Transform;

/// Why a method stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum StopReason {
    /// It solves once: there is nothing to iterate.
    OneStep,
    /// The pose no longer moved.
    PoseSettled,
    /// The objective no longer changed.
    ObjectiveSettled,
    /// The schedule of the weights (bandwidth, control parameter) came to its end.
    ScheduleEnded,
    /// The largest number of iterations was reached first: the pose is doubted.
    IterationLimit,
}

/// One iteration: weights made at a pose, solved for the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct IterationRecord {
    /// From 1.
    pub iteration: u32,
    /// The pose after this step.
    pub transform: Transform,
    /// The method's objective; which one, and which way it goes, the method says.
    pub objective: f64,
    /// Σw of the step.
    pub weight: f64,
    /// Bandwidth in force (σ of the Gaussian kernels, in the target's unit); `null` where
    /// the method has none.
    pub bandwidth: Option<f64>,
}
