//! Clouds as methods take them: without marks of missing returns, one point a place.

use std::sync::Arc;

use super::cache::{Cache, Cached, HeapSize};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter;

/// A cloud without the rows that mark missing returns, and with one point for rows that share a
/// place.
pub(super) struct CleanCloud<'a> {
    /// As it was handed in.
    cloud: Cached<'a>,
    clean: Arc<CleanedPoints>,
}

/// Points that differ from those that were handed in, and what is made of them.
struct CleanedPoints {
    /// `None`: all of them, as they are.
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

/// The points that a method takes of `cloud`; `None` where it takes all, as they are.
pub(super) fn clean_points(
    cloud: &PointCloud,
    keep_no_returns: bool,
) -> Result<Option<PointCloud>> {
    let returns = if keep_no_returns { None } else { filter::select_returns(cloud) };
    let distinct = filter::merge_duplicate_points(returns.as_ref().unwrap_or(cloud))?;
    Ok(distinct.or(returns))
}
