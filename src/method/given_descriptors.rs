//! Descriptors that clouds carry: how methods use them.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::cloud::{Descriptors, PointCloud};
use crate::error::{Error, Result};

/// Use of the descriptors that both clouds carry
/// ([`PointCloud::with_descriptors`](crate::PointCloud::with_descriptors)), such as learned ones.
///
/// As text, and in JSON, `ROLE` or `ROLE:DISTANCE`: `replace`, `beside:cosine`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct GivenDescriptors {
    /// Whether they replace FPFH or stand beside it; default replace.
    pub role: DescriptorRole,
    /// Distance of two rows; default Euclidean.
    pub distance: DescriptorDistance,
}

/// Role of descriptors that the clouds carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DescriptorRole {
    /// Points are compared by them alone.
    #[default]
    Replace,
    /// Points are compared by them and by FPFH, both with equal influence: they are scaled so that
    /// two points differ in the mean as much by them as by FPFH.
    Beside,
}

/// Distance of two descriptors that the clouds carry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DescriptorDistance {
    /// The length of the difference of two rows.
    #[default]
    Euclidean,
    /// That of the rows scaled to length 1: its square is 2 − 2 cos of the angle between them.
    Cosine,
}

impl GivenDescriptors {
    /// Whether points are compared by FPFH, too.
    pub(super) fn is_beside(self) -> bool {
        self.role == DescriptorRole::Beside
    }

    /// Values accepted by `--given-descriptors`.
    pub const NAMES: [&'static str; 4] = ["replace", "replace:cosine", "beside", "beside:cosine"];

    /// Returns the rows that `cloud`, called `name` in errors, carries, ready to be compared.
    ///
    /// # Errors
    /// [`Error::Config`] if it carries none.
    pub(super) fn rows(self, cloud: &PointCloud, name: &str) -> Result<Arc<Descriptors>> {
        let rows = self.carried(cloud, name)?;
        Ok(match self.distance {
            DescriptorDistance::Euclidean => rows.clone(),
            DescriptorDistance::Cosine => rows.normalized().into(),
        })
    }

    fn carried<'a>(self, cloud: &'a PointCloud, name: &str) -> Result<&'a Arc<Descriptors>> {
        cloud.descriptors().ok_or_else(|| {
            let rule = format!("{name} carries no descriptors: attach one row a point");
            Error::config("given_descriptors", self, rule)
        })
    }

    /// Refuses clouds whose descriptors cannot be compared.
    ///
    /// # Errors
    /// [`Error::Config`] for a cloud without, [`Error::Shape`] for two widths.
    pub(super) fn check_pair(self, source: &PointCloud, target: &PointCloud) -> Result<()> {
        let width = |cloud: &PointCloud, name| self.carried(cloud, name).map(|rows| rows.dim());
        let (expected, found) = (width(source, "the source")?, width(target, "the target")?);
        if expected == found {
            return Ok(());
        }
        let what = "width of the target's descriptors, against the source's".into();
        Err(Error::Shape { what, expected, found })
    }
}

impl fmt::Display for GivenDescriptors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let role = match self.role {
            DescriptorRole::Replace => "replace",
            DescriptorRole::Beside => "beside",
        };
        let distance = match self.distance {
            DescriptorDistance::Euclidean => "euclidean",
            DescriptorDistance::Cosine => "cosine",
        };
        write!(f, "{role}:{distance}")
    }
}

impl FromStr for GivenDescriptors {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let (role, distance) = text.split_once(':').unwrap_or((text, "euclidean"));
        let role = match role {
            "replace" => Some(DescriptorRole::Replace),
            "beside" => Some(DescriptorRole::Beside),
            _ => None,
        };
        let distance = match distance {
            "euclidean" => Some(DescriptorDistance::Euclidean),
            "cosine" => Some(DescriptorDistance::Cosine),
            _ => None,
        };
        match (role, distance) {
            (Some(role), Some(distance)) => Ok(GivenDescriptors { role, distance }),
            _ => {
                let rule = format!("must be one of {}", Self::NAMES.join(", "));
                Err(Error::config("given_descriptors", text, rule))
            }
        }
    }
}

impl From<GivenDescriptors> for String {
    fn from(given: GivenDescriptors) -> String {
        given.to_string()
    }
}

impl TryFrom<String> for GivenDescriptors {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_come_back() {
        for text in GivenDescriptors::NAMES {
            let given: GivenDescriptors = text.parse().unwrap();
            assert!(given.to_string().starts_with(text));
            assert_eq!(given.to_string().parse::<GivenDescriptors>().unwrap(), given);
        }
        for wrong in ["", "both", "replace:", "beside:dot"] {
            let error = wrong.parse::<GivenDescriptors>().unwrap_err().to_string();
            assert!(error.contains("must be one of replace"), "{error}");
        }
    }

    #[test]
    fn clouds_without_and_of_two_widths_are_refused() {
        let cloud = PointCloud::new(&[[0.0; 3], [1.0; 3]]).unwrap();
        let rows = |dim| Descriptors::new(dim, vec![1.0; 2 * dim]).unwrap();
        let [one, two] = [1, 2].map(|dim| cloud.clone().with_descriptors(rows(dim)).unwrap());
        let given = GivenDescriptors::default();
        assert!(given.check_pair(&one, &one).is_ok());
        let none = given.check_pair(&one, &cloud).unwrap_err().to_string();
        assert!(none.contains("the target carries no descriptors"), "{none}");
        let widths = given.check_pair(&one, &two);
        assert!(matches!(widths, Err(Error::Shape { expected: 1, found: 2, .. })));
    }
}
