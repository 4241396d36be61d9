//! From two clouds to a pose.

use pyo3::exceptions::{PyRuntimeError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;

use super::arrays::cloud;
use super::errors::{about, count, exception, released};
use crate::error::{Error, Result};
use crate::math::Vec3;
use crate::method::{Cf, Chain, Method, Register};
use crate::weight::Bandwidth;

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
/// method : "cf" (the full connection), "cf-multiscale" (with the sharpest weights), "cfk"
///     (of keypoints), "teaser"; from the pose in which the clouds lie: "icp", "icp-paper", "plane-icp", "gicp", "kc", "cpd", "dare"
/// neighbors : nearest points of a neighbourhood for normals and descriptors, the point
///     itself counted, at least 3; None, here and below: the method's default. Among the
///     settings below are normal_neighbors, and more_neighbors=["200:50", "400:150"] for
///     descriptors at more scales beside, from as many points and normals of as many
/// beta : squared bandwidth of the weights, 1e-12 to 1e12, "auto" or "auto:SHARE", see
///     moments. Default that of the histogram, 100 for "pcl" and 400 for "open3d"
/// weights, normalize : see moments
/// solver, scale : see solve
/// histogram : "pcl" or "open3d", see the scale of fpfh
/// viewpoint : of both clouds, each in its own frame, see estimate_normals
/// threads : 0 for all cores; never changes the result
/// refine : a method that starts from a pose, or several one after the other: "gicp",
///     ["icp", "gicp"], with their defaults
/// settings : any other setting of the method, by its name in `config` of the answer
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
    source_points, target_points, method="cf", neighbors=None, beta=None, weights=None,
    normalize=None, solver=None, scale=None, histogram=None, viewpoint=None, threads=None,
    refine=None, **settings,
))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn register<'py>(
    py: Python<'py>,
    source_points: &Bound<'py, PyAny>,
    target_points: &Bound<'py, PyAny>,
    method: &str,
    neighbors: Option<i64>,
    beta: Option<Beta>,
    weights: Option<&str>,
    normalize: Option<&str>,
    solver: Option<&str>,
    scale: Option<&str>,
    histogram: Option<&str>,
    viewpoint: Option<Vec3>,
    threads: Option<i64>,
    refine: Option<Names>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let given = [
        ("neighbors", count("neighbors", neighbors)?.map(Value::from)),
        ("beta", beta.map(Value::from)),
        ("weights", weights.map(Value::from)),
        ("normalize", normalize.map(Value::from)),
        ("solver", solver.map(Value::from)),
        ("scale", scale.map(Value::from)),
        ("histogram", histogram.map(Value::from)),
        ("viewpoint", viewpoint.map(|at| Value::from(at.map(number).to_vec()))),
        ("threads", count("threads", threads)?.map(Value::from)),
    ];
    let given = given.into_iter().filter_map(|(name, value)| value.map(|value| (name, value)));
    let others = settings.map_or(Ok(Value::Null), |settings| json(py, settings))?;
    let others = others.as_object().into_iter().flatten();
    let others = others.map(|(name, value)| (name.as_str(), value.clone()));
    let method: Method = method.parse().map_err(exception)?;
    let method = method.with(given.chain(others)).map_err(exception)?;
    let refine = match refine {
        Some(Names::One(name)) => vec![name],
        Some(Names::Many(names)) => names,
        None => Vec::new(),
    };
    let refinements = refine.iter().map(|name| name.parse()).collect::<Result<_>>();
    let chain = Chain::new(method, refinements.map_err(exception)?).map_err(exception)?;
    let source = cloud(source_points, "source_points")?;
    let target = cloud(target_points, "target_points")?;
    let registration = released(py, || chain.register(&source, &target))?;
    let json = serde_json::to_string(&registration)
        .map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok(py.import("json")?.call_method1("loads", (json,))?.cast_into()?)
}

/// Settings as JSON: whatever Python's own json module can write, and numpy's scalars.
pub(super) fn json(py: Python<'_>, settings: &Bound<'_, PyDict>) -> PyResult<Value> {
    let module = py.import("json")?;
    let options = PyDict::new(py);
    options.set_item("default", py.import("operator")?.call_method1("methodcaller", ("item",))?)?;
    let mut object = serde_json::Map::new();
    for (name, value) in settings {
        let name: String = name.extract()?;
        let text: String = module
            .call_method("dumps", (value,), Some(&options))
            .map_err(|error| PyTypeError::new_err(format!("{name}: {error}")))?
            .extract()?;
        // NaN and infinity, which JSON does not know, stay words: the setting refuses them.
        let value = serde_json::from_str(&text).unwrap_or(Value::String(text));
        object.insert(name, value);
    }
    Ok(Value::Object(object))
}

/// A bandwidth: a number, or how to find it.
#[derive(FromPyObject)]
pub(super) enum Beta {
    Number(f64),
    Word(String),
}

impl From<Beta> for Value {
    fn from(beta: Beta) -> Self {
        match beta {
            Beta::Number(beta) => number(beta),
            Beta::Word(text) => text.into(),
        }
    }
}

impl TryFrom<Beta> for Bandwidth {
    type Error = Error;
    fn try_from(beta: Beta) -> Result<Self> {
        match beta {
            Beta::Number(beta) => Ok(beta.into()),
            Beta::Word(text) => text.parse(),
        }
    }
}

/// One name, or several.
#[derive(FromPyObject)]
pub(super) enum Names {
    One(String),
    Many(Vec<String>),
}

/// JSON knows neither NaN nor infinity; as words the setting refuses them.
fn number(value: f64) -> Value {
    if value.is_finite() { value.into() } else { value.to_string().into() }
}

/// The crate's defaults with what was given.
pub(super) fn cf(
    weights: Option<&str>,
    beta: Option<Beta>,
    normalize: Option<&str>,
    solver: Option<&str>,
    scale: Option<&str>,
    threads: Option<i64>,
) -> PyResult<Cf> {
    let beta = beta.map(Bandwidth::try_from).transpose().map_err(|error| about("beta", error))?;
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
