//! The data of a registration in a report: the object that `cfreg register --json` prints.

use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde_json::Value;

use crate::cloud::{Transform, ViewpointSource};
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io;
use crate::math::Vec3;
use crate::method::Method;

/// The object, without the fields that no report shows.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Facts {
    pub(super) transform: Transform,
    pub(super) method: String,
    pub(super) trusted: bool,
    pub(super) doubts: Vec<Told>,
    pub(super) verdict: Option<SavedVerdict>,
    pub(super) evaluation: Option<Fit>,
    pub(super) connections: Option<u64>,
    pub(super) effective_connections: Option<f64>,
    pub(super) iterations: Option<u64>,
    pub(super) stop: Option<String>,
    pub(super) points: Option<Ends>,
    #[serde(default)]
    pub(super) time_s: Stages,
    /// Shown unchanged.
    #[serde(default)]
    pub(super) config: Value,
    pub(super) refined_from: Option<Box<Facts>>,
    /// Inputs of the command, if the result came from one.
    pub(super) source: Option<String>,
    pub(super) target: Option<String>,
    #[serde(default)]
    pub(super) thinning: Given,
    pub(super) viewpoints: Option<ViewpointSource>,
    pub(super) command: Option<String>,
}

/// A warning.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Told {
    pub(super) message: String,
}

/// A verdict.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct SavedVerdict {
    pub(super) decision: String,
    pub(super) probability: f64,
    pub(super) reasons: Vec<String>,
    pub(super) overlap: f64,
    pub(super) runner_up: Option<Other>,
    pub(super) covariance: Option<Spread>,
    #[serde(default)]
    pub(super) other_scale: Option<f64>,
    #[serde(default)]
    pub(super) mirrored: bool,
}

/// An alternative pose.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Other {
    pub(super) transform: Transform,
    pub(super) probability: f64,
}

/// Uncertainty of the pose.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Spread {
    pub(super) matrix: [[f64; 6]; 6],
    pub(super) center: Vec3,
    pub(super) undetermined: Vec<Free>,
}

/// An unobservable motion.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Free {
    pub(super) rotation: Vec3,
    pub(super) translation: Vec3,
}

/// Fit of the clouds.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Fit {
    pub(super) fitness: f64,
    pub(super) target_fitness: f64,
    pub(super) inlier_rmse: Option<f64>,
    pub(super) max_distance: f64,
    pub(super) agreement: f64,
}

/// Points of both clouds.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Ends {
    pub(super) source: Counted,
    pub(super) target: Counted,
}

/// Counts of a cloud's points.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Counted {
    #[serde(default)]
    pub(super) dropped: usize,
    #[serde(default)]
    pub(super) no_returns: usize,
    pub(super) used: usize,
    pub(super) keypoints: Option<usize>,
    pub(super) described: Option<usize>,
    pub(super) oriented_by: Option<String>,
}

/// The downsampling of a command.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
pub(super) struct Given {
    voxel: Option<f64>,
    sample: Option<usize>,
    #[serde(default)]
    seed: u64,
}

/// Seconds by stage, in the order in which they ran.
#[derive(Debug, Clone, Default)]
pub(super) struct Stages(pub(super) Vec<(String, f64)>);

impl Facts {
    /// Creates facts from these values alone.
    pub(super) fn bare(pose: Transform, method: &str, trusted: bool, doubts: Vec<Told>) -> Facts {
        Facts {
            transform: pose,
            method: method.into(),
            trusted,
            doubts,
            verdict: None,
            evaluation: None,
            connections: None,
            effective_connections: None,
            iterations: None,
            stop: None,
            points: None,
            time_s: Stages::default(),
            config: Value::Null,
            refined_from: None,
            source: None,
            target: None,
            thinning: Given::default(),
            viewpoints: None,
            command: None,
        }
    }

    /// Parses one JSON object.
    ///
    /// # Errors
    /// [`Error::Parse`] for an invalid object, with its line; `path` names the text in the error.
    pub(super) fn read(json: &str, path: &std::path::Path) -> Result<Facts> {
        serde_json::from_str(json).map_err(|error| {
            let what = format!("is not what `cfreg register --json` prints: {error}");
            let what = io::truncate_message(&what);
            Error::parse(path, Some(error.line()), what)
        })
    }

    /// Returns the first registration, before all refinements.
    pub(super) fn first(&self) -> &Facts {
        self.refined_from.as_deref().map_or(self, Facts::first)
    }

    /// Returns the first method; `None` if its settings are missing.
    pub(super) fn method(&self) -> Option<Method> {
        serde_json::from_value(self.first().config.clone()).ok()
    }

    /// Returns the names of the methods in order, `+` between them.
    pub(super) fn chain(&self) -> String {
        match &self.refined_from {
            Some(before) => format!("{}+{}", before.chain(), self.method),
            None => self.method.clone(),
        }
    }

    /// Returns the downsampling before registration; a voxel size that is a setting of the method
    /// itself does not count.
    pub(super) fn thinning(&self) -> Downsampling {
        let Given { voxel, sample, seed } = self.thinning;
        let own = self.first().method == "consensus";
        Downsampling { voxel: voxel.filter(|_| !own), sample, seed }
    }
}

impl<'de> Deserialize<'de> for Stages {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Stages;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("seconds by stage")
            }

            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Stages, M::Error> {
                let mut stages = Vec::new();
                while let Some(stage) = map.next_entry()? {
                    stages.push(stage);
                }
                stages.retain(|(name, _)| name != "total");
                Ok(Stages(stages))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}
