//! The points of a cloud that belong to the scanned scene.

use std::sync::Arc;

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter;
use crate::math::{self, Vec3};
use crate::method::cache::{Cache, Cached, HeapSize};
use crate::method::clean;
use crate::visibility::MaxRangeReturns;

/// A cloud without returns at the limit of its sensor's range and without the ego-vehicle.
#[derive(Clone)]
pub(super) struct FilteredCloud<'a> {
    cloud: &'a PointCloud,
    filtered: Arc<FilteredPoints>,
}

/// The remaining points of a cloud.
struct FilteredPoints {
    /// `None`: all points, unchanged.
    cloud: Option<PointCloud>,
    range_limit: Option<MaxRangeReturns>,
    min_range: f64,
    /// Cache of values computed from the remaining points.
    cache: Cache,
}

/// Keys of values computed from a cloud alone.
#[derive(PartialEq)]
struct FilterKey {
    limited: bool,
    keep_no_returns: bool,
}
#[derive(PartialEq)]
struct VoxelSizeKey(usize);

impl<'a> FilteredCloud<'a> {
    /// Leaves out marks of missing returns, unless `keep_no_returns` is set, and merges rows that
    /// share a position. If `limited`, detects returns at the range limit about the viewpoint of
    /// the cloud; for a cloud without one, about the origin of its frame, else about the centre of
    /// these returns.
    pub(super) fn new(whole: Cached<'a>, limited: bool, keep_no_returns: bool) -> Result<Self> {
        let key = FilterKey { limited, keep_no_returns };
        let part = whole
            .get_or_compute(key, || FilteredPoints::new(whole.cloud, limited, keep_no_returns))?;
        Ok(FilteredCloud { cloud: whole.cloud, filtered: part })
    }

    pub(super) fn cloud(&self) -> &PointCloud {
        self.filtered.cloud.as_ref().unwrap_or(self.cloud)
    }

    /// Returns the detected range limit, whose returns are left out.
    pub(super) fn range_limit(&self) -> Option<&MaxRangeReturns> {
        self.filtered.range_limit.as_ref()
    }

    /// Returns the distance from the sensor below which all points are left out; 0 for none.
    pub(super) fn min_range(&self) -> f64 {
        self.filtered.min_range
    }

    /// Returns the cloud with its cache.
    pub(super) fn cached(&self) -> Cached<'_> {
        Cached { cloud: self.cloud(), cache: Some(&self.filtered.cache) }
    }

    /// [`filter::voxel_size_for`] of `points` points.
    pub(super) fn voxel_size_for(&self, points: usize) -> Result<f64> {
        let side = || filter::voxel_size_for(self.cloud(), points);
        self.cached().get_or_compute(VoxelSizeKey(points), side).map(|side| *side)
    }

    /// Returns the points at least `nearest` away from the sensor at `place`.
    pub(super) fn crop_near(&self, place: Vec3, nearest: f64) -> Self {
        let cloud = self.cloud();
        let far = |&i: &usize| math::norm(math::sub(cloud.position(i), place)) >= nearest;
        let far: Vec<usize> = (0..cloud.len()).filter(far).collect();
        let cloud = Some(cloud.select(&far));
        let part = FilteredPoints {
            cloud,
            range_limit: self.filtered.range_limit,
            min_range: nearest,
            cache: Cache::default(),
        };
        FilteredCloud { cloud: self.cloud, filtered: part.into() }
    }
}

impl HeapSize for FilteredPoints {
    fn bytes(&self) -> usize {
        self.cloud.as_ref().map_or(0, PointCloud::bytes) + self.cache.bytes()
    }
}

impl FilteredPoints {
    fn new(all: &PointCloud, limited: bool, keep_no_returns: bool) -> Result<Self> {
        let clean = clean::clean_points(all, keep_no_returns)?;
        let cloud = clean.as_ref().unwrap_or(all);
        // Marks of missing returns are not at the limit of a range, even if they are kept.
        let returns = keep_no_returns.then(|| filter::select_returns(cloud)).flatten();
        let returns = returns.as_ref().unwrap_or(cloud);
        let limit = match returns.viewpoint() {
            _ if !limited => None,
            Some(at) => MaxRangeReturns::detect_at(returns, at),
            None => MaxRangeReturns::detect_at(returns, returns.frame_origin())
                .or_else(|| MaxRangeReturns::detect(returns)),
        };
        let within = limit.as_ref().map(|limit| limit.remove_from(cloud));
        Ok(FilteredPoints {
            cloud: within.or(clean),
            range_limit: limit,
            min_range: 0.0,
            cache: Cache::default(),
        })
    }
}
