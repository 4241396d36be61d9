//! Registration of two clouds, and evaluation of a pose.
//!
//! Methods are passed as their name and their settings in JSON, and results are returned as JSON:
//! the package's classes are the same configurations and results under their Python names.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::arrays::pose;
use super::cloud_arg::AnyCloud;
use super::errors::{SettingError, about, exception, optional_real, refused};
use super::gil::{Pool, released, released_on};
use super::interop::BadRows;
use super::moments::index_pairs;
use super::panics::caught;
use super::weights::{OwnWeights, Weights};
use cfreg::cloud::{PointCloud, Transform};
use cfreg::error::{Error, Result};
use cfreg::method::{Method, Pipeline, Register, Registration};
use cfreg::pose::nearest_rotation;
use cfreg::verify;
use cfreg::weight::Normalization;

/// Name and settings, as a JSON object.
pub(super) type Named = (String, String);

/// Optional inputs of a registration beside its method.
struct Given {
    weights: Option<(OwnWeights, Normalization)>,
    matches: Option<Vec<(u32, u32)>>,
}

/// Settings of the verification, and of the points that are removed before; a JSON object.
#[derive(Deserialize)]
pub(super) struct Options {
    /// Verification of poses without a verdict: on, off or auto.
    verdict: String,
    keep_no_returns: bool,
}

impl Options {
    pub(super) fn read(json: &str) -> PyResult<Self> {
        serde_json::from_str(json).map_err(|error| SettingError::new_err(error.to_string()))
    }

    /// Adds these settings to a pipeline; `bulk` means that it registers many pairs.
    pub(super) fn put(&self, mut chain: Pipeline, bulk: bool) -> PyResult<Pipeline> {
        if self.keep_no_returns {
            chain = chain.keep_no_returns();
        }
        let verified = match self.verdict.as_str() {
            "auto" => !bulk || chain.is_slower_than_verdict(),
            "on" => true,
            "off" => false,
            other => {
                let error = Error::config("verdict", other, "must be on, off or auto");
                return Err(exception(error));
            }
        };
        let judge = chain.first().verifier();
        Ok(if verified { chain.with_verification(judge) } else { chain })
    }

    pub(super) fn keep_no_returns(&self) -> bool {
        self.keep_no_returns
    }
}

/// Estimate the pose of the source in the frame of the target; returns the result as JSON.
#[pyfunction]
#[pyo3(signature = (source, target, method, refinements, options, weights=None, normalize="none", initial=None, matches=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn register(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    method: Named,
    refinements: Vec<Named>,
    options: &str,
    weights: Option<&Bound<'_, PyAny>>,
    normalize: &str,
    initial: Option<&Bound<'_, PyAny>>,
    matches: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (first, refinements) = chain_of(&method, &refinements)?;
    let chain = Pipeline::new(first, refinements).map_err(exception)?;
    let mut chain = Options::read(options)?.put(chain, false)?;
    if let Some(initial) = initial {
        chain = chain.with_initial(pose(initial, "initial")?).map_err(exception)?;
    }
    let weights = match weights.map(|weights| Weights::read(weights, "weights")).transpose()? {
        Some(Weights::Own(own)) => Some((own, normalize.parse().map_err(exception)?)),
        Some(Weights::Named(_)) | None => None,
    };
    let given = Given {
        weights,
        matches: matches.map(|matches| index_pairs(matches, "matches")).transpose()?,
    };
    let cloud = |any, name| match given.matches {
        Some(_) => AnyCloud::by_rows(any, name),
        None => AnyCloud::read(any, name, None, BadRows::Drop),
    };
    let (source, target) = (cloud(source, "source")?, cloud(target, "target")?);
    let (source, target) = (source.get(), target.get());
    let pool = given.weights.as_ref().map_or(Pool::Shared, |(own, _)| own.pool());
    let found = released_on(py, pool, || match begin(chain.first(), &given, source, target)? {
        Some(begun) => chain.refine_from(begun, source, target),
        None => chain.register(source, target),
    });
    let found = match &given.weights {
        Some((own, _)) => own.blamed(found)?,
        None => found?,
    };
    to_json(&found)
}

/// Runs the first method with the user's weights or correspondences; `None` if there are none.
fn begin(
    method: &Method,
    given: &Given,
    source: &PointCloud,
    target: &PointCloud,
) -> Result<Option<Registration>> {
    let found = match (method, given) {
        (Method::Cf(cf), Given { weights: Some((own, normalization)), .. }) => {
            cf.register_with(source, target, |connection| own.moments(connection, *normalization))
        }
        (Method::Cfk(cfk), Given { weights: Some((own, normalization)), .. }) => {
            cfk.register_with(source, target, |connection| own.moments(connection, *normalization))
        }
        (Method::Teaser(teaser), Given { matches: Some(matches), .. }) => {
            teaser.register_correspondences(source, target, matches)
        }
        _ => return Ok(None),
    };
    found.map(Some)
}

/// Return every setting of a method, as JSON.
#[pyfunction]
pub(super) fn settings(name: String, settings: String) -> PyResult<String> {
    let method = method_of("method", &(name, settings))?;
    caught(|| method.validate())?.map_err(exception)?;
    to_json(&method)
}

/// Returns the first method and its refinements.
pub(super) fn chain_of(method: &Named, refinements: &[Named]) -> PyResult<(Method, Vec<Method>)> {
    let first = method_of("method", method)?;
    let refinements = refinements.iter().map(|named| method_of("refine", named));
    Ok((first, refinements.collect::<PyResult<_>>()?))
}

/// Creates the method of that name with these settings, which were passed as `argument`.
fn method_of(argument: &str, (name, settings): &Named) -> PyResult<Method> {
    let method: Method = name.parse().map_err(|error| about(argument, error))?;
    let settings: Map<String, Value> = serde_json::from_str(settings)
        .map_err(|error| refused(&format!("settings of {name}"), error))?;
    let settings = settings.iter().map(|(name, value)| (name.as_str(), value.clone()));
    caught(|| method.with(settings))?.map_err(exception)
}

/// Evaluate how well the source fits the target under a pose, and its error to the truth; JSON.
#[pyfunction]
#[pyo3(signature = (source, target, transform, max_distance=None, truth=None))]
pub(super) fn evaluate(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    transform: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = optional_real)] max_distance: Option<f64>,
    truth: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let transform = pose(transform, "transform")?;
    let truth = truth.map(|truth| pose(truth, "truth")).transpose()?;
    let source = AnyCloud::read(source, "source", None, BadRows::Drop)?;
    let target = AnyCloud::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    let judgement = released(py, || {
        verify::evaluate_with_truth(source, target, &transform, max_distance, truth.as_ref())
    })?;
    to_json(&judgement)
}

/// Return the verdict on a pose from any program, with these settings of consensus; JSON.
#[pyfunction]
pub(super) fn judge(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    transform: &Bound<'_, PyAny>,
    settings: String,
) -> PyResult<String> {
    let Method::Consensus(judge) = method_of("settings", &("consensus".into(), settings))? else {
        return Err(PyRuntimeError::new_err("consensus is another method"));
    };
    let transform = pose(transform, "transform")?;
    let source = AnyCloud::read(source, "source", None, BadRows::Drop)?;
    let target = AnyCloud::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    to_json(&released(py, || judge.verify(source, target, &transform))?)
}

/// Return the vector, in radians, of the rotation nearest to a matrix (3, 3), and the distance of
/// the matrix from it.
#[pyfunction]
pub(super) fn rotation_vector(matrix: [[f64; 3]; 3]) -> PyResult<([f64; 3], f64)> {
    let nearest = caught(|| nearest_rotation(&matrix))?;
    let (rotation, error) = nearest.map_err(|error| about("prior.rotation", error))?;
    Ok((Transform::rigid(rotation, [0.0; 3]).rotation_vector(), error))
}

pub(super) fn to_json(value: &impl Serialize) -> PyResult<String> {
    serde_json::to_string(value).map_err(|error| PyRuntimeError::new_err(error.to_string()))
}

/// Return whether a pose may be used: `verify::is_usable`. False for an invalid pose.
#[pyfunction]
#[pyo3(signature = (transform, trusted, decision=None))]
pub(super) fn is_usable(
    transform: [[f64; 4]; 4],
    trusted: bool,
    decision: Option<&str>,
) -> PyResult<bool> {
    let decision = decision.map(str::parse).transpose().map_err(exception)?;
    let pose = Transform::from_matrix(transform);
    Ok(pose.is_ok_and(|pose| verify::is_usable(&pose, trusted, decision)))
}
