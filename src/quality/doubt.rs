//! Grounds to doubt an answer that could be computed.

use serde::Serialize;

use super::evaluate::Evaluation;

pub const MIN_FITNESS: f64 = 0.8;
pub const MIN_SINGULAR_VALUE: f64 = 1e-3;

/// A ground to doubt an answer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "ground", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Doubt {
    LowFitness { found: f64, needed: f64 },
    WeakRotation { found: f64, needed: f64 },
}

pub fn doubts(evaluation: &Evaluation, singular_values: [f64; 3]) -> Vec<Doubt> {
    let _ = (evaluation, singular_values);
    Vec::new()
}
