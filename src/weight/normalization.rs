//! Normalisation of the full connection.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Normalisation of the full connection's weights `w_ij` (source i, target j).
///
/// All need only row and column sums of W, so W is never stored. A row or column whose weights all
/// underflow to zero stays zero: that point connects to nothing. Written `none`, `source`,
/// `target`, `both`, `sinkhorn:N`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Normalization {
    /// `w_ij` unchanged: the paper's full connection.
    #[default]
    None,
    /// `w_ij / Σ_j w_ij`: every source point has total weight one (softmax over targets). Helps
    /// where repeated structure gives some points many similar ones.
    Source,
    /// `w_ij / Σ_i w_ij`: every target point has total weight one.
    Target,
    /// `w_ij² / (Σ_j w_ij · Σ_i w_ij)`: both at once (dual softmax); only connections that each
    /// side prefers keep their weight.
    Both,
    /// `n` rounds of Sinkhorn-Knopp (1967): rows scaled to sum 1/N, then columns to
    /// sum 1/M. Costs two passes a round. Ends on the columns.
    Sinkhorn(u32),
}

/// Maximum number of rounds of [`Normalization::Sinkhorn`], with two passes each. Chosen by hand.
const MAX_SINKHORN_ROUNDS: u32 = 1000;

impl Normalization {
    /// Names accepted by `--normalize`.
    pub const NAMES: [&'static str; 5] = ["none", "source", "target", "both", "sinkhorn:N"];
}

impl fmt::Display for Normalization {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Normalization::None => f.write_str("none"),
            Normalization::Source => f.write_str("source"),
            Normalization::Target => f.write_str("target"),
            Normalization::Both => f.write_str("both"),
            Normalization::Sinkhorn(rounds) => write!(f, "sinkhorn:{rounds}"),
        }
    }
}

impl FromStr for Normalization {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let unknown = || {
            let rule = format!(
                "must be one of {} with N from 1 to {MAX_SINKHORN_ROUNDS}",
                Self::NAMES.join(", ")
            );
            Error::config("normalize", text, rule)
        };
        match text {
            "none" => Ok(Normalization::None),
            "source" => Ok(Normalization::Source),
            "target" => Ok(Normalization::Target),
            "both" => Ok(Normalization::Both),
            _ => {
                let rounds = text.strip_prefix("sinkhorn:").and_then(|n| n.parse().ok());
                rounds
                    .filter(|n| (1..=MAX_SINKHORN_ROUNDS).contains(n))
                    .map(Normalization::Sinkhorn)
                    .ok_or_else(unknown)
            }
        }
    }
}

impl From<Normalization> for String {
    fn from(normalization: Normalization) -> Self {
        normalization.to_string()
    }
}

impl TryFrom<String> for Normalization {
    type Error = Error;
    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for name in ["none", "source", "target", "both", "sinkhorn:7"] {
            assert_eq!(name.parse::<Normalization>().unwrap().to_string(), name);
        }
        for name in
            ["", "rows", "sinkhorn", "sinkhorn:0", "sinkhorn:-1", "sinkhorn:x", "sinkhorn:1001"]
        {
            assert!(matches!(name.parse::<Normalization>(), Err(Error::Config { .. })), "{name}");
        }
    }
}
