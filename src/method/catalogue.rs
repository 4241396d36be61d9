//! The named methods.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{
    Cached, Cf, CfSpectral, Cfk, Consensus, Cpd, Dare, Icp, KernelCorrelation, Metric, Refine,
    Register, Registration, Teaser,
};
use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::par;
use crate::pose::Prior;

/// A named method with its configuration: the value of `--method`, and the record in a
/// [`Registration`] of how it was computed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Method {
    /// Consistent correspondences, verified on the surfaces: [`Consensus`].
    Consensus(Consensus),
    /// The paper's full connection: [`Cf`].
    Cf(Cf),
    /// The strongest connections with second-order weights: [`CfSpectral`].
    CfSpectral(CfSpectral),
    /// The full connection of keypoints: [`Cfk`].
    Cfk(Cfk),
    /// Iterative closest point: [`Icp`].
    Icp(Icp),
    /// Kernel Correlation: [`KernelCorrelation`].
    Kc(KernelCorrelation),
    /// Coherent Point Drift: [`Cpd`].
    Cpd(Cpd),
    /// Density-adaptive registration: [`Dare`].
    Dare(Dare),
    /// Truncated least squares on correspondences: [`Teaser`].
    Teaser(Teaser),
}

impl Method {
    /// The names that `--method` accepts.
    pub const NAMES: [&'static str; 13] = [
        "consensus",
        "cf",
        "cf-multiscale",
        "cf-spectral",
        "cfk",
        "icp",
        "icp-paper",
        "plane-icp",
        "gicp",
        "kc",
        "cpd",
        "dare",
        "teaser",
    ];

    /// Returns the method's name.
    pub fn name(&self) -> &'static str {
        match self {
            Method::Consensus(_) => "consensus",
            Method::Cf(_) => "cf",
            Method::CfSpectral(_) => "cf-spectral",
            Method::Cfk(_) => "cfk",
            Method::Icp(icp) => icp.name(),
            Method::Kc(_) => "kc",
            Method::Cpd(_) => "cpd",
            Method::Dare(_) => "dare",
            Method::Teaser(_) => "teaser",
        }
    }

    /// Returns the method as a refinement; `None` for methods that do not start from a pose.
    pub fn as_refinement(&self) -> Option<&dyn Refine> {
        match self {
            Method::Icp(icp) => Some(icp),
            Method::Kc(kc) => Some(kc),
            Method::Cpd(cpd) => Some(cpd),
            Method::Dare(dare) => Some(dare),
            Method::Consensus(_)
            | Method::Cf(_)
            | Method::CfSpectral(_)
            | Method::Cfk(_)
            | Method::Teaser(_) => None,
        }
    }

    /// Returns the search that verifies poses of the method, with its channels, its use of the
    /// descriptors that clouds carry, and its prior.
    pub fn verifier(&self) -> Consensus {
        let (prior, features) = match self {
            Method::Consensus(method) => return method.clone(),
            Method::Cf(method) => (method.prior, Some(&method.features)),
            Method::CfSpectral(method) => (method.prior, Some(&method.features)),
            Method::Cfk(method) => (method.cf.prior, Some(&method.cf.features)),
            Method::Teaser(method) => (method.prior, Some(&method.features)),
            Method::Icp(method) => (method.prior, None),
            Method::Kc(method) => (method.prior, None),
            Method::Cpd(method) => (method.prior, None),
            Method::Dare(method) => (method.prior, None),
        };
        Consensus {
            prior: Prior { scale: None, ..prior },
            channels: features.map_or_else(Vec::new, |features| features.channels.clone()),
            given_descriptors: features.and_then(|features| features.given_descriptors),
            ..Consensus::default()
        }
    }

    /// Returns whether a registration takes about as long as a [verdict](super::Consensus::verify)
    /// on its pose, or longer: then every pose of a list is verified by default.
    ///
    /// On three real pairs of 500, 5,000 and 30,000 points, one thread, a verdict takes 2 to 60
    /// times as long as `icp`, `plane-icp` and `gicp`, and 17, 2 and 0.1 times as long as `cf`; 0.3
    /// to 4 times as long as `cfk` and `teaser` at 5,000 points, less than a third of
    /// `cf-multiscale`, `cpd`, `dare` and `kc` (`time_s` of `cfreg register --sample N --json`).
    pub fn is_slower_than_verdict(&self) -> bool {
        match self {
            Method::Cf(cf) => !cf.features.more_scales.is_empty(),
            Method::Icp(_) => false,
            _ => true,
        }
    }

    /// Checks the ranges of all settings, as a registration does.
    ///
    /// # Errors
    /// [`Error::Config`] that names the setting.
    pub fn validate(&self) -> Result<()> {
        let (checked, threads) = match self {
            Method::Consensus(method) => (method.validate(), method.threads),
            Method::Cf(method) => (method.validate(), method.threads),
            Method::CfSpectral(method) => (method.validate(), method.threads),
            Method::Cfk(method) => (method.validate(), method.cf.threads),
            Method::Icp(method) => (method.validate(), method.threads),
            Method::Kc(method) => (method.validate(), method.threads),
            Method::Cpd(method) => (method.validate(), method.threads),
            Method::Dare(method) => (method.validate(), method.threads),
            Method::Teaser(method) => (method.validate(), method.threads),
        };
        checked?;
        par::check_threads(threads)
    }

    /// Adds advice on the method's settings to an error without weight.
    pub(crate) fn with_advice<T>(&self, found: Result<T>) -> Result<T> {
        found.map_err(|error| match error {
            Error::NoWeight { .. } => Error::NoWeight { advice: self.advice() },
            other => other,
        })
    }

    /// Advice if no connection has weight.
    fn advice(&self) -> &'static str {
        match self {
            Method::Consensus(_) => "try another voxel, channels, or a prior that allows more",
            Method::Cf(_) | Method::Cfk(_) => "raise beta, or set it to auto",
            Method::CfSpectral(_) => "raise beta, or try another voxel",
            Method::Teaser(_) => "raise noise_bound",
            Method::Icp(_) => "raise max_distance, or start nearer",
            Method::Kc(_) | Method::Cpd(_) => "raise sigma, or start nearer",
            Method::Dare(_) => "start nearer",
        }
    }

    fn as_register(&self) -> &dyn Register {
        match self {
            Method::Consensus(method) => method,
            Method::Cf(method) => method,
            Method::CfSpectral(method) => method,
            Method::Cfk(method) => method,
            Method::Icp(method) => method,
            Method::Kc(method) => method,
            Method::Cpd(method) => method,
            Method::Dare(method) => method,
            Method::Teaser(method) => method,
        }
    }
}

impl FromStr for Method {
    type Err = Error;

    /// Returns the method of that name with its defaults.
    fn from_str(name: &str) -> Result<Self> {
        Ok(match name {
            "consensus" => Method::Consensus(Consensus::default()),
            "cf" => Method::Cf(Cf::default()),
            "cf-multiscale" => Method::Cf(Cf::multiscale()),
            "cf-spectral" => Method::CfSpectral(CfSpectral::default()),
            "cfk" => Method::Cfk(Cfk::default()),
            "icp" => Method::Icp(Icp::default()),
            "icp-paper" => Method::Icp(Icp::paper()),
            "plane-icp" => Method::Icp(Icp { metric: Metric::Plane, ..Icp::default() }),
            "gicp" => Method::Icp(Icp { metric: Metric::Generalized, ..Icp::default() }),
            "kc" => Method::Kc(KernelCorrelation::default()),
            "cpd" => Method::Cpd(Cpd::default()),
            "dare" => Method::Dare(Dare::default()),
            "teaser" => Method::Teaser(Teaser::default()),
            _ => {
                let rule = format!("must be one of {}", Self::NAMES.join(", "));
                return Err(Error::config("method", name, rule));
            }
        })
    }
}

impl Register for Method {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.with_advice(self.as_register().register(source, target))
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        self.with_advice(self.as_register().register_cached(source, target))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_names_settings_that_the_method_has() {
        const SETTINGS: [&str; 7] =
            ["beta", "sigma", "max_distance", "noise_bound", "voxel", "channels", "prior"];
        for name in Method::NAMES {
            let method: Method = name.parse().unwrap();
            let said = method.with_advice(Err::<(), _>(Error::NO_WEIGHT)).unwrap_err().to_string();
            let config = serde_json::to_value(&method).unwrap();
            let named: Vec<&str> =
                SETTINGS.into_iter().filter(|setting| said.contains(setting)).collect();
            let has = |setting: &&str| config.get(*setting).is_some();
            assert!(named.iter().all(has), "{name}: {said}");
            assert!(!named.is_empty() || name == "dare", "{name}: {said}");
        }
    }
}
