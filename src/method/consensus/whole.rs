//! A cloud within the range of its sensor, and what follows from it alone.

use std::sync::Arc;

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter;
use crate::method::cache::{Cache, Cached, Keep};
use crate::visibility::RangeLimit;

/// The surfaces of a cloud: all of it but for returns at the limit of the sensor's range.
#[derive(Clone)]
pub(super) struct Whole<'a> {
    cloud: &'a PointCloud,
    within: Arc<Within>,
}

/// What is left of a cloud within the limit of the sensor's range.
struct Within {
    /// `None`: all of it.
    cloud: Option<PointCloud>,
    limit: Option<RangeLimit>,
    /// Of what is made of it.
    cache: Cache,
}

/// Keys of what is made of a cloud alone.
#[derive(PartialEq)]
struct InRange;
#[derive(PartialEq)]
struct Side(usize);

impl<'a> Whole<'a> {
    /// Looks for a limit about the sensor's place: what the cloud says or, where it says nothing,
    /// the origin of its frame, or wherever such returns lie about.
    pub(super) fn of(whole: Cached<'a>) -> Result<Self> {
        let within = whole.get(InRange, || Ok(Within::of(whole.cloud)))?;
        Ok(Whole { cloud: whole.cloud, within })
    }

    pub(super) fn cloud(&self) -> &PointCloud {
        self.within.cloud.as_ref().unwrap_or(self.cloud)
    }

    /// Where returns at the limit of the sensor's range were, which are left out.
    pub(super) fn limit(&self) -> Option<&RangeLimit> {
        self.within.limit.as_ref()
    }

    /// With what was made of it.
    pub(super) fn cached(&self) -> Cached<'_> {
        Cached { cloud: self.cloud(), cache: Some(&self.within.cache) }
    }

    /// [`filter::voxel_side`] of so many points.
    pub(super) fn voxel_side(&self, points: usize) -> Result<f64> {
        let side = || filter::voxel_side(self.cloud(), points);
        self.cached().get(Side(points), side).map(|side| *side)
    }
}

impl Keep for Within {
    fn bytes(&self) -> usize {
        self.cloud.as_ref().map_or(0, PointCloud::bytes) + self.cache.bytes()
    }
}

impl Within {
    fn of(cloud: &PointCloud) -> Self {
        let limit = match cloud.viewpoint() {
            Some(at) => RangeLimit::about(cloud, at),
            None => {
                RangeLimit::about(cloud, cloud.frame_origin()).or_else(|| RangeLimit::find(cloud))
            }
        };
        let cloud = limit.as_ref().map(|limit| limit.within(cloud));
        Within { cloud, limit, cache: Cache::default() }
    }
}
