//! Registration of two clouds, and evaluation of a pose.
//!
//! Methods are passed as their name and their settings in JSON, and results are returned as JSON:
//! the package's classes are the same configurations and results under their Python names.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::arrays::{parse_pose, values_for_points};
use super::cloud_arg::CloudArg;
use super::custom_method::parse_record;
use super::errors::{SettingError, argument_error, optional_real, settings_error, to_pyerr};
use super::gil::{Pool, run_interruptible, run_interruptible_on};
use super::interop::BadRows;
use super::moments::index_pairs;
use super::panics::catch_panic;
use super::weights::{CustomWeights, Weights};
use cfreg::cloud::{PointCloud, Transform};
use cfreg::error::{Error, Result};
use cfreg::method::{Method, Pipeline, Register, Registration, SolvedPose};
use cfreg::pose::nearest_rotation;
use cfreg::verify;
use cfreg::weight::Normalization;

/// Name and settings, as a JSON object.
pub(super) type NamedMethod = (String, String);

/// What a registration may be given beside its method.
struct MethodInputs {
    weights: Option<(CustomWeights, Normalization)>,
    matches: Option<Vec<(u32, u32)>>,
    scores: Option<Vec<f32>>,
}

/// Descriptors of source and target, (N, D) each.
type DescriptorArrays<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>);

/// Settings of the verification, and of the points that are removed before; a JSON object.
#[derive(Deserialize)]
pub(super) struct RegistrationOptions {
    /// Whether poses without a verdict are verified: on, off or auto.
    verdict: String,
    keep_no_returns: bool,
}

impl RegistrationOptions {
    pub(super) fn read(json: &str) -> PyResult<Self> {
        serde_json::from_str(json).map_err(|error| SettingError::new_err(error.to_string()))
    }

    /// The chain with them; `bulk`: it registers many pairs.
    pub(super) fn apply_to(&self, mut chain: Pipeline, bulk: bool) -> PyResult<Pipeline> {
        if self.keep_no_returns {
            chain = chain.keep_no_returns();
        }
        let verified = match self.verdict.as_str() {
            "auto" => !bulk || chain.is_slower_than_verdict(),
            "on" => true,
            "off" => false,
            other => {
                let error = Error::config("verdict", other, "must be on, off or auto");
                return Err(to_pyerr(error));
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
#[pyo3(signature = (source, target, method, refinements, options, weights=None, normalize="none", initial=None, matches=None, scores=None, descriptors=None))]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
pub(super) fn register(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    method: NamedMethod,
    refinements: Vec<NamedMethod>,
    options: &str,
    weights: Option<&Bound<'_, PyAny>>,
    normalize: &str,
    initial: Option<&Bound<'_, PyAny>>,
    matches: Option<&Bound<'_, PyAny>>,
    scores: Option<&Bound<'_, PyAny>>,
    descriptors: Option<DescriptorArrays<'_>>,
) -> PyResult<String> {
    let (first, refinements) = parse_chain(&method, &refinements)?;
    let chain = Pipeline::new(first, refinements).map_err(to_pyerr)?;
    let mut chain = RegistrationOptions::read(options)?.apply_to(chain, false)?;
    if let Some(initial) = initial {
        chain = chain.with_initial(parse_pose(initial, "initial")?).map_err(to_pyerr)?;
    }
    let weights = match weights.map(|weights| Weights::read(weights, "weights")).transpose()? {
        Some(Weights::Custom(own)) => Some((own, normalize.parse().map_err(to_pyerr)?)),
        Some(Weights::Named(_)) | None => None,
    };
    let matches = matches.map(|matches| index_pairs(matches, "matches")).transpose()?;
    let count = matches.as_ref().map_or(0, Vec::len);
    let values = |scores| values_for_points(scores, "scores", count, "matches");
    let scores = scores.map(values).transpose()?;
    let scores = scores.map(|scores| scores.iter().map(|&score| score as f32).collect());
    let given = MethodInputs { weights, matches, scores };
    let cloud = |any, name| match given.matches {
        Some(_) => CloudArg::read_indexed(any, name),
        None => CloudArg::read(any, name, None, BadRows::Drop),
    };
    let (mut from, mut onto) = (cloud(source, "source")?, cloud(target, "target")?);
    if let Some((own, other)) = &descriptors {
        from = from.with_descriptors(source, own, "descriptors[0]")?;
        onto = onto.with_descriptors(target, other, "descriptors[1]")?;
    }
    let (source, target) = (from.get(), onto.get());
    let pool = given.weights.as_ref().map_or(Pool::Shared, |(own, _)| own.pool());
    let found = run_interruptible_on(py, pool, || {
        if let Some(matches) = &given.matches {
            let scores = given.scores.as_deref();
            return chain.register_correspondences(source, target, matches, scores);
        }
        match register_weighted(chain.first(), &given, source, target)? {
            Some(begun) => chain.refine_from(begun, source, target),
            None => chain.register(source, target),
        }
    });
    let found = match &given.weights {
        Some((own, _)) => own.reraise(found)?,
        None => found?,
    };
    to_json(&found)
}

/// The result of the first method by weights of one's own; `None` where there are none.
fn register_weighted(
    method: &Method,
    given: &MethodInputs,
    source: &PointCloud,
    target: &PointCloud,
) -> Result<Option<Registration>> {
    let found = match (method, given) {
        (Method::Cf(cf), MethodInputs { weights: Some((own, normalization)), .. }) => {
            cf.register_with(source, target, |connection| own.moments(connection, *normalization))
        }
        (Method::Cfk(cfk), MethodInputs { weights: Some((own, normalization)), .. }) => {
            cfk.register_with(source, target, |connection| own.moments(connection, *normalization))
        }
        _ => return Ok(None),
    };
    found.map(Some)
}

/// A pose that a method in Python found, evaluated, refined and verified; the answer as JSON.
#[pyfunction]
pub(super) fn register_pose(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
    transform: &Bound<'_, PyAny>,
    method: NamedMethod,
    refinements: Vec<NamedMethod>,
    options: &str,
) -> PyResult<String> {
    let transform = parse_pose(transform, "the pose of the method")?;
    let record = parse_record(&method)?;
    // The first method is the one that verifies: its own search is not made.
    let verifier = ("consensus".to_string(), "{}".to_string());
    let (first, refinements) = parse_chain(&verifier, &refinements)?;
    let chain = Pipeline::new(first, refinements).map_err(to_pyerr)?;
    let chain = RegistrationOptions::read(options)?.apply_to(chain, false)?;
    let source = CloudArg::read(source, "source", None, BadRows::Drop)?;
    let target = CloudArg::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    let found = run_interruptible(py, || {
        let solved = SolvedPose::new(transform, record);
        chain.refine_from(solved.finish(source, target)?, source, target)
    })?;
    to_json(&found)
}

/// Every setting of a method, as JSON.
#[pyfunction]
pub(super) fn settings(name: String, settings: String) -> PyResult<String> {
    let method = parse_method("method", &(name, settings))?;
    catch_panic(|| method.validate())?.map_err(to_pyerr)?;
    to_json(&method)
}

/// The first method and its refinements.
pub(super) fn parse_chain(
    method: &NamedMethod,
    refinements: &[NamedMethod],
) -> PyResult<(Method, Vec<Method>)> {
    let first = parse_method("method", method)?;
    let refinements = refinements.iter().map(|named| parse_method("refine", named));
    Ok((first, refinements.collect::<PyResult<_>>()?))
}

/// The method of that name with these settings, given as `argument`.
fn parse_method(argument: &str, (name, settings): &NamedMethod) -> PyResult<Method> {
    let method: Method = name.parse().map_err(|error| argument_error(argument, error))?;
    let settings: Map<String, Value> = serde_json::from_str(settings)
        .map_err(|error| settings_error(&format!("settings of {name}"), error))?;
    let settings = settings.iter().map(|(name, value)| (name.as_str(), value.clone()));
    catch_panic(|| method.with(settings))?.map_err(to_pyerr)
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
    let transform = parse_pose(transform, "transform")?;
    let truth = truth.map(|truth| parse_pose(truth, "truth")).transpose()?;
    let source = CloudArg::read(source, "source", None, BadRows::Drop)?;
    let target = CloudArg::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    let judgement = run_interruptible(py, || {
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
    let Method::Consensus(judge) = parse_method("settings", &("consensus".into(), settings))?
    else {
        return Err(PyRuntimeError::new_err("consensus is another method"));
    };
    let transform = parse_pose(transform, "transform")?;
    let source = CloudArg::read(source, "source", None, BadRows::Drop)?;
    let target = CloudArg::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    to_json(&run_interruptible(py, || judge.verify(source, target, &transform))?)
}

/// Return the vector, in radians, of the rotation nearest to a matrix (3, 3), and the distance of
/// the matrix from it.
#[pyfunction]
pub(super) fn rotation_vector(matrix: [[f64; 3]; 3]) -> PyResult<([f64; 3], f64)> {
    let nearest = catch_panic(|| nearest_rotation(&matrix))?;
    let (rotation, error) = nearest.map_err(|error| argument_error("prior.rotation", error))?;
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
    let decision = decision.map(str::parse).transpose().map_err(to_pyerr)?;
    let pose = Transform::from_matrix(transform);
    Ok(pose.is_ok_and(|pose| verify::is_usable(&pose, trusted, decision)))
}
