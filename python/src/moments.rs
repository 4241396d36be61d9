//! Moments of the full connection, and poses from them.

use numpy::prelude::*;
use numpy::{PyArray1, PyArray2, dtype};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::arrays::{
    array_for_points, as_array, descriptors, parse_pose, read_only, to_array2, values_for_points,
};
use super::cloud_arg::CloudArg;
use super::errors::{
    self, SettingError, ShapeError, argument_error, format_value, parse_count, real,
    settings_error, to_pyerr, whole,
};
use super::gil::{run_interruptible, run_interruptible_on};
use super::interop::BadRows;
use super::panics::catch_panic;
use super::registration::to_json;
use super::shutdown::detach;
use super::weights::{CustomWeights, Weights};
use cfreg::cloud::{Descriptors, PointCloud};
use cfreg::error::Error;
use cfreg::math::Vec3;
use cfreg::method::Cf;
use cfreg::moments::{
    FeatureView, FullConnection, Moments as Sums, WeightedPair, moments_of_pairs as sum_pairs,
};
use cfreg::par;
use cfreg::pose::{Prior, ScaleEstimate, Solver, solve_with as solved};
use cfreg::weight::{Bandwidth, Composite, Normalization};

/// Sums over all weighted pairs of source points p and target points q, about fixed origins: the
/// input of every closed form. Created by moments(); attributes are read-only.
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
#[pyclass(frozen, module = "cfreg", eq)]
#[derive(PartialEq)]
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
        to_array1(py, self.0.source_sum)
    }

    #[getter]
    fn target_sum<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        to_array1(py, self.0.target_sum)
    }

    #[getter]
    fn cross<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        read_only(to_array2(py, 3, self.0.cross.as_flattened().to_vec()))
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
        to_array1(py, self.0.source_origin)
    }

    #[getter]
    fn target_origin<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        to_array1(py, self.0.target_origin)
    }

    #[getter]
    fn effective_connections(&self) -> f64 {
        self.0.effective_connections()
    }

    /// Return the weighted residual, sum of w |T p - q|^2, of any pose.
    ///
    /// transform : (4, 4), T_target_source: rotation times scale, and translation.
    /// ValueError if it is no such matrix.
    fn residual(&self, transform: &Bound<'_, PyAny>) -> PyResult<f64> {
        let transform = parse_pose(transform, "transform")?;
        catch_panic(|| self.0.residual(&transform))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let state = (to_json(&slf.get().0)?,);
        (slf.get_type().getattr("_from_json")?, state).into_pyobject(slf.py())
    }

    /// Return moments from their pickle.
    #[staticmethod]
    fn _from_json(json: &str) -> PyResult<Self> {
        serde_json::from_str(json).map(Moments).map_err(|error| settings_error("json", error))
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

fn to_array1(py: Python<'_>, values: Vec3) -> Bound<'_, PyArray1<f64>> {
    read_only(PyArray1::from_slice(py, &values))
}

/// Weight every source point against every target point by the distance of their descriptors, and
/// sum. Memory is O(N + M).
///
/// Distances are computed in float32 about the mean of all descriptors: the error of a squared
/// distance is some 1e-7 of the squares of both descriptors about this mean, also if it should be
/// 0. For FPFH, with squares up to some 1e4, that is up to 2e-4, where beta is 100.
///
/// Parameters
/// ----------
/// source_points, target_points : PointCloud, (N, 3) and (M, 3) numbers, or any other input
///     of PointCloud
/// source_descriptors, target_descriptors : (N, D) and (M, D) numbers, of any kind; fpfh()
///     computes one kind
/// weights : kernel of the squared distance d^2: "gaussian" exp(-d^2/beta), "laplacian",
///     "cauchy", "geman-mcclure", "truncated", "student-t:NU", "tukey", "uniform"; a kernel
///     of cfreg.weights, or a combination of several; or any function that receives a float32
///     array (sources, targets) of squared distances, part by part, and returns as many
///     weights (where masked: 0), each from its distance alone. Functions are called in
///     separate threads, several at once: they do not have the locks that the caller holds,
///     its context variables and numpy.errstate
/// beta : squared bandwidth in squared units of the descriptors, 1e-12 to 1e12; "auto", or
///     "auto:SHARE", the share (0.25) of the median squared distance to the most similar
///     point of the other cloud. None: the paper's 100, for FPFH of scale "pcl". Only for
///     weights given by name: the others have their own bandwidth
/// normalize : "none", "source", "target", "both" (dual softmax) or "sinkhorn:N"
/// tolerance : how much of the sum of weights may be left out, as a share of it, 0 to below
///     1, which is faster for clouds of tens of thousands of points. 0: every pair. Only for
///     weights given by name or as one kernel
/// threads : 0 for all cores; never changes the result
///
/// Returns
/// -------
/// Moments
///
/// Raises
/// ------
/// RegistrationError : no point (TooFewPointsError), or no connection with any weight
///     (NoWeightError)
/// NonFiniteError : a row that is not finite; the message names it
/// ShapeError : not (N, 3), or not one descriptor a point
/// SettingError : a setting out of range
/// Error : not an array or list of numbers
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np
/// >>> points, colours = np.random.default_rng(0).random((2, 50, 3))
/// >>> moments = cfreg.moments(points, points + 1.0, colours, colours, beta=0.01)
/// >>> cfreg.solve(moments).round(2)[:3, 3]
/// array([1., 1., 1.])
/// >>> step = cfreg.moments(points, points, colours, colours, weights=lambda d2: d2 < 1e-6)
/// >>> round(step.weight)
/// 50
#[pyfunction]
#[pyo3(signature = (
    source_points, target_points, source_descriptors, target_descriptors,
    weights=None, beta=None, normalize="none", tolerance=0.0, threads=0,
))]
#[pyo3(text_signature = "(source_points, target_points, source_descriptors, \
    target_descriptors, weights='gaussian', beta=None, normalize='none', tolerance=0.0, threads=0)")]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn moments(
    py: Python<'_>,
    source_points: &Bound<'_, PyAny>,
    target_points: &Bound<'_, PyAny>,
    source_descriptors: &Bound<'_, PyAny>,
    target_descriptors: &Bound<'_, PyAny>,
    weights: Option<&Bound<'_, PyAny>>,
    beta: Option<&Bound<'_, PyAny>>,
    normalize: &str,
    #[pyo3(from_py_with = real)] tolerance: f64,
    #[pyo3(from_py_with = whole)] threads: i64,
) -> PyResult<Moments> {
    let named = |setting: &str| {
        Err(SettingError::new_err(format!("{setting}: only for weights that are a name")))
    };
    let weights = match weights {
        Some(weights) => Weights::read(weights, "weights")?,
        None => Weights::Named(Cf::default().weights),
    };
    let beta = beta.map(parse_bandwidth).transpose()?;
    if matches!(weights, Weights::Custom(_)) && beta.is_some() {
        return named("beta");
    }
    let (weights, beta) = match weights {
        // A kernel alone is its name and its bandwidth.
        Weights::Custom(CustomWeights::Composite(Composite::Kernel { kernel, beta })) => {
            (Weights::Named(kernel), beta)
        }
        weights => (weights, beta.unwrap_or_else(|| Cf::default().bandwidth())),
    };
    if matches!(weights, Weights::Custom(_)) && tolerance != 0.0 {
        return named("tolerance");
    }
    let normalize: Normalization =
        normalize.parse().map_err(|error| argument_error("normalize", error))?;
    let threads = parse_count("threads", threads)?;
    let source = CloudArg::read(source_points, "source_points", None, BadRows::Refuse)?;
    let target = CloudArg::read(target_points, "target_points", None, BadRows::Refuse)?;
    let (source, target) = (source.get(), target.get());
    let from =
        array_for_points(source_descriptors, "source_descriptors", source.len(), "source_points")?;
    let to =
        array_for_points(target_descriptors, "target_descriptors", target.len(), "target_points")?;
    let [from, to] = descriptors(py, &from, &to)?;
    let connection = || FullConnection::new(feature_view(source, &from), feature_view(target, &to));
    let sums = match &weights {
        Weights::Named(scheme) => run_interruptible(py, || {
            par::with_threads(threads, || {
                let connection = connection()?;
                let beta = connection.bandwidth(beta)?;
                connection.pruned_moments(*scheme, beta, normalize, tolerance)
            })?
        }),
        Weights::Custom(own) => own.reraise(run_interruptible_on(py, own.pool(), || {
            par::with_threads(threads, || own.moments(&connection()?, normalize))?
        })),
    };
    sums.map(Moments)
}

fn feature_view<'a>(cloud: &'a PointCloud, descriptors: &'a Descriptors) -> FeatureView<'a> {
    FeatureView { points: cloud.points(), origin: cloud.origin(), descriptors }
}

/// A bandwidth: a number, or how to find it.
fn parse_bandwidth(any: &Bound<'_, PyAny>) -> PyResult<Bandwidth> {
    if let Ok(number) = real(any) {
        return Ok(number.into());
    }
    let text = any.extract::<String>().unwrap_or_else(|_| format_value(any));
    text.parse().map_err(|error| argument_error("beta", error))
}

/// Sum over listed pairs: correspondences of your own.
///
/// Parameters
/// ----------
/// source_points, target_points : as in moments(); a PointCloud that has dropped rows is
///     refused, because its row numbers differ
/// pairs : (K, 2) integers, a row of source_points and one of target_points each
/// weights : (K,) numbers, finite and not negative. None: all 1
///
/// Returns
/// -------
/// Moments
///
/// Raises
/// ------
/// NoWeightError : no pair, or all weights are zero
/// ShapeError : a row that does not exist, or not one weight a pair
/// NonFiniteError, SettingError, Error : as in moments()
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np
/// >>> points = np.random.default_rng(0).random((9, 3))
/// >>> pairs = np.column_stack([np.arange(9), np.arange(9)])
/// >>> cfreg.solve(cfreg.moments_of_pairs(points, points + 1.0, pairs)).round(3)[0].tolist()
/// [1.0, 0.0, 0.0, 1.0]
#[pyfunction]
#[pyo3(signature = (source_points, target_points, pairs, weights=None))]
pub(super) fn moments_of_pairs(
    py: Python<'_>,
    source_points: &Bound<'_, PyAny>,
    target_points: &Bound<'_, PyAny>,
    pairs: &Bound<'_, PyAny>,
    weights: Option<&Bound<'_, PyAny>>,
) -> PyResult<Moments> {
    let source = CloudArg::read_indexed(source_points, "source_points")?;
    let target = CloudArg::read_indexed(target_points, "target_points")?;
    let pairs = index_pairs(pairs, "pairs")?;
    let column = |weights| values_for_points(weights, "weights", pairs.len(), "pairs");
    let weights = weights.map(column).transpose()?;
    let (source, target) = (source.get(), target.get());
    let sums = run_interruptible(py, || {
        let weight = |at| weights.as_ref().map_or(1.0, |w| w[at]);
        let weighed = |(at, &(source, target))| WeightedPair { source, target, weight: weight(at) };
        let pairs: Vec<WeightedPair> = pairs.iter().enumerate().map(weighed).collect();
        match pairs.iter().find(|pair| pair.weight < 0.0) {
            Some(bad) => Err(Error::config("weights", bad.weight, "must not be negative")),
            None => sum_pairs(source, target, &pairs),
        }
    });
    sums.map(Moments)
}

/// Reads rows (K, 2) of indices.
pub(super) fn index_pairs(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<(u32, u32)>> {
    let array = as_array(any, name)?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    if shape.len() != 2 || shape[1] != 2 {
        let found = array.getattr("shape")?;
        return Err(ShapeError::new_err(format!("{name}: expected shape (K, 2), found {found}")));
    }
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if kind != "i" && kind != "u" {
        let found = array.getattr("dtype")?;
        let message = format!("{name} must be integers, not {found}");
        return Err(errors::Error::new_err(message));
    }
    let py = any.py();
    // Integers above i64's become negative there, and negative rows do not exist, either.
    let highest = array.call_method0("max").ok().filter(|_| shape[0] > 0);
    if let Some(highest) = highest
        && highest.gt(u32::MAX)?
    {
        return Err(ShapeError::new_err(format!("{name}: {highest} is no row of a cloud")));
    }
    let rows = array.call_method1("astype", (dtype::<i64>(py), "C"))?;
    let rows = rows.cast::<PyArray2<i64>>()?.try_readonly()?;
    let rows = rows.as_slice()?.as_chunks::<2>().0;
    detach(py, || {
        let index = |index: i64| u32::try_from(index).map_err(|_| index);
        rows.iter().map(|&[a, b]| Ok((index(a)?, index(b)?))).collect::<Result<_, i64>>()
    })?
    .map_err(|index| ShapeError::new_err(format!("{name}: {index} is no row of a cloud")))
}

/// Solve in closed form for the pose of least weighted residual.
///
/// Parameters
/// ----------
/// moments : Moments
/// solver : "arun" (SVD), "horn-quaternion", "horn-matrix" or "walker" (dual quaternion);
///     all give the same pose
/// scale : "fixed" (1), "umeyama" (least squares; shrinks on a full connection) or
///     "symmetric" (square root of the ratio of variances)
/// prior : cfreg.Prior, prior knowledge of the pose; the result is the best pose that it allows
///
/// Returns
/// -------
/// (4, 4) float64, T_target_source: maps source points into the frame of the target, in
/// the unit of the points
///
/// Raises
/// ------
/// DegenerateError : the weighted pairs do not constrain the rotation
/// SettingError : a setting out of range
#[pyfunction]
#[pyo3(signature = (moments, solver="arun", scale="fixed", prior=None))]
pub(super) fn solve<'py>(
    py: Python<'py>,
    moments: &Bound<'py, Moments>,
    solver: &str,
    scale: &str,
    prior: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let prior = prior.map(parse_prior).transpose()?.unwrap_or_default();
    let solver: Solver = solver.parse().map_err(|error| argument_error("solver", error))?;
    let scale: ScaleEstimate = scale.parse().map_err(|error| argument_error("scale", error))?;
    // Some microseconds: no need to let others run.
    let solution = catch_panic(|| solved(&moments.get().0, solver, scale, &prior))?;
    let solution = solution.map_err(to_pyerr)?;
    Ok(to_array2(py, 4, solution.transform.matrix().concat()))
}

/// A `cfreg.Prior`, by its facts in JSON.
fn parse_prior(prior: &Bound<'_, PyAny>) -> PyResult<Prior> {
    let class = prior.py().import("cfreg")?.getattr("Prior")?;
    if !prior.is_instance(&class)? {
        let given = format_value(prior);
        return Err(PyTypeError::new_err(format!("prior: a cfreg.Prior is needed, not {given}")));
    }
    let facts = prior.call_method0("_facts")?;
    let text: String = prior.py().import("json")?.call_method1("dumps", (facts,))?.extract()?;
    serde_json::from_str(&text).map_err(|error| settings_error("prior", error))
}
