//! Closed-form poses from [`Moments`]: the paper's four references, and scale.
//!
//! All minimise Σw ‖s R p + t − q‖² exactly and give the same pose. They differ in the
//! representation of the rotation: an SVD, a unit quaternion, an orthonormal matrix, a dual
//! quaternion.

mod arun;
mod horn_matrix;
mod horn_quaternion;
mod nearest;
mod prior;
mod walker;

pub(crate) use horn_quaternion::product_form;
pub use nearest::{MAX_ROTATION_ERROR, nearest_rotation};
pub use prior::{Prior, RotationBound};

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, Mat3};
use crate::moments::Moments;

/// Singular values relative to the clouds' spread at or below this count as zero. The tiles' f32
/// rounding leaves less than 1e-9 if all weights are equal.
pub const RANK_TOLERANCE: f64 = 1e-8;

/// Closed form that solves for the rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Solver {
    /// Singular value decomposition (Arun, Huang and Blostein 1987) with the reflection
    /// rule: the paper's choice.
    #[default]
    Arun,
    /// Unit quaternion: largest eigenvector of a 4×4 matrix (Horn 1987).
    HornQuaternion,
    /// Orthonormal matrix: polar decomposition by a matrix square root (Horn, Hilden and
    /// Negahdaripour 1988).
    HornMatrix,
    /// Dual quaternion: rotation and translation together (Walker, Shao and Volz 1991).
    Walker,
}

/// Estimation of the scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScaleEstimate {
    /// The clouds have the same unit: scale 1.
    #[default]
    Fixed,
    /// The least-squares scale (Umeyama 1991). On a full connection, where wrong pairs average out,
    /// it shrinks towards 0: use it for weights that are nearly one-to-one correspondences.
    Umeyama,
    /// √(target variance / source variance) (Horn 1987): symmetric, exchanging the clouds gives the
    /// inverse. Use it on a full connection.
    Symmetric,
}

/// A pose, and how well the pairs constrain it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Solution {
    /// Source into target frame.
    pub transform: Transform,
    /// Singular values of the weighted cross-covariance over the product of both weighted standard
    /// deviations, in [0, 1], descending. The first is 1 if the pairs are perfectly consistent
    /// along a line; the second measures how well the rotation is constrained.
    pub singular_values: [f64; 3],
}

/// Solves for the pose that minimises the weighted residual of `moments`.
///
/// # Errors
/// [`Error::Degenerate`] when fewer than two singular values exceed [`RANK_TOLERANCE`];
/// [`Error::NoWeight`] and [`Error::NonFinite`] as for [`Moments::centered`].
///
/// ```
/// use cfreg::{moments::Moments, pose::{self, ScaleEstimate, Solver}};
/// let mut moments = Moments::about([0.0; 3], [0.0; 3]);
/// for p in [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]] {
///     moments.add_pair(1.0, p, [p[0] + 5.0, p[1], p[2]]);
/// }
/// let pose = pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed)?.transform;
/// assert!((pose.translation[0] - 5.0).abs() < 1e-12);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn solve(moments: &Moments, solver: Solver, scale: ScaleEstimate) -> Result<Solution> {
    solve_with(moments, solver, scale, &Prior::default())
}

/// Solves for the best pose among the poses that `prior` allows, exactly.
///
/// With a known direction, the pairs must extend along at least one line across it; with a known
/// rotation, any pairs suffice.
///
/// # Errors
/// The errors of [`solve`], of [`Prior::validate`], and [`Error::Config`] where the parts of the
/// prior contradict each other.
pub fn solve_with(
    moments: &Moments,
    solver: Solver,
    scale: ScaleEstimate,
    prior: &Prior,
) -> Result<Solution> {
    prior.validate_for(scale)?;
    let centered = moments.centered()?;
    let spread = (centered.source_variance * centered.target_variance).sqrt();
    let known = prior.rotation.is_some_and(|near| near.within_deg == 0.0);
    let placed = spread > 0.0 && spread.is_finite();
    if !placed && !known {
        return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
    }
    // Independent of the unit: the solvers' tolerances then apply to clouds of any size.
    let unit = if placed { spread } else { 1.0 };
    let covariance = centered.covariance.map(|row| math::scaled(row, 1.0 / unit));
    let svd = arun::decompose(&covariance)?;
    let singular_values = svd.values;
    let rank = singular_values.iter().filter(|&&value| value > RANK_TOLERANCE).count();
    let open = || Error::Degenerate { rank, singular_values };
    let mut walkers = None;
    let free = || {
        if rank < 2 {
            return Err(open());
        }
        Ok(match solver {
            Solver::Arun => arun::rotation(&svd),
            Solver::HornQuaternion => horn_quaternion::rotation(&covariance)?,
            Solver::HornMatrix => horn_matrix::rotation(&covariance),
            Solver::Walker => {
                let (rotation, translation) = walker::solve_pose(moments)?;
                walkers = Some(translation).filter(|_| !prior.constrains_rotation());
                rotation
            }
        })
    };
    let rotation = prior.rotation(&covariance, free, open)?;
    let mut scale = estimate_scale(scale, &rotation, &covariance, &centered);
    if let Some([low, high]) = prior.scale {
        scale = scale.clamp(low, high);
    }
    if scale.is_nan() || scale <= 0.0 {
        // The prior rotates so far that the clouds would have to be mirrored.
        return Err(open());
    }
    let translation = match walkers {
        Some(translation) if scale == 1.0 => translation,
        _ => {
            let turned = math::mat_vec(&rotation, centered.source_mean);
            math::sub(centered.target_mean, math::scaled(turned, scale))
        }
    };
    Ok(Solution { transform: Transform { rotation, translation, scale }, singular_values })
}

/// Estimates the scale for a rotation; `covariance` is relative to the clouds' spread.
fn estimate_scale(
    estimate: ScaleEstimate,
    rotation: &Mat3,
    covariance: &Mat3,
    centered: &crate::moments::Centered,
) -> f64 {
    let ratio = (centered.target_variance / centered.source_variance).sqrt();
    match estimate {
        ScaleEstimate::Fixed => 1.0,
        ScaleEstimate::Symmetric => ratio,
        // tr(R Σ_pq) / σ_p²: the trace is the sum of the (signed) singular values.
        ScaleEstimate::Umeyama => math::trace(&math::mat_mul(rotation, covariance)) * ratio,
    }
}

impl Solver {
    /// All solvers in the order of their references.
    pub const ALL: [Solver; 4] =
        [Solver::Arun, Solver::HornQuaternion, Solver::HornMatrix, Solver::Walker];
}

impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Solver::Arun => "arun",
            Solver::HornQuaternion => "horn-quaternion",
            Solver::HornMatrix => "horn-matrix",
            Solver::Walker => "walker",
        })
    }
}

impl FromStr for Solver {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        let named = Solver::ALL.into_iter().find(|solver| solver.to_string() == text);
        named.ok_or_else(|| {
            let names = Solver::ALL.map(|solver| solver.to_string()).join(", ");
            Error::config("solver", text, format!("must be one of {names}"))
        })
    }
}

impl fmt::Display for ScaleEstimate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ScaleEstimate::Fixed => "fixed",
            ScaleEstimate::Umeyama => "umeyama",
            ScaleEstimate::Symmetric => "symmetric",
        })
    }
}

impl FromStr for ScaleEstimate {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "fixed" => Ok(ScaleEstimate::Fixed),
            "umeyama" => Ok(ScaleEstimate::Umeyama),
            "symmetric" => Ok(ScaleEstimate::Symmetric),
            _ => Err(Error::config("scale", text, "must be fixed, umeyama or symmetric")),
        }
    }
}

/// Converts the unit quaternion `[w, x, y, z]` to a rotation matrix.
fn quaternion_matrix([w, x, y, z]: [f64; 4]) -> Mat3 {
    [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
}

/// Finds the unit eigenvector of the largest eigenvalue of a symmetric 4×4 matrix.
fn largest_eigenvector(matrix: &[[f64; 4]; 4]) -> Result<[f64; 4]> {
    let matrix = faer::Mat::from_fn(4, 4, |i, j| matrix[i][j]);
    let eigen = matrix
        .self_adjoint_eigen(faer::Side::Lower)
        .map_err(|_| Error::NonFinite { what: "the solver's 4x4 matrix".into(), index: 0 })?;
    // Ascending: the last column belongs to the largest.
    Ok([0, 1, 2, 3].map(|i| eigen.U()[(i, 3)]))
}
