//! The result of a registration.

use std::borrow::Cow;
use std::fmt;
use std::time::Instant;

use serde::de::{MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::termination::{IterationRecord, StopReason};
use super::{MethodRecord, WeightGraph};
use crate::cloud::{PointCloud, Transform};
use crate::moments::Moments;
use crate::normals::OrientedBy;
use crate::verify::{self, Evaluation, Verdict, Warning};

/// A pose, the data behind it, and its warnings.
///
/// Serialises to the object that `cfreg register --json` prints; `docs/reference/output.md` has its
/// fields.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Registration {
    /// `T_target_source`: maps source points into the target's frame.
    pub transform: Transform,
    /// The method and every setting in force; in JSON `method`, its name, and `config`.
    #[serde(flatten)]
    pub method: MethodRecord,
    /// Whether there are no warnings.
    pub trusted: bool,
    /// Warnings about the pose; empty if it can be trusted. In JSON each also has its text,
    /// `message`.
    #[serde(serialize_with = "with_messages")]
    pub doubts: Vec<Warning>,
    /// Whether to take the pose, with its probability, for methods that can tell and refinements
    /// that stay with their pose; what is not to be taken is in `doubts` too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Fit of the clouds under the pose.
    pub evaluation: Evaluation,
    /// √(Σw‖T p − q‖² / Σw): weighted root mean square over the connections, in the
    /// target's unit. On a full connection it is of the size of the cloud even for the
    /// perfect pose; it compares poses of one problem, not problems.
    #[serde(deserialize_with = "nan_from_null")]
    pub weighted_rms: f64,
    /// Squared bandwidth β of the kernel, for methods that weigh by descriptors: what
    /// `auto` came to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beta: Option<f64>,
    /// Second over first eigenvalue of the compatibility of the connections, 0 to 1, for methods with
    /// second-order weights ([`CfSpectral`](super::CfSpectral)): near 1, another pose has about as
    /// much support.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub eigenvalue_ratio: Option<f64>,
    /// Number of weighted connections.
    pub connections: u64,
    /// Effective number of connections (Σw)²/Σw², from 1 to `connections`.
    #[serde(deserialize_with = "nan_from_null")]
    pub effective_connections: f64,
    /// Singular values of the weighted cross-covariance relative to the clouds' weighted spread, in
    /// [0, 1], descending: how strongly, and in how many directions, the weights constrain the
    /// rotation.
    pub singular_values: [f64; 3],
    /// The moments of the last solve.
    pub moments: Moments,
    /// Number of solves, each with new weights; 1 for one-step methods.
    pub iterations: u32,
    /// The reason why the iterations ended.
    pub stop: StopReason,
    /// Every iteration, where the configuration asks for a trace; else empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub trace: Vec<IterationRecord>,
    /// Points of both clouds, from file to solve.
    pub points: PointCounts,
    /// Wall-clock seconds of each stage, in the order in which they ran, and in total.
    pub time_s: Timings,
    /// How far from the best the rotation can be, where the configuration asks for it and
    /// the method can tell ([`Teaser::certify`](super::Teaser::certify)).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate: Option<Certificate>,
    /// The registration that was refined, when this is a refinement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refined_from: Option<Box<Registration>>,
    /// The weights or correspondences under the pose, where the pipeline was asked for them
    /// ([`Pipeline::with_weight_graph`](super::Pipeline::with_weight_graph)); not in JSON.
    #[serde(skip)]
    pub weight_graph: Option<Box<WeightGraph>>,
}

impl Registration {
    /// Returns the first registration, before all refinements.
    pub fn first(&self) -> &Registration {
        self.refined_from.as_deref().map_or(self, Registration::first)
    }

    /// Returns the names of the methods in the order in which they ran, `+` between them.
    pub fn method_names(&self) -> String {
        match &self.refined_from {
            Some(before) => format!("{}+{}", before.method_names(), self.method.name),
            None => self.method.name.clone(),
        }
    }

    /// Returns whether the pose may be used: it has no warnings, its verdict, if any, accepts it,
    /// and it is finite and proper ([`verify::is_usable`]).
    pub fn is_usable(&self) -> bool {
        let decision = self.verdict.as_ref().map(|verdict| verdict.decision);
        verify::is_usable(&self.transform, self.trusted, decision)
    }

    /// Adds a verdict on the pose ([`Consensus::verify`](super::Consensus::verify)). It is stricter
    /// than the fitness warnings and replaces them.
    pub fn with_verdict(mut self, verdict: Verdict) -> Self {
        self.doubts.retain(|doubt| {
            !matches!(doubt, Warning::LowFitness { .. } | Warning::HighChanceFitness { .. })
        });
        // First, as the strictest.
        self.doubts.splice(0..0, Warning::from_verdict(&verdict));
        self.trusted = self.doubts.is_empty();
        Registration { verdict: Some(verdict), ..self }
    }

    /// The registration with a verdict of a search. Where wrong rotations fit as well, the pose is
    /// ambiguous, unless channels or a prior `distinguish` it from them.
    pub(super) fn with_search_verdict(self, verdict: Verdict, distinguish: bool) -> Self {
        let found = self.evaluation.chance_fitness;
        let most = verify::MAX_CHANCE_FITNESS_VERIFIED;
        if found <= most || distinguish {
            return self.with_verdict(verdict);
        }
        let mut judged = self.with_verdict(verdict.with_high_chance_fitness(found));
        judged.doubts.push(Warning::HighChanceFitness { found, most });
        judged.trusted = false;
        judged
    }
}

/// Serialises warnings, each with its message.
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

/// How far from the best the rotation can be.
///
/// It speaks of truncated least squares on at most 100 differences between the matches
/// kept: all of them among up to 14 matches, of each match and its next ones up to 100,
/// and of an even choice of 100 beyond. The answer itself uses more differences; hence two
/// numbers, both small where all is well. That the largest set of consistent matches is
/// the right one is not part of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Certificate {
    /// Share of its cost that any other rotation could save, at most: from 0, the best
    /// there is, to 1, nothing is known. Costs below a millionth of the bound squared a
    /// difference count as that much.
    pub gap: f64,
    /// Angle between that rotation and the answer's, degrees.
    pub rotation_deg: f64,
    /// Number of differences K.
    pub differences: usize,
    /// Rounds of the splitting.
    pub iterations: u32,
}

/// Points of the two clouds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PointCounts {
    /// Counts of the source.
    pub source: CloudCounts,
    /// Counts of the target.
    pub target: CloudCounts,
}

/// What became of the points of a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct CloudCounts {
    /// Points with a NaN or infinite coordinate, left out when the cloud was made.
    pub dropped: usize,
    /// Rows that marked measurements without a return, and were left out
    /// ([`filter::find_no_returns`](crate::filter::find_no_returns)).
    pub no_returns: usize,
    /// Points passed to the method.
    pub used: usize,
    /// Points found by the keypoint detector; `null` if there is none.
    pub keypoints: Option<usize>,
    /// Points with a defined descriptor, which were connected; all for methods without descriptors.
    pub described: usize,
    /// Number of neighbours for descriptors: the configured k, or the size of the cloud if that is
    /// smaller. `null` for neighbourhoods by radius.
    pub neighbors: Option<usize>,
    /// Source of the orientation of normals; `null` for methods without normals.
    pub oriented_by: Option<OrientedBy>,
}

impl PointCounts {
    /// Returns the counts of two clouds whose points are all connected.
    pub(super) fn from_clouds(source: &PointCloud, target: &PointCloud) -> Self {
        let [source, target] = [source, target].map(CloudCounts::from_cloud);
        PointCounts { source, target }
    }
}

impl CloudCounts {
    /// Returns the counts of a cloud whose points are all connected.
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
pub struct Timings(pub Vec<(Cow<'static, str>, f64)>);

impl Timings {
    /// Runs `work` and adds its seconds to those of `stage`.
    pub fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let value = work();
        self.add(stage, start.elapsed().as_secs_f64());
        value
    }

    /// Adds seconds under `stage`.
    pub fn add(&mut self, stage: impl Into<Cow<'static, str>>, seconds: f64) {
        let stage = stage.into();
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

impl<'de> Deserialize<'de> for Timings {
    /// From a map of seconds by stage; the order is kept, `total` follows from the others.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct Stages;

        impl<'de> Visitor<'de> for Stages {
            type Value = Timings;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("seconds by stage")
            }

            fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<Timings, M::Error> {
                let mut stages: Vec<(Cow<'static, str>, f64)> = Vec::new();
                while let Some((stage, seconds)) = map.next_entry::<String, f64>()? {
                    stages.push((stage.into(), seconds));
                }
                stages.retain(|(stage, _)| stage != "total");
                Ok(Timings(stages))
            }
        }

        deserializer.deserialize_map(Stages)
    }
}

/// A number that JSON has as `null` where it is none.
fn nan_from_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
