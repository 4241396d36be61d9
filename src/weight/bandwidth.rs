//! Kernel bandwidth.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::check_beta;
use crate::error::{Error, Result};

/// Squared bandwidth β of a kernel, or the rule that derives it from the descriptors.
///
/// Written as a number, `auto` or `auto:SHARE`; in JSON a number stays a number.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "BandwidthRepr", try_from = "BandwidthRepr")]
pub enum Bandwidth {
    /// β itself, 1e-12 to 1e12, in squared descriptor units.
    Fixed(f64),
    /// This share, above 0 and at most 100, of the median squared distance from a point of
    /// either cloud to the most similar point of the other
    /// ([`FullConnection::bandwidth`](crate::moments::FullConnection::bandwidth)): sharp
    /// where clouds contain the same points, wide where noise or sampling blurs descriptors.
    Auto(f64),
}

impl Bandwidth {
    /// Default share of `auto`.
    pub const DEFAULT_SHARE: f64 = 0.25;

    /// Refuses bandwidths that weights cannot be computed with.
    ///
    /// # Errors
    /// The errors of [`check_beta`]; [`Error::Config`] for a share outside (0, 100].
    pub fn validate(self) -> Result<()> {
        match self {
            Bandwidth::Fixed(beta) => check_beta(beta),
            Bandwidth::Auto(share) if share > 0.0 && share <= 100.0 => Ok(()),
            Bandwidth::Auto(share) => {
                let rule = "SHARE must be above 0 and at most 100";
                Err(Error::config("beta", format!("auto:{share}"), rule))
            }
        }
    }
}

impl From<f64> for Bandwidth {
    fn from(beta: f64) -> Self {
        Bandwidth::Fixed(beta)
    }
}

impl fmt::Display for Bandwidth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Bandwidth::Fixed(beta) => write!(f, "{beta}"),
            Bandwidth::Auto(share) if *share == Self::DEFAULT_SHARE => f.write_str("auto"),
            Bandwidth::Auto(share) => write!(f, "auto:{share}"),
        }
    }
}

impl FromStr for Bandwidth {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        // JSON cannot represent non-finite numbers.
        let number = |text: &str| {
            let number = text.parse().ok().filter(|number: &f64| number.is_finite());
            let rule = "must be a number, auto or auto:SHARE";
            number.ok_or_else(|| Error::config("beta", text, rule))
        };
        match (text, text.strip_prefix("auto:")) {
            ("auto", _) => Ok(Bandwidth::Auto(Self::DEFAULT_SHARE)),
            (_, Some(share)) => number(share).map(Bandwidth::Auto),
            (_, None) => number(text).map(Bandwidth::Fixed),
        }
    }
}

/// The JSON representation.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "must be a number, \"auto\" or \"auto:SHARE\"")]
enum BandwidthRepr {
    Number(f64),
    Word(String),
}

impl From<Bandwidth> for BandwidthRepr {
    fn from(bandwidth: Bandwidth) -> Self {
        match bandwidth {
            Bandwidth::Fixed(beta) => BandwidthRepr::Number(beta),
            Bandwidth::Auto(_) => BandwidthRepr::Word(bandwidth.to_string()),
        }
    }
}

impl TryFrom<BandwidthRepr> for Bandwidth {
    type Error = Error;
    fn try_from(written: BandwidthRepr) -> Result<Self> {
        match written {
            BandwidthRepr::Number(beta) => Ok(Bandwidth::Fixed(beta)),
            BandwidthRepr::Word(text) => text.parse(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_numbers_round_trip() {
        for (text, json) in [("50", "50.0"), ("auto", "\"auto\""), ("auto:0.5", "\"auto:0.5\"")] {
            let bandwidth: Bandwidth = text.parse().unwrap();
            assert_eq!(bandwidth.to_string(), text);
            assert_eq!(serde_json::to_string(&bandwidth).unwrap(), json);
            assert_eq!(serde_json::from_str::<Bandwidth>(json).unwrap(), bandwidth);
        }
    }

    #[test]
    fn what_is_no_bandwidth_is_refused() {
        for text in ["", "wide", "auto:", "auto:x", "nan", "inf", "auto:nan"] {
            assert!(matches!(text.parse::<Bandwidth>(), Err(Error::Config { .. })), "{text}");
        }
        for text in ["0", "-1", "1e13", "auto:0", "auto:101"] {
            let bandwidth: Bandwidth = text.parse().unwrap();
            let refused = bandwidth.validate();
            assert!(matches!(refused, Err(Error::Config { field: "beta", .. })), "{text}");
        }
    }
}
