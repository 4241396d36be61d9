//! The surfaces of a cloud: what of it belongs to the place that was scanned.

use std::borrow::Cow;

use crate::cloud::PointCloud;
use crate::math::{self, Vec3};
use crate::visibility::RangeLimit;

/// A cloud but for returns at the limit of its sensor's range and what travels with the sensor.
pub(super) struct Whole<'a> {
    pub(super) cloud: Cow<'a, PointCloud>,
    /// Where the former were, if there were any.
    pub(super) limit: Option<RangeLimit>,
    /// Distance from the sensor below which all is left out; 0 for nothing.
    pub(super) nearest: f64,
}

impl<'a> Whole<'a> {
    /// Looks, if it is `limited`, for a limit about the sensor's place: what the cloud says or,
    /// where it says nothing, the origin of its frame, or wherever such returns lie about.
    pub(super) fn of(cloud: &'a PointCloud, limited: bool) -> Self {
        let limit = match cloud.viewpoint() {
            _ if !limited => None,
            Some(at) => RangeLimit::about(cloud, at),
            None => {
                RangeLimit::about(cloud, cloud.frame_origin()).or_else(|| RangeLimit::find(cloud))
            }
        };
        let cloud = match &limit {
            Some(limit) => Cow::Owned(limit.within(cloud)),
            None => Cow::Borrowed(cloud),
        };
        Whole { cloud, limit, nearest: 0.0 }
    }

    /// What is at least `nearest` away from the sensor at `place`.
    pub(super) fn beyond(&self, place: Vec3, nearest: f64) -> Whole<'static> {
        let far = |&i: &usize| math::norm(math::sub(self.cloud.position(i), place)) >= nearest;
        let far: Vec<usize> = (0..self.cloud.len()).filter(far).collect();
        Whole { cloud: Cow::Owned(self.cloud.select(&far)), limit: self.limit, nearest }
    }
}
