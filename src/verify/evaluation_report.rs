//! Evaluation of a pose from any source.

use serde::Serialize;

use super::{Evaluation, PoseError, default_distance, evaluate, pose_error};
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;

/// Evaluation of a pose: the fit of the clouds, and the error against the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct EvaluationReport {
    /// Fit of the clouds.
    #[serde(flatten)]
    pub evaluation: Evaluation,
    /// The error, if the truth is known.
    pub truth: Option<PoseError>,
}

/// Evaluates `transform`, which moves `source` onto `target`.
///
/// Pairs count up to `max_distance`, in the target's unit; the default is the [`default_distance`].
///
/// # Errors
/// Those of [`evaluate()`] and [`default_distance`].
///
/// ```
/// use cfreg::{PointCloud, Transform, verify};
/// let cloud = PointCloud::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])?;
/// let truth = Transform::IDENTITY;
/// let judged = verify::evaluate_with_truth(&cloud, &cloud, &truth, None, Some(&truth))?;
/// assert_eq!((judged.evaluation.fitness, judged.truth.unwrap().rotation_deg), (1.0, 0.0));
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn evaluate_with_truth(
    source: &PointCloud,
    target: &PointCloud,
    transform: &Transform,
    max_distance: Option<f64>,
    truth: Option<&Transform>,
) -> Result<EvaluationReport> {
    let usual = || default_distance(source, target, transform.scale);
    let distance = max_distance.map_or_else(usual, Ok)?;
    Ok(EvaluationReport {
        evaluation: evaluate(source, target, transform, distance)?,
        truth: truth.map(|truth| pose_error(transform, truth, source.centroid())),
    })
}
