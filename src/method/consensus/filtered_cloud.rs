//! The surfaces of a cloud: what of it belongs to the place that was scanned.

use std::sync::Arc;

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter;
use crate::math::{self, Vec3};
use crate::method::cache::{Cache, Cached, HeapSize};
use crate::method::clean;
use crate::visibility::MaxRangeReturns;

/// A cloud but for returns at the limit of its sensor's range and what travels with the sensor.
#[derive(Clone)]
pub(super) struct FilteredCloud<'a> {
    cloud: &'a PointCloud,
    filtered: Arc<FilteredPoints>,
}

/// What is left of a cloud.
struct FilteredPoints {
    /// `None`: all of it, as it is.
    cloud: Option<PointCloud>,
    range_limit: Option<MaxRangeReturns>,
    min_range: f64,
    /// Of what is made of it.
    cache: Cache,
}

/// Keys of what is made of a cloud alone.
#[derive(PartialEq)]
struct FilterKey {
    limited: bool,
    keep_no_returns: bool,
}
#[derive(PartialEq)]
struct VoxelSizeKey(usize);

impl<'a> FilteredCloud<'a> {
    /// Leaves out marks of missing returns, unless they are to be kept, and makes one point of
    /// rows that share a place. Looks, if it is `limited`, for a limit about the sensor's place:
    /// what the cloud says or, where it says nothing, the origin of its frame, or wherever such
    /// returns lie about.
    pub(super) fn new(whole: Cached<'a>, limited: bool, keep_no_returns: bool) -> Result<Self> {
        let key = FilterKey { limited, keep_no_returns };
        let part = whole
            .get_or_compute(key, || FilteredPoints::new(whole.cloud, limited, keep_no_returns))?;
        Ok(FilteredCloud { cloud: whole.cloud, filtered: part })
    }

    pub(super) fn cloud(&self) -> &PointCloud {
        self.filtered.cloud.as_ref().unwrap_or(self.cloud)
    }

    /// Where returns at the limit of the sensor's range were, which are left out.
    pub(super) fn range_limit(&self) -> Option<&MaxRangeReturns> {
        self.filtered.range_limit.as_ref()
    }

    /// Distance from the sensor below which all is left out; 0 for nothing.
    pub(super) fn min_range(&self) -> f64 {
        self.filtered.min_range
    }

    /// With what was made of it.
    pub(super) fn cached(&self) -> Cached<'_> {
        Cached { cloud: self.cloud(), cache: Some(&self.filtered.cache) }
    }

    /// [`filter::voxel_size_for`] of so many points.
    pub(super) fn voxel_size_for(&self, points: usize) -> Result<f64> {
        let side = || filter::voxel_size_for(self.cloud(), points);
        self.cached().get_or_compute(VoxelSizeKey(points), side).map(|side| *side)
    }

    /// What is at least `nearest` away from the sensor at `place`.
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
        // Marks of missing returns are not at the limit of a range, though they are kept.
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
