//! Methods that are Python objects.

use pyo3::prelude::*;
use serde::Serialize;
use serde_json::Value;

use super::arrays::parse_pose;
use super::cloud::PyCloud;
use super::errors::settings_error;
use super::registration::NamedMethod;
use cfreg::cloud::{PointCloud, Transform};
use cfreg::error::{Error, Result};
use cfreg::method::{MethodRecord, Pipeline, Register, Registration, SolvedPose};
use cfreg::par;

/// A Python object with `register(source, target)`, which returns the pose, (4, 4); the pose is
/// evaluated, refined and verified as that of any method.
#[derive(Serialize)]
pub(super) struct CustomMethod {
    #[serde(skip)]
    object: Py<PyAny>,
    #[serde(flatten)]
    record: MethodRecord,
    /// Refines and verifies; its first method is not run.
    chain: Pipeline,
}

/// The record of a method with this name and these settings.
pub(super) fn parse_record((name, settings): &NamedMethod) -> PyResult<MethodRecord> {
    let settings: Value = serde_json::from_str(settings)
        .map_err(|error| settings_error(&format!("settings of {name}"), error))?;
    Ok(MethodRecord::new(name, &settings))
}

impl CustomMethod {
    pub(super) fn new(object: Py<PyAny>, named: &NamedMethod, chain: Pipeline) -> PyResult<Self> {
        Ok(CustomMethod { object, record: parse_record(named)?, chain })
    }

    fn pose(&self, source: &PointCloud, target: &PointCloud) -> Result<Transform> {
        let found = Python::try_attach(|py| {
            let clouds = [source, target].map(|cloud| PyCloud::from(cloud.clone()));
            let [source, target] = clouds.map(|cloud| Bound::new(py, cloud));
            let pose = self.object.bind(py).call_method1("register", (source?, target?))?;
            parse_pose(&pose, "the pose of the method")
        });
        match found {
            Some(pose) => {
                pose.map_err(|error| Error::config("method", &self.record.name, error.to_string()))
            }
            // The interpreter ends.
            None => Err(Error::Interrupted),
        }
    }
}

impl Register for CustomMethod {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        let pose = self.pose(source, target)?;
        par::checkpoint();
        let found = SolvedPose::new(pose, self.record.clone()).finish(source, target)?;
        self.chain.refine_from(found, source, target)
    }
}
