//! Source of the sensors' viewpoints.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{Parts, PointCloud};
use crate::error::{Error, Result};

/// Source of the sensors' viewpoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewpointSource {
    /// The viewpoints that the files name.
    #[default]
    File,
    /// The zero of each file's frame, where the file names no viewpoint.
    Origin,
    /// No viewpoint, even where the files name one.
    None,
}

impl ViewpointSource {
    /// All sources.
    pub const ALL: [ViewpointSource; 3] =
        [ViewpointSource::File, ViewpointSource::Origin, ViewpointSource::None];

    /// Sets the viewpoint of a cloud accordingly.
    ///
    /// # Errors
    /// None for a valid cloud: the zero is a finite position, and the cloud's points are finite.
    pub fn apply(self, cloud: PointCloud) -> Result<PointCloud> {
        match self {
            ViewpointSource::File => Ok(cloud),
            ViewpointSource::Origin if cloud.viewpoint().is_some() => Ok(cloud),
            ViewpointSource::Origin => cloud.with_viewpoint([0.0; 3]),
            ViewpointSource::None => {
                PointCloud::from_parts(Parts { viewpoint: None, ..cloud.parts() })
            }
        }
    }

    fn name(self) -> &'static str {
        match self {
            ViewpointSource::File => "file",
            ViewpointSource::Origin => "origin",
            ViewpointSource::None => "none",
        }
    }
}

impl fmt::Display for ViewpointSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for ViewpointSource {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        ViewpointSource::ALL.into_iter().find(|known| known.name() == text).ok_or_else(|| {
            let names = ViewpointSource::ALL.map(ViewpointSource::name).join(", ");
            Error::config("viewpoints", text, format!("must be one of {names}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_but_the_viewpoint_changes() {
        let cloud =
            PointCloud::with_normals(&[[1.0, 0.0, 0.0], [f64::NAN; 3]], &[[0.0, 1.0, 0.0]; 2]);
        let cloud = cloud.unwrap().with_weights(vec![2.0]).unwrap();
        let seen = cloud.clone().with_viewpoint([4.0, 5.0, 6.0]).unwrap();
        let at_zero = cloud.clone().with_viewpoint([0.0; 3]).unwrap();
        for (known, before, after) in [
            (ViewpointSource::File, &cloud, &cloud),
            (ViewpointSource::File, &seen, &seen),
            (ViewpointSource::Origin, &cloud, &at_zero),
            (ViewpointSource::Origin, &seen, &seen),
            (ViewpointSource::None, &cloud, &cloud),
            (ViewpointSource::None, &seen, &cloud),
        ] {
            assert_eq!(known.apply(before.clone()).unwrap(), *after, "{known}");
        }
    }

    #[test]
    fn names_come_back() {
        for known in ViewpointSource::ALL {
            assert_eq!(known.to_string().parse::<ViewpointSource>().unwrap(), known);
            // The same spelling as in the settings on the first line of saved rows.
            assert_eq!(serde_json::to_value(known).unwrap(), known.to_string());
        }
        assert!("sensor".parse::<ViewpointSource>().unwrap_err().to_string().contains("origin"));
    }
}
