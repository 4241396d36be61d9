//! What a registration returns.

use std::time::Instant;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use super::termination::{IterationRecord, StopReason};
use super::{Certificate, Consensus, MethodRecord};
use crate::cloud::{PointCloud, Transform};
use crate::moments::Moments;
use crate::normals::OrientedBy;
use crate::verify::{self, Evaluation, Verdict, Warning};

/// A pose, what it rests on, and what speaks against it.
///
/// Serialises to the object that `cfreg register --json` prints; `docs/reference/output.md` has its
/// fields.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Registration {
    /// `T_target_source`: maps source points into the target's frame.
    pub transform: Transform,
    /// The method and every setting that was in force; in JSON `method`, its name, and `config`.
    #[serde(flatten)]
    pub method: MethodRecord,
    /// Whether there is no ground for doubt.
    pub trusted: bool,
    /// Grounds to doubt the pose; empty when it may be trusted. In JSON each has its words,
    /// `message`, too.
    #[serde(serialize_with = "with_messages")]
    pub doubts: Vec<Warning>,
    /// Whether to take the pose, with its probability, for methods that can tell and refinements
    /// that stay with their pose; what is not to be taken is in `doubts` too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// How the clouds lie on each other under the pose.
    pub evaluation: Evaluation,
    /// √(Σw‖T p − q‖² / Σw): weighted root mean square over the connections, in the
    /// target's unit. On a full connection it is of the size of the cloud even for the
    /// perfect pose; it compares poses of one problem, not problems.
    pub weighted_rms: f64,
    /// Squared bandwidth β of the kernel, for methods that weigh by descriptors: what
    /// `auto` came to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beta: Option<f64>,
    /// Number of connections that were weighed.
    pub connections: u64,
    /// Effective number of connections (Σw)²/Σw², from 1 to `connections`.
    pub effective_connections: f64,
    /// Singular values of the weighted cross-covariance relative to the clouds' weighted
    /// spread, in [0, 1], descending: how strongly, and in how many directions, the
    /// weights tie the clouds together.
    pub singular_values: [f64; 3],
    /// The moments that were solved last.
    pub moments: Moments,
    /// How often weights were made and solved; 1 for the methods of one step.
    pub iterations: u32,
    /// What ended the iterations.
    pub stop: StopReason,
    /// Every iteration, where the configuration asks for a trace; else empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub trace: Vec<IterationRecord>,
    /// Points of both clouds, from file to solve.
    pub points: PointCounts,
    /// Wall-clock seconds of each stage, in the order in which they ran, and in total.
    pub time_s: Timings,
    /// How far from the best the rotation can be, where the configuration asks for it and
    /// the method can tell ([`Teaser::certify`](super::Teaser::certify)).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub certificate: Option<Certificate>,
    /// The registration that was refined, when this is a refinement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refined_from: Option<Box<Registration>>,
}

impl Registration {
    /// Whether the pose may be used: nothing speaks against it, a verdict accepts it where there is
    /// one, and it is finite and proper ([`verify::is_usable`]).
    pub fn is_usable(&self) -> bool {
        let decision = self.verdict.as_ref().map(|verdict| verdict.decision);
        verify::is_usable(&self.transform, self.trusted, decision)
    }

    /// With a verdict on its pose ([`Consensus::verify`](super::Consensus::verify)), which looks
    /// closer than agreement and chance and replaces them as grounds for doubt.
    pub fn with_verdict(mut self, verdict: Verdict) -> Self {
        self.doubts.retain(|doubt| {
            !matches!(doubt, Warning::LowFitness { .. } | Warning::HighChanceFitness { .. })
        });
        // First, as it looks closest.
        self.doubts.splice(0..0, Warning::from_verdict(&verdict));
        self.trusted = self.doubts.is_empty();
        Registration { verdict: Some(verdict), ..self }
    }

    /// The same with a verdict that `judge` gave. Where wrong rotations fit as well, and neither
    /// channels nor a prior tell them apart, the pose is ambiguous.
    pub(super) fn with_verdict_from(self, verdict: Verdict, judge: &Consensus) -> Self {
        let found = self.evaluation.chance_fitness;
        let most = verify::MAX_CHANCE_FITNESS_VERIFIED;
        if found <= most || !judge.channels.is_empty() || !judge.prior.is_none() {
            return self.with_verdict(verdict);
        }
        let mut judged = self.with_verdict(verdict.with_high_chance_fitness(found));
        judged.doubts.push(Warning::HighChanceFitness { found, most });
        judged.trusted = false;
        judged
    }
}

/// Doubts, each with what it says.
fn with_messages<S: Serializer>(
    doubts: &[Warning],
    serializer: S,
) -> std::result::Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct WarningWithMessage<'a> {
        #[serde(flatten)]
        doubt: &'a Warning,
        message: String,
    }
    serializer.collect_seq(
        doubts.iter().map(|doubt| WarningWithMessage { doubt, message: doubt.to_string() }),
    )
}

/// Points of the two clouds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PointCounts {
    /// Of the source.
    pub source: CloudCounts,
    /// Of the target.
    pub target: CloudCounts,
}

/// What became of the points of a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct CloudCounts {
    /// Points with a NaN or infinite coordinate, left out when the cloud was made.
    pub dropped: usize,
    /// Rows that marked measurements without a return, and were left out
    /// ([`filter::find_no_returns`](crate::filter::find_no_returns)).
    pub no_returns: usize,
    /// Points handed to the method.
    pub used: usize,
    /// Points found by the keypoint detector; `null` where none was asked for.
    pub keypoints: Option<usize>,
    /// Points whose descriptor is defined, and that were connected; all for methods
    /// that use none.
    pub described: usize,
    /// Points a neighbourhood takes for descriptors: the configured k, or the size of the
    /// cloud if that is smaller. `null` for neighbourhoods by radius.
    pub neighbors: Option<usize>,
    /// What oriented the normals; `null` for methods that use none.
    pub oriented_by: Option<OrientedBy>,
}

impl CloudCounts {
    /// Of a cloud whose points are connected as they are.
    pub(super) fn from_cloud(cloud: &PointCloud) -> Self {
        CloudCounts {
            dropped: cloud.dropped(),
            no_returns: cloud.no_returns(),
            used: cloud.len(),
            keypoints: None,
            described: cloud.len(),
            neighbors: None,
            oriented_by: None,
        }
    }
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
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len() + 1))?;
        for (stage, seconds) in &self.0 {
            map.serialize_entry(stage, seconds)?;
        }
        map.serialize_entry("total", &self.total())?;
        map.end()
    }
}
