//! From two clouds to a pose.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::cloud;
use super::errors::{about, count, exception, released};
use super::features::describe;
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::method::{Cf, Method, Register};

/// Find the pose of the source in the frame of the target.
///
/// Describes every point by FPFH, connects all pairs, weighs each by the similarity of
/// its descriptors and solves once in closed form. Any rotation is found without an
/// initial guess where both clouds show the same surface; partial overlap pulls the pose
/// away, and the result says so.
///
/// Parameters
/// ----------
/// source_points, target_points : (N, 3) and (M, 3), float32 or float64, same unit unless
///     the scale is estimated; rows that are not finite are left out and counted
/// method : "cf", the full connection
/// neighbors : nearest points of a neighbourhood for normals and descriptors, the point
///     itself counted, at least 3
/// beta : squared bandwidth of the weights, 1e-12 to 1e12. None: that of the histogram,
///     100 for "pcl" and 400 for "open3d"
/// weights, normalize, threads : see moments
/// solver, scale : see solve
/// histogram : "pcl" or "open3d", see the scale of fpfh
/// viewpoint : of both clouds, each in its own frame, see estimate_normals
///
/// Returns
/// -------
/// dict, as `cfreg register --json` prints it; among others
///     transform : 4 rows of 4, T_target_source
///     trusted : whether nothing speaks against the pose
///     doubts : what does, a list of dicts
///     evaluation : fitness, inlier_rmse and more of the clouds under the pose
///     points : points dropped, used and described, of source and target
///     config : every setting that was in force
///
/// Raises
/// ------
/// RegistrationError : too few points, no connection with any weight, or clouds that do
///     not determine a rotation
/// ValueError : a shape or setting out of range
/// TypeError : not an array of float32 or float64
#[pyfunction]
#[pyo3(signature = (
    source_points, target_points, method="cf", neighbors=150, beta=None, weights="gaussian",
    normalize="none", solver="arun", scale="fixed", histogram="pcl", viewpoint=None, threads=0,
))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn register<'py>(
    py: Python<'py>,
    source_points: &Bound<'py, PyAny>,
    target_points: &Bound<'py, PyAny>,
    method: &str,
    neighbors: Option<i64>,
    beta: Option<f64>,
    weights: Option<&str>,
    normalize: Option<&str>,
    solver: Option<&str>,
    scale: Option<&str>,
    histogram: Option<&str>,
    viewpoint: Option<Vec3>,
    threads: Option<i64>,
) -> PyResult<Bound<'py, PyDict>> {
    let mut method: Method = method.parse().map_err(exception)?;
    match &mut method {
        Method::Cf(chosen) => {
            let mut config = cf(weights, beta, normalize, solver, scale, threads)?;
            config.describe = describe(neighbors, viewpoint)?;
            set(&mut config.describe.histogram, histogram).map_err(exception)?;
            *chosen = config;
        }
    }
    let source = cloud(source_points, "source_points")?;
    let target = cloud(target_points, "target_points")?;
    let registration = released(py, || method.register(&source, &target))?;
    let json = serde_json::to_string(&registration)
        .map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok(py.import("json")?.call_method1("loads", (json,))?.cast_into()?)
}

/// The crate's defaults with what was given.
pub(super) fn cf(
    weights: Option<&str>,
    beta: Option<f64>,
    normalize: Option<&str>,
    solver: Option<&str>,
    scale: Option<&str>,
    threads: Option<i64>,
) -> PyResult<Cf> {
    let mut cf = Cf { beta, ..Cf::default() };
    set(&mut cf.weights, weights).map_err(|error| about("weights", error))?;
    set(&mut cf.normalization, normalize).map_err(|error| about("normalize", error))?;
    set(&mut cf.solver, solver).map_err(|error| about("solver", error))?;
    set(&mut cf.scale, scale).map_err(|error| about("scale", error))?;
    cf.threads = count("threads", threads)?.unwrap_or(cf.threads);
    Ok(cf)
}

/// Replaces a setting by the one of that name, where one is given.
fn set<T: std::str::FromStr<Err = Error>>(setting: &mut T, name: Option<&str>) -> Result<()> {
    if let Some(name) = name {
        *setting = name.parse()?;
    }
    Ok(())
}
