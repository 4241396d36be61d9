//! From two clouds to connections with weights of both orders.

use std::sync::Arc;

use super::CfSpectral;
use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::filter;
use crate::math::{self, Vec3};
use crate::method::cache::{Cache, Cached, HeapSize};
use crate::method::features::{FeatureCloud, FeatureConfig};
use crate::method::registration::Timings;
use crate::method::viewpoint_choice::choose_viewpoints;
use crate::moments::{FullConnection, Moments, WeightedPair};
use crate::normals::{Orientation, OrientedBy};
use crate::par;
use crate::weight::{ConnectionEnds, Normalization, SecondOrderWeights};

/// Connections with weights of both orders.
pub(in crate::method) struct SpectralConnections {
    /// Both clouds as they were connected.
    pub(in crate::method) sides: [Arc<FeatureCloud>; 2],
    /// The strongest connections with the weights of the dual softmax.
    pub(in crate::method) first: Vec<WeightedPair>,
    pub(in crate::method) second: SecondOrderWeights,
    /// Bandwidth of the kernel.
    pub(in crate::method) beta: f64,
    /// Voxel size, or the length that takes its place.
    pub(in crate::method) unit: f64,
}

/// Key of a cloud with descriptors, and of the source of its viewpoint.
#[derive(PartialEq)]
struct DescribedKey(FeatureConfig, Option<OrientedBy>);
/// Key of a cloud downsampled to a voxel size.
#[derive(PartialEq)]
struct DownsampledKey(f64);

/// A downsampled cloud, and values computed from it.
struct DownsampledCloud {
    cloud: PointCloud,
    cache: Cache,
}

impl DownsampledCloud {
    fn cached(&self) -> Cached<'_> {
        Cached { cloud: &self.cloud, cache: Some(&self.cache) }
    }
}

impl HeapSize for DownsampledCloud {
    fn bytes(&self) -> usize {
        self.cloud.bytes() + self.cache.bytes()
    }
}

/// Returns the cloud downsampled to a voxel size; `name` is its name in errors.
fn downsampled(end: Cached<'_>, size: f64, name: &str) -> Result<Arc<DownsampledCloud>> {
    end.get_or_compute(DownsampledKey(size), || {
        let cloud = downsample(end.cloud, size)?;
        if cloud.len() < 3 {
            let what = format!("{name}, thinned to {size:e} as both are,");
            return Err(Error::TooFewPoints { what, found: cloud.len(), needed: 3 });
        }
        Ok(DownsampledCloud { cloud, cache: Cache::default() })
    })
}

/// Key of the voxel size of a cloud.
#[derive(PartialEq)]
struct VoxelSizeKey(usize);

impl CfSpectral {
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

    /// Returns both clouds with descriptors, with points about `unit` apart, after downsampling to it
    /// if they are `thinned`.
    fn sides(
        &self,
        ends: [Cached<'_>; 2],
        (unit, thinned): (f64, bool),
        times: &mut Timings,
    ) -> Result<[Arc<FeatureCloud>; 2]> {
        if let Some(given) = self.features.given_descriptors {
            given.check_pair(ends[0].cloud, ends[1].cloud)?;
        }
        let thin = times.time("thin", || {
            par::join_pair([(ends[0], "the source"), (ends[1], "the target")], |(end, name)| {
                thinned.then(|| downsampled(end, unit, name)).transpose()
            })
        })?;
        // A cloud that is not thinned keeps its own cache.
        let clouds = [0, 1].map(|side| match &thin[side] {
            Some(thin) => thin.cached(),
            None => ends[side],
        });
        let viewpoints = match self.features.orientation {
            Orientation::Viewpoint => {
                times.time("viewpoints", || choose_viewpoints(clouds, unit))?
            }
            Orientation::Towards(_) | Orientation::Outward | Orientation::Stored => [None; 2],
        };
        let mut extract = |side: usize, name| {
            let features = match viewpoints[side] {
                Some((at, _)) => {
                    FeatureConfig { orientation: Orientation::Towards(at), ..self.features.clone() }
                }
                None => self.features.clone(),
            };
            let key = DescribedKey(features.clone(), viewpoints[side].map(|(_, by)| by));
            clouds[side].get_or_compute(key, || {
                let found = features.extract_with_normals(clouds[side].cloud, name, times)?;
                Ok(found.with_used_points(ends[side].cloud, viewpoints[side].map(|(_, by)| by)))
            })
        };
        let sides = [extract(0, "the source")?, extract(1, "the target")?];
        self.features.with_channels(sides)
    }

    /// Connects both clouds.
    pub(in crate::method) fn connect(
        &self,
        ends: [Cached<'_>; 2],
        times: &mut Timings,
    ) -> Result<SpectralConnections> {
        self.validate()?;
        let (unit, thinned) = times.time("thin", || self.voxel_size(ends))?;
        let sides = self.sides(ends, (unit, thinned), times)?;
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
        let normals = [0, 1].map(|side| sides[side].normals().map(|normals| at(normals, side)));
        let [source, target] = [0, 1].map(|side| ConnectionEnds {
            points: &points[side],
            normals: normals[side].as_deref(),
        });
        self.compatibility.second_order_weights(source, target, unit)
    }
}

impl SpectralConnections {
    /// Returns the weight of each connection in the solve: that of the second order, times those of
    /// its points.
    pub(in crate::method) fn weights(&self) -> impl Iterator<Item = f64> + '_ {
        let [source, target] = self.sides.each_ref().map(|side| side.weights());
        let own = |weights: Option<&[f32]>, i: u32| {
            weights.map_or(1.0, |weights| f64::from(weights[i as usize]))
        };
        self.first.iter().zip(&self.second.weights).map(move |(pair, &weight)| {
            weight * own(source, pair.source) * own(target, pair.target)
        })
    }

    /// Returns the moments of all connections.
    pub(super) fn moments(&self) -> Result<Moments> {
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
