//! A cloud as this method uses it: downsampled, with normals; descriptors follow once the viewpoint
//! is chosen.

use std::sync::{Arc, OnceLock};

use super::Consensus;
use super::filtered_cloud::FilteredCloud;
use super::viewpoint_sample::ViewpointSample;
use crate::cloud::{Descriptors, PointCloud};
use crate::descriptor::{Descriptor, Fpfh, HistogramScale, PreparedCloud};
use crate::error::{Error, Result};
use crate::filter;
use crate::math::{self, Vec3};
use crate::method::GivenDescriptors;
use crate::method::cache::{Cache, HeapSize};
use crate::method::channels::{
    Channel, DescriptorsWithChannels, channel_values, concatenate_scaled_channels,
};
use crate::normals::{self, Orientation, OrientedBy};
use crate::search::{Neighborhood, Neighbors};
use crate::surface::{SEARCH_RADIUS, Surface, SurfaceIndex};
use crate::visibility::{DepthImage, OrientedSample, ViewpointEstimates};

/// Number of nearest points for a normal. Chosen by hand.
const NORMAL_NEIGHBORS: usize = 20;
/// Number of nearest points for a descriptor. Chosen by hand.
const DESCRIPTOR_NEIGHBORS: usize = 100;
/// The descriptor of surfaces. Chosen by hand.
const FPFH: Fpfh = Fpfh { histogram: HistogramScale::Open3d };
/// Absolute cosine of the angle between an estimated normal and the cloud's own from which on the
/// latter tells the side: 60 degrees. Chosen by hand.
const MIN_STORED_COSINE: f32 = 0.5;
/// Smallest share of the points whose side the cloud's own normals tell. Chosen by hand.
const MIN_STORED_SHARE: f64 = 0.8;
/// Smallest share of pairs of neighbours whose sides agree; normals of random sides have 0.5. Chosen
/// by hand: both sides of a thin wall are neighbours, too.
const MIN_SIDE_AGREEMENT: f64 = 0.8;
/// Number of neighbours whose sides are compared. Chosen by hand.
const SIDE_NEIGHBORS: usize = 6;

/// Points nearer to a sensor than this share of the median distance may be the ego-vehicle. Chosen
/// by hand.
const EGO_RANGE_FACTOR: f64 = 0.5;

/// Keys of values computed from a cloud alone, and at a voxel size.
#[derive(PartialEq)]
struct DownsampledKey(f64, Vec<Channel>, Option<GivenDescriptors>);
#[derive(PartialEq)]
struct EstimatedViewpointsKey;
#[derive(PartialEq)]
struct DepthImageKey(Vec3);

/// A cloud, and its downsampled points.
pub(super) struct Scan<'a> {
    filtered: FilteredCloud<'a>,
    downsampled: Arc<DownsampledScan>,
}

/// A cloud downsampled to one voxel size.
struct DownsampledScan {
    cloud: PointCloud,
    /// Weights of the downsampled points: the mean of the whole cloud's in their cube, if it has
    /// weights.
    weights: Option<Vec<f32>>,
    /// Values by which points are compared too, channel by channel.
    channels: Vec<Vec<f32>>,
    /// Descriptors that the cloud carries, the means of cubes.
    given: Option<Arc<Descriptors>>,
    neighbors: Neighbors,
    /// Normals of either sign.
    normals: Vec<[f32; 3]>,
    voxel_size: f64,
    viewpoint_sample: OnceLock<ViewpointSample>,
    /// Cache of surfaces, by their viewpoint.
    cache: Cache,
}

/// The assumed viewpoint of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ViewpointHypothesis {
    /// The sensor's position in the cloud: space between it and the surfaces was empty.
    Known(Vec3, OrientedBy),
    /// A position that only orients the normals, in the downsampled cloud's local frame.
    Estimated(Vec3),
    /// Seen from all sides.
    Outward,
    /// On the side that the cloud's own normals say.
    Stored,
}

impl<'a> Scan<'a> {
    /// Downsamples `whole` to about one point per cube of side `length`, to be compared as `config`
    /// says; `name` is its name in errors.
    pub(super) fn new(
        whole: FilteredCloud<'a>,
        length: f64,
        config: &Consensus,
        name: &str,
    ) -> Result<Self> {
        let make = || DownsampledScan::new(whole.cloud(), length, config, name);
        let key = DownsampledKey(length, config.channels.clone(), config.given_descriptors);
        let thin = whole.cached().get_or_compute(key, make)?;
        Ok(Scan { filtered: whole, downsampled: thin })
    }

    pub(super) fn filtered_cloud(&self) -> &FilteredCloud<'a> {
        &self.filtered
    }

    pub(super) fn descriptor_neighbors(&self) -> usize {
        DESCRIPTOR_NEIGHBORS.min(self.downsampled.cloud.len())
    }

    /// Returns the sensor's position: the viewpoint of the cloud, else the centre of the returns at
    /// the range limit, else the origin of its frame, if plausible.
    pub(super) fn known_viewpoint(&self) -> Result<Option<ViewpointHypothesis>> {
        let whole = self.filtered.cloud();
        if let Some(at) = whole.viewpoint() {
            return Ok(Some(ViewpointHypothesis::Known(at, OrientedBy::CloudViewpoint)));
        }
        if let Some(limit) = self.filtered.range_limit() {
            return Ok(Some(ViewpointHypothesis::Known(limit.viewpoint, OrientedBy::RangeLimit)));
        }
        let origin = whole.frame_origin();
        let local = math::sub(origin, self.downsampled.cloud.origin());
        Ok(self
            .downsampled
            .viewpoint_sample()?
            .may_be_viewpoint(local)
            .then_some(ViewpointHypothesis::Known(origin, OrientedBy::FrameOrigin)))
    }

    /// Estimates the viewpoints by the shape alone.
    pub(super) fn estimate_viewpoints(&self) -> Result<[Option<ViewpointHypothesis>; 2]> {
        let estimates = self.downsampled.cache.get_or_compute(EstimatedViewpointsKey, || {
            let sample = self.downsampled.viewpoint_sample()?;
            Ok(CachedViewpoints(ViewpointEstimates::compute(
                sample.oriented_sample(),
                &sample.neighborhood_offsets,
            )))
        })?;
        let ViewpointEstimates { outside, inside } = estimates.0;
        Ok([outside, inside].map(|best| best.map(|(at, _)| ViewpointHypothesis::Estimated(at))))
    }

    /// Returns whether the cloud has normals whose side is consistent.
    pub(super) fn has_stored_normals(&self) -> bool {
        self.downsampled.stored_sides().is_some()
    }

    /// Returns the scan seen from `view`, with descriptors.
    pub(super) fn surface(&self, view: ViewpointHypothesis) -> Result<Arc<Surface>> {
        let seen = self.depth_image(view)?;
        self.downsampled.cache.get_or_compute(view, || self.downsampled.compute_surface(view, seen))
    }

    /// Returns the sensor's depth image from the position in `view`; if `view` has none, from the
    /// centre of the returns at the range limit: the viewpoint in a file may be wrong.
    fn depth_image(&self, view: ViewpointHypothesis) -> Result<Option<Arc<DepthImage>>> {
        let at = match (view, self.filtered.range_limit()) {
            (ViewpointHypothesis::Known(at, _), _) => at,
            (_, Some(limit)) => limit.viewpoint,
            (_, None) => return Ok(None),
        };
        let (origin, length) = (self.downsampled.cloud.origin(), self.downsampled.voxel_size);
        let image = || {
            let local = self.filtered.cloud().positions().map(|p| math::sub(p, origin));
            Ok(CachedDepthImage(
                DepthImage::new(local, math::sub(at, origin), length).map(Arc::new),
            ))
        };
        self.downsampled.cache.get_or_compute(DepthImageKey(at), image).map(|seen| seen.0.clone())
    }

    /// Returns the scan's cloud without the possible ego-vehicle of its sensor at `place`: without
    /// points nearer than a share of the median distance of its surfaces.
    pub(super) fn remove_ego_vehicle(&self, place: Vec3) -> FilteredCloud<'a> {
        let distance = |p: Vec3| math::norm(math::sub(p, place));
        let mut distances: Vec<f64> = self.downsampled.cloud.positions().map(distance).collect();
        distances.sort_by(f64::total_cmp);
        self.filtered.crop_near(place, EGO_RANGE_FACTOR * distances[distances.len() / 2])
    }
}

/// A depth image; `None` if it is not informative.
struct CachedDepthImage(Option<Arc<DepthImage>>);

impl HeapSize for CachedDepthImage {
    fn bytes(&self) -> usize {
        self.0.as_ref().map_or(0, |image| image.bytes())
    }
}

/// The estimated viewpoints.
struct CachedViewpoints(ViewpointEstimates);

impl HeapSize for CachedViewpoints {
    fn bytes(&self) -> usize {
        size_of::<ViewpointEstimates>()
    }
}

impl HeapSize for DownsampledScan {
    fn bytes(&self) -> usize {
        let single = self.channels.len() + usize::from(self.weights.is_some());
        // Positions of neighbours, and of their rows.
        let near = self.neighbors.len() * 4 * (DESCRIPTOR_NEIGHBORS + 4);
        let single = single + self.given.as_ref().map_or(0, |rows| rows.dim());
        let own = self.cloud.bytes() + self.cloud.len() * 4 * (3 + single) + near;
        own + self.viewpoint_sample.get().map_or(0, ViewpointSample::bytes) + self.cache.bytes()
    }
}

impl DownsampledScan {
    fn new(cloud: &PointCloud, length: f64, config: &Consensus, name: &str) -> Result<Self> {
        let (thin, weights) = match cloud.relative_weights() {
            None => (filter::voxel_grid(cloud, length)?, None),
            Some(own) => {
                // Weights say how much a position counts, not where the surface is.
                let mean = |cube: &Vec<usize>| {
                    let sum: f64 = cube.iter().map(|&i| f64::from(own[i])).sum();
                    (sum / cube.len() as f64) as f32
                };
                let weights = filter::voxels(cloud, length)?.iter().map(mean).collect();
                (filter::voxel_grid(&cloud.unweighted(), length)?, Some(weights))
            }
        };
        if thin.len() < 3 {
            let length: f64 = format!("{length:.2e}").parse().unwrap_or(length);
            let what = format!("{name}, thinned to {length:e} as both are (have they one unit?),");
            return Err(Error::TooFewPoints { what, found: thin.len(), needed: 3 });
        }
        let values = channel_values(&config.channels, &thin, name)?;
        let channels = values.into_iter().map(<[f32]>::to_vec).collect();
        let given = config.given_descriptors.map(|given| given.rows(&thin, name)).transpose()?;
        let near = Neighbors::find(thin.points(), Neighborhood::Nearest(NORMAL_NEIGHBORS))?;
        let normals = normals::estimate(&thin, &near, Orientation::Outward)?.vectors;
        let neighbors =
            Neighbors::find(thin.points(), Neighborhood::Nearest(DESCRIPTOR_NEIGHBORS))?;
        let (glance, cache) = (OnceLock::new(), Cache::default());
        Ok(DownsampledScan {
            cloud: thin,
            weights,
            channels,
            given,
            neighbors,
            normals,
            voxel_size: length,
            viewpoint_sample: glance,
            cache,
        })
    }

    /// Returns a sample of the points, computed on first use.
    fn viewpoint_sample(&self) -> Result<&ViewpointSample> {
        if let Some(glance) = self.viewpoint_sample.get() {
            return Ok(glance);
        }
        let found = ViewpointSample::new(&self.cloud, self.voxel_size)?;
        Ok(self.viewpoint_sample.get_or_init(|| found))
    }

    /// Returns the estimated normals on the side of the cloud's own; `None` if the cloud has none, if
    /// they are not normals of the surface, or if their side changes from point to point.
    fn stored_sides(&self) -> Option<Vec<[f32; 3]>> {
        let stored = self.cloud.normals()?;
        let cosine = |i: usize| {
            let size = math::norm(stored[i]).max(f32::MIN_POSITIVE);
            math::dot(self.normals[i], stored[i]) / size
        };
        let side = |i: usize| match cosine(i) < 0.0 {
            true => self.normals[i].map(|x| -x),
            false => self.normals[i],
        };
        let sided: Vec<[f32; 3]> = (0..stored.len()).map(side).collect();
        let share = |hit: usize, all: usize| hit as f64 / all.max(1) as f64;
        let with_side: Vec<usize> =
            (0..sided.len()).filter(|&i| cosine(i).abs() > MIN_STORED_COSINE).collect();
        let (mut agreeing, mut all) = (0, 0);
        for &i in &with_side {
            for &j in self.neighbors.indices(i).iter().skip(1).take(SIDE_NEIGHBORS) {
                let cosine = math::dot(sided[i], sided[j as usize]);
                // Across an edge normals differ on both sides.
                if cosine.abs() > MIN_STORED_COSINE {
                    agreeing += usize::from(cosine > 0.0);
                    all += 1;
                }
            }
        }
        (share(with_side.len(), sided.len()) >= MIN_STORED_SHARE
            && share(agreeing, all) >= MIN_SIDE_AGREEMENT)
            .then_some(sided)
    }

    /// Computes the surface seen from `view`, with descriptors; `seen` is the sensor's depth image.
    fn compute_surface(
        &self,
        view: ViewpointHypothesis,
        seen: Option<Arc<DepthImage>>,
    ) -> Result<Surface> {
        let (points, origin) = (self.cloud.points(), self.cloud.origin());
        let sight = OrientedSample { points, normals: &self.normals, spacing: self.voxel_size };
        let (normals, oriented_by) = match view {
            ViewpointHypothesis::Known(at, by) => (sight.orient_normals(math::sub(at, origin)), by),
            ViewpointHypothesis::Estimated(at) => (sight.orient_normals(at), OrientedBy::Guess),
            ViewpointHypothesis::Outward => (self.normals.clone(), OrientedBy::Centroid),
            ViewpointHypothesis::Stored => match self.stored_sides() {
                Some(normals) => (normals, OrientedBy::Stored),
                None => (self.normals.clone(), OrientedBy::Centroid),
            },
        };
        let prepared = PreparedCloud::new(points, &normals, &self.neighbors)?;
        let descriptors = FPFH.describe(&prepared)?;
        let defined =
            |&i: &usize| normals[i] != [0.0; 3] && descriptors.row(i).iter().any(|&bin| bin != 0.0);
        let defined: Vec<usize> = (0..points.len()).filter(defined).collect();
        if defined.len() < 3 {
            return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
        }
        let points: Vec<[f32; 3]> = defined.iter().map(|&i| points[i]).collect();
        let at_points = |own: &[f32]| defined.iter().map(|&i| own[i]).collect();
        Ok(Surface {
            index: SurfaceIndex::new(&points, SEARCH_RADIUS * self.voxel_size)?.into(),
            points,
            origin,
            normals: defined.iter().map(|&i| normals[i]).collect(),
            descriptors: descriptors.select(&defined),
            matching: self.given.as_ref().map(|rows| rows.select(&defined).into()),
            channels: self.channels.iter().map(|own| at_points(own)).collect(),
            weights: self.weights.as_ref().map(|own| at_points(own)),
            depth_image: seen,
            oriented_by,
        })
    }
}

impl HeapSize for Surface {
    fn bytes(&self) -> usize {
        let single = self.channels.len() + usize::from(self.weights.is_some());
        // The depth image is counted separately.
        let matching = self.matching.as_ref().map_or(0, |rows| rows.dim());
        let own = self.len() * 4 * (6 + self.descriptors.dim() + matching + single);
        own + self.index.bytes(self.len())
    }
}

/// Appends the values of the channels of `config` to the descriptors of both sides, and joins the
/// descriptors that the clouds carry with FPFH, if they stand beside, and with the channels.
pub(super) fn append_channels(sides: &mut [Arc<Surface>; 2], config: &Consensus) -> Result<()> {
    let beside = config.given_descriptors.is_some_and(GivenDescriptors::is_beside);
    let joined = join_tables(sides, config, |side| DescriptorsWithChannels {
        descriptors: &side.descriptors,
        beside: None,
        channels: &side.channels,
    })?;
    let matching = match config.given_descriptors {
        None => None,
        Some(_) => Some(join_tables(sides, config, |side| DescriptorsWithChannels {
            descriptors: if beside { &side.descriptors } else { side.matching_descriptors() },
            beside: side.matching.as_deref().filter(|_| beside),
            channels: &side.channels,
        })?),
    };
    let matching = matching.map_or([None, None], |both| both.map(|rows| Some(Arc::new(rows))));
    for ((side, descriptors), matching) in sides.iter_mut().zip(joined).zip(matching) {
        // The scale of a channel depends on both sides: the cached surface is unchanged.
        *side = Arc::new(Surface { descriptors, matching, ..Surface::clone(side) });
    }
    Ok(())
}

/// Joins the tables of both sides that `table` chooses.
fn join_tables<'a>(
    sides: &'a [Arc<Surface>; 2],
    config: &Consensus,
    table: impl Fn(&'a Surface) -> DescriptorsWithChannels<'a>,
) -> Result<[Descriptors; 2]> {
    let compared = sides.each_ref().map(|side| table(side));
    let is_fpfh = std::ptr::eq(compared[0].descriptors, &sides[0].descriptors);
    let min_spread = if is_fpfh { FPFH.histogram.default_beta().sqrt() } else { 0.0 };
    concatenate_scaled_channels(&config.channels, min_spread, compared)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_means_of_cubes_and_move_no_surface() {
        let at = |i: usize| {
            let (x, y) = ((i % 60) as f64, (i / 60) as f64);
            [x, y, 4.0 * (0.2 * x).sin() + 3.0 * (0.15 * y).cos()]
        };
        let cloud = PointCloud::new(&(0..3600).map(at).collect::<Vec<_>>()).unwrap();
        // Weights equal to x: 29.5 in the mean.
        let weights = cloud.positions().map(|p| p[0]).collect();
        let heavy = cloud.clone().with_weights(weights).unwrap();
        let surface = |cloud: &PointCloud| {
            let whole = FilteredCloud::new(cloud.into(), true, false).unwrap();
            Scan::new(whole, 3.0, &Consensus::default(), "it")
                .unwrap()
                .surface(ViewpointHypothesis::Outward)
                .unwrap()
        };
        let (plain, heavy) = (surface(&cloud), surface(&heavy));
        assert_eq!(plain.points, heavy.points);
        for i in 0..heavy.len() {
            let want = (heavy.point(i)[0] + heavy.origin[0]) / 29.5;
            assert!((heavy.weight(i) - want).abs() < 1e-5 && plain.weight(i) == 1.0);
        }
    }
}
