//! The clouds of a list, as they are passed to methods.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::Settings;
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::{filter, io};

/// A cache of the last few clouds that were read.
#[derive(Default)]
pub(super) struct PairClouds {
    cached: HashMap<PathBuf, PointCloud>,
    order: Vec<PathBuf>,
}

/// Most clouds in the cache. Chosen by hand.
const MAX_CACHED_CLOUDS: usize = 32;

impl PairClouds {
    pub(super) fn get(&mut self, path: &Path, settings: Settings, seed: u64) -> Result<PointCloud> {
        if !self.cached.contains_key(path) {
            let cloud = io::read(path)?;
            if self.order.len() == MAX_CACHED_CLOUDS {
                self.cached.remove(&self.order.remove(0));
            }
            self.order.push(path.into());
            self.cached.insert(path.into(), cloud);
        }
        let cloud = settings.viewpoints.apply(self.cached[path].clone())?;
        Ok(match settings.points {
            0 => cloud,
            points => filter::sample(&cloud, points, seed),
        })
    }
}
