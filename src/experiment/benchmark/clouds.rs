//! The clouds of a list, as methods are given them.

use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::Settings;
use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::{filter, io};

/// What is known of where the sensors stood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Viewpoints {
    /// What the files say.
    #[default]
    File,
    /// At the zero of each file's frame, where it says nothing.
    Origin,
    /// Nothing, whatever the files say.
    None,
}

impl Viewpoints {
    /// All of them.
    pub const ALL: [Viewpoints; 3] = [Viewpoints::File, Viewpoints::Origin, Viewpoints::None];

    fn name(self) -> &'static str {
        match self {
            Viewpoints::File => "file",
            Viewpoints::Origin => "origin",
            Viewpoints::None => "none",
        }
    }
}

impl fmt::Display for Viewpoints {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Viewpoints {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        Viewpoints::ALL.into_iter().find(|known| known.name() == text).ok_or_else(|| {
            let names = Viewpoints::ALL.map(Viewpoints::name).join(", ");
            Error::config("viewpoints", text, format!("must be one of {names}"))
        })
    }
}

/// Clouds that were read, the last few of them.
#[derive(Default)]
pub(super) struct Clouds {
    held: HashMap<PathBuf, PointCloud>,
    order: Vec<PathBuf>,
}

/// Clouds that are held.
const HELD: usize = 32;

impl Clouds {
    pub(super) fn get(&mut self, path: &Path, settings: Settings, seed: u64) -> Result<PointCloud> {
        if !self.held.contains_key(path) {
            let cloud = io::read(path)?;
            if self.order.len() == HELD {
                self.held.remove(&self.order.remove(0));
            }
            self.order.push(path.into());
            self.held.insert(path.into(), cloud);
        }
        let mut cloud = self.held[path].clone();
        match settings.viewpoints {
            Viewpoints::File => {}
            Viewpoints::Origin if cloud.viewpoint().is_some() => {}
            Viewpoints::Origin => cloud = cloud.with_viewpoint([0.0; 3])?,
            // From coordinates alone: the frame's origin goes too.
            Viewpoints::None => cloud = PointCloud::new(&cloud.positions().collect::<Vec<_>>())?,
        }
        Ok(match settings.points {
            0 => cloud,
            points => filter::sample(&cloud, points, seed),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_back() {
        for known in Viewpoints::ALL {
            assert_eq!(known.to_string().parse::<Viewpoints>().unwrap(), known);
            // As the settings in the first line of kept rows have them.
            assert_eq!(serde_json::to_value(known).unwrap(), known.to_string());
        }
        assert!("sensor".parse::<Viewpoints>().unwrap_err().to_string().contains("origin"));
    }
}
