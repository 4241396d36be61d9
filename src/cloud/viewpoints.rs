//! What is known of where sensors stood.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::PointCloud;
use crate::error::{Error, Result};

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

    /// The cloud with what is known.
    ///
    /// # Errors
    /// None for a cloud that is one: the zero is a place, and its points are finite.
    pub fn apply(self, cloud: PointCloud) -> Result<PointCloud> {
        match self {
            Viewpoints::File => Ok(cloud),
            Viewpoints::Origin if cloud.viewpoint().is_some() => Ok(cloud),
            Viewpoints::Origin => cloud.with_viewpoint([0.0; 3]),
            // From coordinates alone: the frame's origin goes too.
            Viewpoints::None => PointCloud::new(&cloud.positions().collect::<Vec<_>>()),
        }
    }

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
