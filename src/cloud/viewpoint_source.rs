//! What is known of where sensors stood.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{Parts, PointCloud};
use crate::error::{Error, Result};

/// What is known of where the sensors stood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ViewpointSource {
    /// What the files say.
    #[default]
    File,
    /// At the zero of each file's frame, where it says nothing.
    Origin,
    /// Nothing, whatever the files say.
    None,
}

impl ViewpointSource {
    /// All of them.
    pub const ALL: [ViewpointSource; 3] =
        [ViewpointSource::File, ViewpointSource::Origin, ViewpointSource::None];

    /// The cloud with what is known.
    ///
    /// # Errors
    /// None for a cloud that is one: the zero is a place, and its points are finite.
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
            // As the settings in the first line of kept rows have them.
            assert_eq!(serde_json::to_value(known).unwrap(), known.to_string());
        }
        assert!("sensor".parse::<ViewpointSource>().unwrap_err().to_string().contains("origin"));
    }
}
