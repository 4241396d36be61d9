//! Clouds as methods use them: without marks of missing returns, one point per position.

use std::sync::Arc;

use super::cache::{Cache, Cached, HeapSize};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter;

/// A cloud without the rows that mark missing returns, and with one point for rows that share a
/// position.
pub(super) struct CleanCloud<'a> {
    /// The input cloud.
    cloud: Cached<'a>,
    clean: Arc<CleanedPoints>,
}

/// The points if they differ from the input, and their cache.
struct CleanedPoints {
    /// `None`: all points, unchanged.
    cloud: Option<PointCloud>,
    cache: Cache,
}

/// Key of a clean cloud: whether marks of missing returns are kept.
#[derive(PartialEq)]
struct CleanKey(bool);

impl<'a> CleanCloud<'a> {
    pub(super) fn new(cloud: Cached<'a>, keep_no_returns: bool) -> Result<Self> {
        let clean = cloud.get_or_compute(CleanKey(keep_no_returns), || {
            let cloud = clean_points(cloud.cloud, keep_no_returns)?;
            Ok(CleanedPoints { cloud, cache: Cache::default() })
        })?;
        Ok(CleanCloud { cloud, clean })
    }

    pub(super) fn cached(&self) -> Cached<'_> {
        match &self.clean.cloud {
            Some(cloud) => Cached { cloud, cache: Some(&self.clean.cache) },
            None => self.cloud,
        }
    }
}

impl HeapSize for CleanedPoints {
    fn bytes(&self) -> usize {
        self.cloud.as_ref().map_or(0, PointCloud::bytes) + self.cache.bytes()
    }
}

/// Returns the points of `cloud` that a method uses; `None` if it uses all, unchanged.
pub(super) fn clean_points(
    cloud: &PointCloud,
    keep_no_returns: bool,
) -> Result<Option<PointCloud>> {
    let returns = if keep_no_returns { None } else { filter::select_returns(cloud) };
    let distinct = filter::merge_duplicate_points(returns.as_ref().unwrap_or(cloud))?;
    Ok(distinct.or(returns))
}
