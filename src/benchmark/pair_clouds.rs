//! The clouds of a list, as methods are given them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::Settings;
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::{filter, io};

/// Clouds that were read, the last few of them.
#[derive(Default)]
pub(super) struct PairClouds {
    held: HashMap<PathBuf, PointCloud>,
    order: Vec<PathBuf>,
}

/// Clouds that are held.
const HELD: usize = 32;

impl PairClouds {
    pub(super) fn get(&mut self, path: &Path, settings: Settings, seed: u64) -> Result<PointCloud> {
        if !self.held.contains_key(path) {
            let cloud = io::read(path)?;
            if self.order.len() == HELD {
                self.held.remove(&self.order.remove(0));
            }
            self.order.push(path.into());
            self.held.insert(path.into(), cloud);
        }
        let cloud = settings.viewpoints.apply(self.held[path].clone())?;
        Ok(match settings.points {
            0 => cloud,
            points => filter::sample(&cloud, points, seed),
        })
    }
}
