//! CF-spectral: the full connection, made sparse, weighted to the second order and solved once.

mod connections;

use serde::{Deserialize, Deserializer, Serialize};

pub(super) use self::connections::SpectralConnections;
use super::features::FeatureConfig;
use super::registration::{PointCounts, Registration, Timings};
use super::{Cached, MethodRecord, Register, SolvedPose, StopReason};
use crate::cloud::PointCloud;
use crate::descriptor::HistogramScale;
use crate::error::{Error, Result};
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::search::Neighborhood;
use crate::verify::FitnessRule;
use crate::weight::{Bandwidth, Compatibility, MAX_CONNECTIONS, WeightScheme};

/// One closed-form solve with second-order weights, for clouds that overlap in part.
///
/// The full connection of the paper ([`Cf`](super::Cf)) fails where half of the points have no
/// counterpart: each of them adds weight to wrong connections. Here the strongest connections of the
/// dual softmax are kept, and each is weighted by the others that are compatible with it
/// ([`Compatibility`]): the leading eigenvector of the second-order compatibility, squared. There are
/// no hypotheses, no sampling and no iteration over poses: weights are made once, and the
/// pose is the closed form of their moments.
///
/// Clouds of more than [`CfSpectral::POINTS`] points are downsampled to one [`voxel`](Self::voxel)
/// size first. All lengths follow from it, so that no setting depends on the unit.
///
/// Normals point towards the viewpoint of a cloud; if it names none, towards the origin of its frame,
/// if that is a plausible place of the sensor, else towards a place from which nearly nothing is
/// hidden.
///
/// Weights of points ([`PointCloud::with_weights`]) multiply the weights of their connections;
/// points of any weight are used for the descriptors of their neighbours.
///
/// ```
/// use cfreg::method::{CfSpectral, Register};
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(1000, 1)?, boulder().sample(1000, 2)?);
/// let registration = CfSpectral::default().register(&source, &target)?;
/// assert!(registration.transform.angle().to_degrees() < 5.0);
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CfSpectral {
    /// Settings of the descriptors. Default other than those of [`Cf`](super::Cf), chosen by hand: 100
    /// nearest points, normals of 20, Open3D's histograms, as in [`Consensus`](super::Consensus).
    #[serde(flatten)]
    pub features: FeatureConfig,
    /// Voxel size to which both clouds are downsampled, and the unit of all lengths, above 0, in the
    /// unit of the coordinates. Default [`filter::voxel_size_for`](crate::filter::voxel_size_for) of [`POINTS`](Self::POINTS)
    /// points, the larger of both clouds; if neither has more points, all are used.
    pub voxel: Option<f64>,
    /// Kernel of the squared descriptor distance; default Gaussian.
    pub weights: WeightScheme,
    /// Squared bandwidth β of the kernel, as in [`Cf::beta`](super::Cf::beta); default `auto`.
    pub beta: Bandwidth,
    /// Number of connections that are kept, the strongest, 3 to [`MAX_CONNECTIONS`]; default
    /// 2000. The time of their compatibility grows with the square.
    pub connections: usize,
    /// Compatibility of the connections.
    pub compatibility: Compatibility,
    /// Closed-form solver; all give the same pose.
    pub solver: Solver,
    /// Constraints on the pose ([`Prior`]), except on its scale; default none.
    pub prior: Prior,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for CfSpectral {
    fn default() -> Self {
        CfSpectral {
            features: FeatureConfig {
                neighborhood: Neighborhood::Nearest(100),
                normal_neighborhood: Some(Neighborhood::Nearest(20)),
                histogram: HistogramScale::Open3d,
                ..FeatureConfig::default()
            },
            voxel: None,
            weights: WeightScheme::Gaussian,
            beta: Bandwidth::Auto(Bandwidth::DEFAULT_SHARE),
            connections: 2000,
            compatibility: Compatibility::default(),
            solver: Solver::default(),
            prior: Prior::default(),
            threads: 0,
        }
    }
}

impl<'de> Deserialize<'de> for CfSpectral {
    /// Settings that are missing have their defaults, also those of the descriptors.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error as _;

        #[derive(Deserialize)]
        struct Complete {
            #[serde(flatten)]
            features: FeatureConfig,
            voxel: Option<f64>,
            weights: WeightScheme,
            beta: Bandwidth,
            connections: usize,
            compatibility: Compatibility,
            solver: Solver,
            prior: Prior,
            threads: usize,
        }

        let given = serde_json::Map::deserialize(deserializer)?;
        let mut all = match serde_json::to_value(CfSpectral::default()) {
            Ok(serde_json::Value::Object(all)) => all,
            _ => serde_json::Map::new(),
        };
        all.extend(given);
        let all: Complete = serde_json::from_value(all.into()).map_err(D::Error::custom)?;
        let Complete { features, voxel, weights, beta, connections, compatibility, .. } = all;
        let Complete { solver, prior, threads, .. } = all;
        Ok(CfSpectral {
            features,
            voxel,
            weights,
            beta,
            connections,
            compatibility,
            solver,
            prior,
            threads,
        })
    }
}

impl CfSpectral {
    /// Number of points that clouds are downsampled to by default. Chosen by hand; time grows
    /// with the square.
    pub const POINTS: usize = 3000;

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] that names the setting.
    pub fn validate(&self) -> Result<()> {
        self.features.validate()?;
        if let Some(voxel) = self.voxel.filter(|&voxel| !(voxel > 0.0 && voxel <= 1e15)) {
            return Err(Error::config("voxel", voxel, "must be above 0 and at most 1e15"));
        }
        self.beta.validate()?;
        if !(3..=MAX_CONNECTIONS).contains(&self.connections) {
            let rule = format!("must be between 3 and {MAX_CONNECTIONS}");
            return Err(Error::config("connections", self.connections, rule));
        }
        self.compatibility.validate()?;
        self.prior.validate_for(ScaleEstimate::Fixed)
    }

    fn run(&self, ends: [Cached<'_>; 2]) -> Result<Registration> {
        let mut times = Timings::default();
        let connected = self.connect(ends, &mut times)?;
        let moments = times.time("moments", || connected.moments())?;
        let fixed = ScaleEstimate::Fixed;
        let solution =
            times.time("solve", || pose::solve_with(&moments, self.solver, fixed, &self.prior))?;
        let [source, target] = &connected.sides;
        let named = CfSpectral { voxel: Some(connected.unit), ..self.clone() };
        let solved = SolvedPose {
            transform: solution.transform,
            moments: Some(moments),
            singular_values: Some(solution.singular_values),
            connections: connected.first.len() as u64,
            iterations: 1,
            stop: StopReason::OneStep,
            trace: Vec::new(),
            points: Some(PointCounts { source: source.counts(), target: target.counts() }),
            time_s: times,
            method: MethodRecord::new("cf-spectral", &named),
            warnings: Vec::new(),
            fitness: FitnessRule::GLOBAL,
        };
        let [first, second] = connected.second.eigenvalues;
        let found = solved.finish_cached(ends[0], ends[1])?;
        let (beta, eigenvalue_ratio) = (Some(connected.beta), Some(second / first));
        Ok(Registration { beta, eigenvalue_ratio, ..found })
    }
}

impl Register for CfSpectral {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        par::with_threads(self.threads, || self.run([source, target]))?
    }
}
