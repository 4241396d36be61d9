//! The methods that have a name.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{Cf, Register, Registration};
use crate::cloud::PointCloud;
use crate::error::{Error, Result};

/// A named method with its configuration: what `--method` chooses, and what a
/// [`Registration`] carries as the record of how it was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// The paper's full connection: [`Cf`].
    Cf(Cf),
}

impl Method {
    /// The names `--method` takes.
    pub const NAMES: [&'static str; 1] = ["cf"];

    /// The method's name.
    pub fn name(&self) -> &'static str {
        match self {
            Method::Cf(_) => "cf",
        }
    }
}

impl FromStr for Method {
    type Err = Error;

    /// The method of that name with its defaults.
    fn from_str(name: &str) -> Result<Self> {
        match name {
            "cf" => Ok(Method::Cf(Cf::default())),
            _ => {
                let rule = format!("must be one of {}", Self::NAMES.join(", "));
                Err(Error::config("method", name, rule))
            }
        }
    }
}

impl Register for Method {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        match self {
            Method::Cf(cf) => cf.register(source, target),
        }
    }
}
