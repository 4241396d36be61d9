//! Grounds to doubt an answer that could be computed.

use std::fmt;

use serde::Serialize;

use super::evaluate::Evaluation;

/// Agreement beyond chance below which a pose is doubted.
///
/// Measured on 60 real pairs of seven kinds, moved at random and registered with and
/// without dual softmax (`cargo test --release --test trust -- --nocapture`): of the poses
/// off by more than 20°, none of 90 reached 0.3 with clouds of 2,000 points (the most was
/// 0.18), none of 92 with 1,000 (0.26), and 3 of 104 with 500, where the inlier distance is
/// coarse. The true poses reach 0.58 in the median, those that one step finds 0.33: doubt
/// errs on the side of caution.
pub const MIN_AGREEMENT: f64 = 0.3;
/// Second relative singular value below which a rotation is doubted: about one axis the
/// weights then hardly tell one angle from another.
pub const MIN_SINGULAR_VALUE: f64 = 1e-3;

/// A ground to doubt an answer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "ground", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Doubt {
    /// The clouds hardly lie on each other better than under a wrong rotation.
    LowAgreement {
        /// [`Evaluation::agreement`] of the pose.
        found: f64,
        /// [`MIN_AGREEMENT`].
        needed: f64,
    },
    /// The weights hardly determine the rotation about one axis.
    WeakRotation {
        /// Second relative singular value.
        found: f64,
        /// [`MIN_SINGULAR_VALUE`].
        needed: f64,
    },
}

/// All grounds to doubt a pose with this evaluation and these relative singular values.
pub fn doubts(evaluation: &Evaluation, singular_values: [f64; 3]) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    let found = evaluation.agreement();
    if found.is_nan() || found < MIN_AGREEMENT {
        doubts.push(Doubt::LowAgreement { found, needed: MIN_AGREEMENT });
    }
    let found = singular_values[1];
    if found.is_nan() || found < MIN_SINGULAR_VALUE {
        doubts.push(Doubt::WeakRotation { found, needed: MIN_SINGULAR_VALUE });
    }
    doubts
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Doubt::LowAgreement { found, needed } => write!(
                f,
                "the clouds agree by {found:.2} beyond chance under this pose, {needed:.2} is \
                 needed: it is probably wrong, or the overlap is small"
            ),
            Doubt::WeakRotation { found, needed } => write!(
                f,
                "the weights leave the rotation about one axis open: second singular value \
                 {found:.1e}, {needed:.1e} is needed"
            ),
        }
    }
}
