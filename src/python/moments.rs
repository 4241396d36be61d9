//! Moments of the full connection, and poses from them.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use super::arrays::{descriptors, read_only, table, whole_cloud};
use super::errors::{exception, released};
use super::registration::{Beta, cf};
use crate::cloud::{Descriptors, PointCloud, Transform};
use crate::math::Vec3;
use crate::moments::{Described, FullConnection, Moments as Sums};
use crate::par;
use crate::pose;

/// Sums over all weighted pairs of source points p and target points q, about fixed
/// origins: all that a closed form needs. Made by moments(); attributes are read-only.
///
/// With p' = p - source_origin and q' = q - target_origin, in the unit of the points:
///
/// weight : sum of w
/// weight_squared : sum of w^2
/// source_sum, target_sum : (3,) float64, sums of w p' and of w q'
/// cross : (3, 3) float64, sum of w p' q'^T; rows follow the source
/// source_squares, target_squares : sums of w |p'|^2 and of w |q'|^2
/// source_origin, target_origin : (3,) float64
/// effective_connections : weight^2 / weight_squared, from 1 to the number of pairs
#[pyclass(frozen, module = "cfreg")]
pub(super) struct Moments(Sums);

#[pymethods]
impl Moments {
    #[getter]
    fn weight(&self) -> f64 {
        self.0.weight
    }

    #[getter]
    fn weight_squared(&self) -> f64 {
        self.0.weight_squared
    }

    #[getter]
    fn source_sum<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.0.source_sum)
    }

    #[getter]
    fn target_sum<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.0.target_sum)
    }

    #[getter]
    fn cross<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        read_only(table(py, 3, self.0.cross.as_flattened().to_vec()))
    }

    #[getter]
    fn source_squares(&self) -> f64 {
        self.0.source_squares
    }

    #[getter]
    fn target_squares(&self) -> f64 {
        self.0.target_squares
    }

    #[getter]
    fn source_origin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.0.source_origin)
    }

    #[getter]
    fn target_origin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.0.target_origin)
    }

    #[getter]
    fn effective_connections(&self) -> f64 {
        self.0.effective_connections()
    }

    /// The weighted residual, sum of w |T p - q|^2, of any pose.
    ///
    /// transform : (4, 4), T_target_source: rotation times scale, and translation.
    /// ValueError where it is no such matrix.
    fn residual(&self, transform: [[f64; 4]; 4]) -> PyResult<f64> {
        let transform = Transform::from_matrix(transform).map_err(exception)?;
        Ok(self.0.residual(&transform))
    }

    fn __repr__(&self) -> String {
        let Sums { weight, source_origin, target_origin, .. } = self.0;
        let effective = self.0.effective_connections();
        format!(
            "Moments(weight={weight:.6}, effective_connections={effective:.1}, \
             source_origin={source_origin:.6?}, target_origin={target_origin:.6?})"
        )
    }
}

fn vector(py: Python<'_>, values: Vec3) -> Bound<'_, PyArray1<f64>> {
    read_only(PyArray1::from_slice(py, &values))
}

/// Weigh every source point against every target point by the distance of their
/// descriptors, and sum. Memory is O(N + M).
///
/// Parameters
/// ----------
/// source_points, target_points : (N, 3) and (M, 3), float32 or float64
/// source_descriptors, target_descriptors : (N, D) and (M, D), float32 or float64, of any
///     kind; fpfh() makes one
/// weights : kernel of the squared distance d^2: "gaussian" exp(-d^2/beta), "laplacian",
///     "cauchy", "geman-mcclure", "truncated", "student-t:NU", "tukey", "uniform"
/// beta : squared bandwidth in squared units of the descriptors, 1e-12 to 1e12; "auto", or
///     "auto:SHARE", the share (0.25) of the median squared distance to the most similar
///     point of the other cloud. None: the paper's 100, for FPFH of scale "pcl"
/// normalize : "none", "source", "target", "both" (dual softmax) or "sinkhorn:N"
/// threads : 0 for all cores; never changes the result
///
/// Returns
/// -------
/// Moments
///
/// Raises
/// ------
/// RegistrationError : no point, or no connection with any weight
/// ValueError : a row that is not finite, named; a shape or setting out of range
/// TypeError : not an array of float32 or float64
#[pyfunction]
#[pyo3(signature = (
    source_points, target_points, source_descriptors, target_descriptors,
    weights="gaussian", beta=None, normalize="none", threads=0,
))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn moments(
    py: Python<'_>,
    source_points: &Bound<'_, PyAny>,
    target_points: &Bound<'_, PyAny>,
    source_descriptors: &Bound<'_, PyAny>,
    target_descriptors: &Bound<'_, PyAny>,
    weights: Option<&str>,
    beta: Option<Beta>,
    normalize: Option<&str>,
    threads: Option<i64>,
) -> PyResult<Moments> {
    let config = cf(weights, beta, normalize, None, None, threads)?;
    let source = whole_cloud(source_points, "source_points")?;
    let target = whole_cloud(target_points, "target_points")?;
    let from =
        descriptors(source_descriptors, "source_descriptors", source.len(), "source_points")?;
    let to = descriptors(target_descriptors, "target_descriptors", target.len(), "target_points")?;
    if from.dim() != to.dim() {
        let what = "columns of target_descriptors, against source_descriptors".into();
        let (expected, found) = (from.dim(), to.dim());
        return Err(exception(crate::Error::Shape { what, expected, found }));
    }
    let sums = released(py, || {
        par::with_threads(config.threads, || {
            let connection = FullConnection::new(side(&source, &from), side(&target, &to))?;
            let beta = connection.bandwidth(config.bandwidth())?;
            connection.scheme_moments(config.weights, beta, config.normalization)
        })?
    })?;
    Ok(Moments(sums))
}

fn side<'a>(cloud: &'a PointCloud, descriptors: &'a Descriptors) -> Described<'a> {
    Described { points: cloud.points(), origin: cloud.origin(), descriptors }
}

/// Solve in closed form for the pose of least weighted residual.
///
/// Parameters
/// ----------
/// moments : Moments
/// solver : "arun" (SVD), "horn-quaternion", "horn-matrix" or "walker" (dual quaternion);
///     all give the same answer
/// scale : "fixed" (1), "umeyama" (least squares; shrinks on a full connection) or
///     "symmetric" (square root of the ratio of variances)
///
/// Returns
/// -------
/// (4, 4) float64, T_target_source: maps source points into the frame of the target, in
/// the unit of the points
///
/// Raises
/// ------
/// RegistrationError : the weighted pairs do not determine a rotation
/// ValueError : a setting out of range
#[pyfunction]
#[pyo3(signature = (moments, solver="arun", scale="fixed"))]
pub(super) fn solve<'py>(
    py: Python<'py>,
    moments: &Bound<'py, Moments>,
    solver: Option<&str>,
    scale: Option<&str>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let config = cf(None, None, None, solver, scale, None)?;
    let sums = moments.get().0;
    let solution = released(py, || pose::solve(&sums, config.solver, config.scale))?;
    Ok(table(py, 4, solution.transform.matrix().as_flattened().to_vec()))
}
