//! CF-spectral: the full connection, made sparse, weighted to the second order and solved once.

use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize};

use super::features::{FeatureCloud, FeatureConfig};
use super::registration::{PointCounts, Registration, Timings};
use super::{Cached, MethodRecord, Register, SolvedPose, StopReason};
use crate::cloud::PointCloud;
use crate::descriptor::HistogramScale;
use crate::error::{Error, Result};
use crate::filter;
use crate::math::{self, Vec3};
use crate::moments::{FullConnection, Moments, WeightedPair};
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::search::Neighborhood;
use crate::verify::FitnessRule;
use crate::weight::{
    Bandwidth, Compatibility, ConnectionEnds, MAX_CONNECTIONS, Normalization, SecondOrderWeights,
    WeightScheme,
};

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
    /// Settings of the descriptors. Default other than those of [`Cf`](super::Cf): 100 nearest
    /// points, normals of 20, Open3D's histograms. With the paper's 150 points for both, descriptors
    /// reach over the border of the overlap.
    #[serde(flatten)]
    pub features: FeatureConfig,
    /// Voxel size to which both clouds are downsampled, and the unit of all lengths, above 0, in the
    /// unit of the coordinates. Default [`filter::voxel_size_for`] of [`POINTS`](Self::POINTS)
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

/// Connections with weights of both orders.
pub(super) struct SpectralConnections {
    /// Both clouds as they were connected.
    pub(super) sides: [Arc<FeatureCloud>; 2],
    /// The strongest connections with the weights of the dual softmax.
    pub(super) first: Vec<WeightedPair>,
    pub(super) second: SecondOrderWeights,
    /// Bandwidth of the kernel.
    pub(super) beta: f64,
    /// Voxel size, or the length that takes its place.
    pub(super) unit: f64,
}

/// Key of a cloud with descriptors, downsampled to a voxel size.
#[derive(PartialEq)]
struct DownsampledKey(Option<f64>, FeatureConfig);
/// Key of the voxel size of a cloud.
#[derive(PartialEq)]
struct VoxelSizeKey(usize);

impl CfSpectral {
    /// Number of points that clouds are downsampled to by default. More help most under little
    /// overlap; time grows with the square.
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

    /// Returns the voxel size, and whether clouds are downsampled to it.
    fn voxel_size(&self, ends: [Cached<'_>; 2]) -> Result<(f64, bool)> {
        if let Some(voxel) = self.voxel {
            return Ok((voxel, true));
        }
        let [source, target] = par::join_pair(ends, |end| {
            let size = || filter::voxel_size_for(end.cloud, Self::POINTS);
            end.get_or_compute(VoxelSizeKey(Self::POINTS), size).map(|size| *size)
        })?;
        let size = source.max(target);
        if size <= 0.0 {
            // All points at one position.
            return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
        }
        Ok((size, ends.iter().any(|end| end.cloud.len() > Self::POINTS)))
    }

    /// Returns both clouds with descriptors, downsampled to `voxel` if it is given.
    fn sides(
        &self,
        [source, target]: [Cached<'_>; 2],
        voxel: Option<f64>,
        times: &mut Timings,
    ) -> Result<[Arc<FeatureCloud>; 2]> {
        let mut extract = |end: Cached<'_>, name| {
            end.get_or_compute(DownsampledKey(voxel, self.features.clone()), || match voxel {
                None => self.features.extract(end.cloud, name, times),
                Some(size) => {
                    let thin = times.time("thin", || downsample(end.cloud, size))?;
                    if thin.len() < 3 {
                        let what = format!("{name}, thinned to {size:e} as both are,");
                        return Err(Error::TooFewPoints { what, found: thin.len(), needed: 3 });
                    }
                    let side = self.features.extract(&thin, name, times)?;
                    Ok(side.with_used_points(end.cloud))
                }
            })
        };
        let sides = [extract(source, "the source")?, extract(target, "the target")?];
        if self.features.channels.is_empty() {
            return Ok(sides);
        }
        let joined = sides.map(|side| FeatureCloud::clone(&side));
        Ok(self.features.concatenate_channels(joined)?.map(Arc::new))
    }

    /// Connects both clouds.
    pub(super) fn connect(
        &self,
        ends: [Cached<'_>; 2],
        times: &mut Timings,
    ) -> Result<SpectralConnections> {
        self.validate()?;
        let (unit, thinned) = times.time("thin", || self.voxel_size(ends))?;
        let sides = self.sides(ends, thinned.then_some(unit), times)?;
        let (first, beta) = times.time("connections", || {
            let connection = sides[0].connection(&sides[1])?;
            self.strongest(&connection)
        })?;
        let second =
            times.time("compatibility", || self.second_order_weights(&sides, &first, unit))?;
        Ok(SpectralConnections { sides, first, second, beta, unit })
    }

    /// Returns the strongest connections and the bandwidth.
    fn strongest(&self, connection: &FullConnection) -> Result<(Vec<WeightedPair>, f64)> {
        let beta = connection.bandwidth(self.beta)?;
        let count = self.connections;
        let found = connection.strongest(self.weights, beta, Normalization::Both, count)?;
        Ok((found, beta))
    }

    fn second_order_weights(
        &self,
        sides: &[Arc<FeatureCloud>; 2],
        first: &[WeightedPair],
        unit: f64,
    ) -> Result<SecondOrderWeights> {
        let rows = [
            first.iter().map(|pair| pair.source as usize).collect::<Vec<usize>>(),
            first.iter().map(|pair| pair.target as usize).collect(),
        ];
        let at = |values: &[[f32; 3]], side: usize| -> Vec<[f32; 3]> {
            rows[side].iter().map(|&row| values[row]).collect()
        };
        let points = [0, 1].map(|side| at(sides[side].view().points, side));
        let normals = [0, 1].map(|side| at(sides[side].normals(), side));
        let [source, target] = [0, 1]
            .map(|side| ConnectionEnds { points: &points[side], normals: Some(&normals[side]) });
        self.compatibility.second_order_weights(source, target, unit)
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

impl SpectralConnections {
    /// Returns the weight of each connection in the solve: that of the second order, times those of
    /// its points.
    pub(super) fn weights(&self) -> impl Iterator<Item = f64> + '_ {
        let [source, target] = self.sides.each_ref().map(|side| side.weights());
        let own = |weights: Option<&[f32]>, i: u32| {
            weights.map_or(1.0, |weights| f64::from(weights[i as usize]))
        };
        self.first.iter().zip(&self.second.weights).map(move |(pair, &weight)| {
            weight * own(source, pair.source) * own(target, pair.target)
        })
    }

    /// Returns the moments of all connections.
    fn moments(&self) -> Result<Moments> {
        let views = self.sides.each_ref().map(|side| side.view());
        let centers = views.map(|view| {
            let sum: Vec3 =
                view.points.iter().fold([0.0; 3], |sum, p| math::add(sum, p.map(f64::from)));
            math::scaled(sum, 1.0 / view.points.len() as f64)
        });
        let [source, target] = [0, 1].map(|side| math::add(views[side].origin, centers[side]));
        let mut moments = Moments::about(source, target);
        let local = |side: usize, i: u32| {
            math::sub(views[side].points[i as usize].map(f64::from), centers[side])
        };
        for (pair, weight) in self.first.iter().zip(self.weights()) {
            moments.add_pair(weight, local(0, pair.source), local(1, pair.target));
        }
        moments.centered()?;
        Ok(moments)
    }
}

/// Downsamples a cloud to one point per voxel. Weights say how much a position counts, not where the
/// surface is: a voxel has the mean weight of its points.
fn downsample(cloud: &PointCloud, size: f64) -> Result<PointCloud> {
    let Some(weights) = cloud.weights() else { return filter::voxel_grid(cloud, size) };
    let mean = |voxel: &Vec<usize>| {
        voxel.iter().map(|&i| f64::from(weights[i])).sum::<f64>() / voxel.len() as f64
    };
    let means = filter::voxels(cloud, size)?.iter().map(mean).collect();
    filter::voxel_grid(&cloud.unweighted(), size)?.with_weights(means)
}

impl Register for CfSpectral {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        par::with_threads(self.threads, || self.run([source, target]))?
    }
}
