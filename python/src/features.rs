//! Normals, keypoints and descriptors.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};

use super::arrays::{interop_module, parse_vec3, to_array2, values_for_points};
use super::cloud_arg::CloudArg;
use super::errors::{
    argument_error, format_value, parse_count, settings_error, shorten, to_pyerr, whole,
};
use super::gil::run_interruptible;
use super::interop::BadRows;
use cfreg::cloud::PointCloud;
use cfreg::descriptor::{self, BINS};
use cfreg::error::{Error, Result};
use cfreg::keypoint::Keypoints;
use cfreg::method::FeatureConfig;
use cfreg::normals::{self, Normals, Orientation};
use cfreg::search::{Neighborhood, Neighbors};

/// Arrays (N, 3) and (N,).
type NormalsAndCurvature<'py> = (Bound<'py, PyArray2<f32>>, Bound<'py, PyArray1<f32>>);

/// Estimate normals from the nearest neighbours of every point.
///
/// Parameters
/// ----------
/// points : PointCloud, (N, 3) numbers, or any other input of PointCloud; any unit
/// neighbors : nearest points of a neighbourhood, the point itself counted, at least 3;
///     all points if there are fewer
/// viewpoint : three numbers, the position of the sensor in the frame of the points; normals
///     point towards it. None: the viewpoint of the PointCloud, or else the origin. (For clouds
///     more than about 50 times their size away from it, a rounded position nearby that moves
///     along with map offsets.)
///
/// Returns
/// -------
/// normals : (N, 3) float32, of unit length; zero if the neighbourhood has no plane
/// curvature : (N,) float32, smallest eigenvalue of the neighbourhood's covariance over
///     the sum of all three, 0 on a plane to 1/3
///
/// Raises
/// ------
/// NonFiniteError : a row that is not finite; the message names it
/// ShapeError : not (N, 3)
/// SettingError : a setting out of range
/// Error : not an array or list of numbers
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np
/// >>> x, y = np.mgrid[-1:1:9j, -1:1:9j].reshape(2, -1)
/// >>> normals, curvature = cfreg.estimate_normals(np.column_stack([x, y, 0 * x - 2]), 9)
/// >>> normals[40].round(3).tolist(), float(curvature[40].round(3))
/// ([0.0, 0.0, 1.0], 0.0)
#[pyfunction]
#[pyo3(signature = (points, neighbors=150, viewpoint=None))]
pub(super) fn estimate_normals<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = whole)] neighbors: i64,
    viewpoint: Option<&Bound<'py, PyAny>>,
) -> PyResult<NormalsAndCurvature<'py>> {
    let describe = feature_config(neighbors, viewpoint)?;
    let cloud = CloudArg::read(points, "points", None, BadRows::Refuse)?;
    let cloud = cloud.get();
    let normals = run_interruptible(py, || Ok(neighbors_and_normals(cloud, &describe)?.1))?;
    let vectors = to_array2(py, 3, normals.vectors.into_flattened());
    Ok((vectors, PyArray1::from_vec(py, normals.curvature)))
}

/// Find keypoints: the few points that are distinctive in their surroundings.
///
/// Parameters
/// ----------
/// points : PointCloud, (N, 3) numbers, or any other input of PointCloud; any unit
/// detector : "sift", extrema of one scalar per point over position and scale, or "iss",
///     intrinsic shape signatures
/// values : (N,) numbers, one a point, that SIFT uses. None: the
///     curvature from estimate_normals with 150 neighbors
/// settings : settings of the detector, by name: for "sift" unit, min_scale, octaves, scales and
///     min_contrast, for "iss" unit, salient_radius, non_max_radius, gamma21, gamma32 and
///     min_neighbors. Lengths are in the cloud's resolution, or in `unit`
///
/// Returns
/// -------
/// (K,) uint64, rows of points, ascending; of a PointCloud rows of its `points`
///
/// Raises
/// ------
/// NonFiniteError : a row that is not finite; the message names it
/// ShapeError : not (N, 3)
/// SettingError : a setting out of range
/// Error : not an array or list of numbers
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np
/// >>> x, y = np.random.default_rng(1).uniform(-1, 1, (2, 2000))
/// >>> rows = cfreg.keypoints(np.column_stack([x, y, np.sin(3 * x) * np.cos(2 * y)]))
/// >>> 10 < len(rows) < 1000
/// True
#[pyfunction]
#[pyo3(signature = (points, detector="sift", values=None, **settings))]
pub(super) fn keypoints<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    detector: &str,
    values: Option<&Bound<'py, PyAny>>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyArray1<u64>>> {
    let settings: Value = match settings {
        Some(settings) => {
            let json: String =
                interop_module(py)?.call_method1("to_json", (settings,))?.extract()?;
            serde_json::from_str(&json).unwrap_or_default()
        }
        None => json!({}),
    };
    let detector: Keypoints = serde_json::from_value(json!({ detector: settings }))
        .map_err(|error| settings_error(&format!("detector = {}", shorten(detector)), error))?;
    let cloud = CloudArg::read(points, "points", None, BadRows::Refuse)?;
    let cloud = cloud.get();
    let column = |values| values_for_points(values, "values", cloud.len(), "points");
    let values = values.map(column).transpose()?;
    let values = values.map(|values| values.iter().map(|&x| x as f32).collect::<Vec<_>>());
    let found = run_interruptible(py, || match &values {
        Some(values) => detector.detect(cloud.points(), values),
        None => {
            let (_, normals) = neighbors_and_normals(cloud, &FeatureConfig::default())?;
            detector.detect(cloud.points(), &normals.curvature)
        }
    })?;
    Ok(PyArray1::from_vec(py, found.into_iter().map(|row| row as u64).collect()))
}

/// Compute Fast Point Feature Histograms (Rusu, Blodow and Beetz 2009).
///
/// Parameters
/// ----------
/// points : PointCloud, (N, 3) numbers, or any other input of PointCloud; any unit
/// neighbors : nearest points of a neighbourhood, the point itself counted, at least 3;
///     all points if there are fewer
/// scale : "pcl", three blocks of 11 bins that sum to 100 each (what PCL computes), or
///     "open3d", blocks that sum to 200 (what Open3D computes)
/// viewpoint : see estimate_normals; only without normals
/// normals : (N, 3) numbers, oriented; scaled to unit length, zero means
///     undefined. None: estimated over the same neighbourhoods
///
/// Returns
/// -------
/// (N, 33) float32; a row is zero for a point without others around it. Degenerate pairs (equal
/// positions, a normal that is zero as on a line) count in the middle bins
///
/// Raises
/// ------
/// NonFiniteError : a row that is not finite; the message names it
/// ShapeError : not (N, 3), or not one normal a point
/// SettingError : a setting out of range; normals and a viewpoint at once
/// Error : not an array or list of numbers
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np
/// >>> points = np.random.default_rng(2).random((200, 3))
/// >>> histograms = cfreg.fpfh(points, neighbors=30)
/// >>> histograms.shape, histograms.dtype.name, float(histograms[0].sum().round(2))
/// ((200, 33), 'float32', 300.0)
#[pyfunction]
#[pyo3(signature = (points, neighbors=150, scale="pcl", viewpoint=None, normals=None))]
pub(super) fn fpfh<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = whole)] neighbors: i64,
    scale: &str,
    viewpoint: Option<&Bound<'py, PyAny>>,
    normals: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let mut describe = feature_config(neighbors, viewpoint)?;
    describe.histogram = scale.parse().map_err(|error| argument_error("scale", error))?;
    if normals.is_some() {
        if let Some(at) = viewpoint {
            let rule = "orients estimated normals, but normals were given: leave one out";
            return Err(to_pyerr(Error::config("viewpoint", format_value(at), rule)));
        }
        describe.orientation = Orientation::Stored;
    }
    let cloud = CloudArg::read(points, "points", normals, BadRows::Refuse)?;
    let cloud = cloud.get();
    let described = run_interruptible(py, || {
        let (neighbors, normals) = neighbors_and_normals(cloud, &describe)?;
        descriptor::fpfh(cloud.points(), &normals.vectors, &neighbors, describe.histogram)
    })?;
    Ok(to_array2(py, BINS, described.into_values()))
}

/// The crate's defaults with what was given.
fn feature_config(neighbors: i64, viewpoint: Option<&Bound<'_, PyAny>>) -> PyResult<FeatureConfig> {
    let mut describe = FeatureConfig {
        neighborhood: Neighborhood::Nearest(parse_count("neighbors", neighbors)?),
        ..FeatureConfig::default()
    };
    if let Some(at) = viewpoint {
        describe.orientation = Orientation::Towards(parse_vec3(at, "viewpoint")?);
    }
    Ok(describe)
}

fn neighbors_and_normals(
    cloud: &PointCloud,
    describe: &FeatureConfig,
) -> Result<(Neighbors, Normals)> {
    let neighbors = Neighbors::find(cloud.points(), describe.neighborhood)?;
    let normals = normals::estimate(cloud, &neighbors, describe.orientation)?;
    Ok((neighbors, normals))
}
