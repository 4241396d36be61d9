//! What a registration returns.

use std::time::Instant;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use super::Method;
use crate::cloud::Transform;
use crate::moments::Moments;
use crate::normals::OrientedBy;
use crate::quality::{Doubt, Evaluation};

/// A pose, what it rests on, and what speaks against it.
///
/// Serialises to the object that `cfreg register --json` prints; the
/// README has its fields.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Registration {
    /// `T_target_source`: maps source points into the target's frame.
    pub transform: Transform,
    /// Name of the method.
    pub method: &'static str,
    /// Whether there is no ground for doubt.
    pub trusted: bool,
    /// Grounds to doubt the pose; empty when it may be trusted.
    pub doubts: Vec<Doubt>,
    /// How the clouds lie on each other under the pose.
    pub evaluation: Evaluation,
    /// √(Σw‖T p − q‖² / Σw): weighted root mean square over the connections, in the
    /// target's unit. On a full connection it is of the size of the cloud even for the
    /// perfect pose; it compares poses of one problem, not problems.
    pub weighted_rms: f64,
    /// Number of connections that were weighed.
    pub connections: u64,
    /// Effective number of connections (Σw)²/Σw², from 1 to `connections`.
    pub effective_connections: f64,
    /// Singular values of the weighted cross-covariance relative to the clouds' weighted
    /// spread, in [0, 1], descending: how strongly, and in how many directions, the
    /// weights tie the clouds together.
    pub singular_values: [f64; 3],
    /// The moments that were solved.
    pub moments: Moments,
    /// Points of both clouds, from file to solve.
    pub points: PointCounts,
    /// Wall-clock seconds of each stage, in the order in which they ran, and in total.
    pub time_s: Timings,
    /// The method and every setting that was in force, defaults filled in.
    pub config: Method,
}

/// Points of the two clouds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PointCounts {
    /// Of the source.
    pub source: Counts,
    /// Of the target.
    pub target: Counts,
}

/// What became of the points of a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Points with a NaN or infinite coordinate, left out when the cloud was made.
    pub dropped: usize,
    /// Points handed to the method.
    pub used: usize,
    /// Points whose descriptor is defined: those that were connected.
    pub described: usize,
    /// Points a neighbourhood takes for descriptors: the configured k, or the size of the
    /// cloud if that is smaller. `null` for neighbourhoods by radius.
    pub neighbors: Option<usize>,
    /// What oriented the normals.
    pub oriented_by: OrientedBy,
}

/// Names and seconds of stages, in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timings(pub Vec<(&'static str, f64)>);

impl Timings {
    /// Runs `work` and adds its seconds under `stage` (to those already there).
    pub fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        self.add(stage, start.elapsed().as_secs_f64());
        value
    }

    /// Adds seconds under `stage`.
    pub fn add(&mut self, stage: &'static str, seconds: f64) {
        match self.0.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += seconds,
            None => self.0.push((stage, seconds)),
        }
    }

    /// Seconds of all stages together.
    pub fn total(&self) -> f64 {
        self.0.iter().map(|(_, seconds)| seconds).sum()
    }
}

impl Serialize for Timings {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len() + 1))?;
        for (stage, seconds) in &self.0 {
            map.serialize_entry(stage, seconds)?;
        }
        map.serialize_entry("total", &self.total())?;
        map.end()
    }
}
