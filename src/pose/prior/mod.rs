//! Prior knowledge of a pose, enforced exactly by the closed form.
//!
//! All solvers maximise tr(R C), C the weighted cross-covariance; they differ in the representation
//! of R. The remaining freedom under a prior has its own closed form: about a known axis an angle,
//! on the bound of an angle the root of one monotone equation.

use serde::{Deserialize, Serialize};

use super::{RANK_TOLERANCE, ScaleEstimate, product_form, quaternion_matrix};
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, IDENTITY, Mat3, Vec3};

/// Prior knowledge of a pose. Nothing by default; all parts that are set apply together.
///
/// ```
/// use cfreg::{moments::Moments, pose::{self, Prior, ScaleEstimate, Solver}};
/// // Two places are too few for a rotation, but not for one about the vertical.
/// let mut moments = Moments::about([0.0; 3], [0.0; 3]);
/// moments.add_pair(1.0, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
/// moments.add_pair(1.0, [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]);
/// let prior = Prior { direction: Some([[0.0, 0.0, 1.0]; 2]), ..Prior::default() };
/// assert!(pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed).is_err());
/// let found = pose::solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, &prior)?;
/// assert!((found.transform.angle().to_degrees() - 90.0).abs() < 1e-9);
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Prior {
    /// A direction in the source's frame and the same direction in the target's, of any length: the
    /// rotation maps the first to the second. An example is gravity, if both sensors measured it;
    /// equal directions are a fixed axis, and \[0, 0, 1\] twice leaves only the yaw free.
    pub direction: Option<[Vec3; 2]>,
    /// The known rotation, or a rotation near the one sought.
    pub rotation: Option<RotationBound>,
    /// Smallest and largest scale, both above 0. Only if a scale is estimated.
    pub scale: Option<[f64; 2]>,
}

/// Rotations at most an angle away from a given rotation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RotationBound {
    /// Rotation vector, radians: axis times angle, source into target frame.
    pub vector: Vec3,
    /// Largest angle to the rotation, degrees in [0, 180]; 0 if the rotation is known exactly.
    #[serde(default)]
    pub within_deg: f64,
}

/// Tolerance of a cosine over a bound, for rounding.
const ROUNDING: f64 = 1e-9;

impl Prior {
    /// Returns whether nothing is known.
    pub fn is_none(&self) -> bool {
        *self == Prior::default()
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] with the name of the part that is out of its range, and where a direction
    /// and a rotation contradict each other.
    pub fn validate(&self) -> Result<()> {
        let bad = |part: &str, value: String, rule: &str| {
            Err(Error::config("prior", format!("{part} {value}"), rule))
        };
        for direction in self.direction.iter().flatten() {
            let length = math::norm(*direction);
            if !(length > 1e-150 && length < 1e150) {
                let rule = "a direction must be three finite numbers, not all 0";
                return bad("direction", format!("{direction:?}"), rule);
            }
        }
        if let Some(RotationBound { vector, within_deg }) = self.rotation {
            if !math::norm(vector).is_finite() {
                let rule = "a rotation vector must be three finite numbers";
                return bad("rotation", format!("{vector:?}"), rule);
            }
            if !(0.0..=180.0).contains(&within_deg) {
                return bad("within_deg", within_deg.to_string(), "must be from 0 to 180");
            }
        }
        match self.scale {
            Some([low, high]) if !(low > 0.0 && low <= high && high.is_finite()) => {
                let rule = "must be two scales above 0, the smaller one first";
                bad("scale", format!("[{low}, {high}]"), rule)
            }
            _ => match (self.direction, self.rotation) {
                // The contradiction does not depend on the pairs.
                (Some(direction), Some(_)) => {
                    rotation_about_direction(direction, self.rotation, &IDENTITY, || {
                        Error::NO_WEIGHT
                    })
                    .map(|_| ())
                    .or_else(|error| match error {
                        Error::NoWeight { .. } => Ok(()),
                        error => Err(error),
                    })
                }
                _ => Ok(()),
            },
        }
    }

    /// Checks the ranges, and that the scale is bounded only if it is estimated.
    ///
    /// # Errors
    /// [`Error::Config`] with the reason.
    pub fn validate_for(&self, scale: ScaleEstimate) -> Result<()> {
        self.validate()?;
        if self.scale.is_some() && scale == ScaleEstimate::Fixed {
            let rule = "bounds of a scale need one that is estimated (umeyama or symmetric)";
            return Err(Error::config("prior", "scale", rule));
        }
        Ok(())
    }

    /// Finds the allowed pose nearest to `pose`: the nearest allowed rotation (by ‖R − R'‖_F), and
    /// the translation that maps `center`, in the source's frame, to the same position as `pose`.
    ///
    /// # Errors
    /// As for [`pose::solve_with`](super::solve_with).
    pub fn project_pose(&self, pose: &Transform, center: Vec3) -> Result<Transform> {
        if !self.constrains_rotation() {
            return Ok(*pose);
        }
        let open = || Error::Degenerate { rank: 0, singular_values: [0.0; 3] };
        let rotation =
            self.rotation(&math::transpose(&pose.rotation), || Ok(pose.rotation), open)?;
        let found = Transform { rotation, ..*pose };
        let shift = math::sub(pose.apply(center), found.apply(center));
        Ok(Transform { translation: math::add(found.translation, shift), ..found })
    }

    /// Returns whether the rotation is restricted.
    pub(super) fn constrains_rotation(&self) -> bool {
        self.direction.is_some() || self.rotation.is_some()
    }

    /// Finds the allowed rotation that maximises tr(R C); `free` is the best without a prior.
    ///
    /// # Errors
    /// [`Error::Degenerate`] if the pairs do not constrain the freedom that the prior leaves,
    /// [`Error::Config`] where its direction and rotation contradict each other.
    pub(super) fn rotation(
        &self,
        covariance: &Mat3,
        free: impl FnOnce() -> Result<Mat3>,
        open: impl FnOnce() -> Error,
    ) -> Result<Mat3> {
        match (self.direction, self.rotation) {
            (Some(direction), near) => rotation_about_direction(direction, near, covariance, open),
            (None, Some(near)) => rotation_within_angle(&near, covariance, free),
            (None, None) => free(),
        }
    }
}

impl RotationBound {
    fn center(&self) -> Mat3 {
        Transform::from_rotation_vector(self.vector).rotation
    }

    fn angle(&self) -> f64 {
        self.within_deg.to_radians()
    }
}

/// Returns tr(R M) over the rotations R about the unit vector `axis`, as (a, b, c) of a cos θ + b
/// sin θ + c.
fn trace_about_axis(axis: Vec3, m: &Mat3) -> (f64, f64, f64) {
    let kept = math::dot(axis, math::mat_vec(m, axis));
    let skew = [m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]];
    (math::trace(m) - kept, math::dot(axis, skew), kept)
}

/// Finds the smallest rotation from one unit vector to another.
fn shortest_rotation(from: Vec3, to: Vec3) -> Mat3 {
    let cross = math::cross(from, to);
    let axis = match math::norm(cross) > 1e-12 {
        true => math::normalized(cross),
        // Opposite or equal: any perpendicular axis.
        false => {
            let least = (0..3).min_by(|&i, &j| from[i].abs().total_cmp(&from[j].abs()));
            math::normalized(math::cross(from, IDENTITY[least.unwrap_or(0)]))
        }
    };
    let angle = math::norm(cross).atan2(math::dot(from, to));
    Transform::from_rotation_vector(math::scaled(axis, angle)).rotation
}

/// Finds the rotation that maps one direction to the other, near a given rotation if one is known.
fn rotation_about_direction(
    direction: [Vec3; 2],
    near: Option<RotationBound>,
    covariance: &Mat3,
    open: impl FnOnce() -> Error,
) -> Result<Mat3> {
    let [from, axis] = direction.map(math::normalized);
    let start = shortest_rotation(from, axis);
    let (a, b, _) = trace_about_axis(axis, &math::mat_mul(&start, covariance));
    // Angles about the direction beyond which all rotations are too far from the known one.
    let bound = match near {
        None => None,
        Some(near) => {
            let off = math::mat_mul(&start, &math::transpose(&near.center()));
            let (p, q, kept) = trace_about_axis(axis, &off);
            let cosine = (1.0 + 2.0 * near.angle().cos() - kept) / p.hypot(q);
            if cosine > 1.0 + ROUNDING || cosine.is_nan() {
                let value = format!("rotation within {} degrees", near.within_deg);
                let rule = "no rotation that near maps one direction to the other: widen it";
                return Err(Error::config("prior", value, rule));
            }
            (cosine > -1.0).then(|| (q.atan2(p), cosine.min(1.0).acos()))
        }
    };
    let best = b.atan2(a);
    let angle = match bound {
        Some((middle, reach)) => {
            let turn = std::f64::consts::TAU;
            let off = best - middle;
            middle + (off - turn * (off / turn).round()).clamp(-reach, reach)
        }
        None => best,
    };
    let fixed = bound.is_some_and(|(_, reach)| reach < 1e-6);
    if a.hypot(b) <= RANK_TOLERANCE && !fixed {
        return Err(open());
    }
    let turn = Transform::from_rotation_vector(math::scaled(axis, angle)).rotation;
    Ok(math::mat_mul(&turn, &start))
}

/// Finds the best rotation near a known one: the unrestricted optimum if it is within the angle,
/// else the best on the bound.
///
/// On the bound the quaternion, relative to the known rotation, is (cos α/2, u sin α/2) with a unit
/// vector u that maximises uᵀ B u + 2 k nᵀ u, B and n from Horn's matrix: (μ − B) u = k n with the
/// μ above the eigenvalues of B for which u has length 1.
fn rotation_within_angle(
    near: &RotationBound,
    covariance: &Mat3,
    free: impl FnOnce() -> Result<Mat3>,
) -> Result<Mat3> {
    let center = near.center();
    if near.within_deg == 0.0 {
        return Ok(center);
    }
    let free = free()?;
    let off = math::mat_mul(&free, &math::transpose(&center));
    if Transform::rigid(off, [0.0; 3]).angle() <= near.angle() {
        return Ok(free);
    }
    let [[_, n1, n2, n3], rows @ ..] = product_form(&math::mat_mul(&center, covariance));
    let block = rows.map(|[_, x, y, z]| [x, y, z]);
    let (sin, cos) = (near.angle() / 2.0).sin_cos();
    let (values, vectors) = math::eigen::symmetric(&block);
    let pulls = vectors.map(|v| cos / sin * math::dot(v, [n1, n2, n3]));
    let size = math::norm(pulls);
    let length = |mu: f64| {
        let part = |k: usize| pulls[k] / (mu - values[k]);
        (0..3).map(|k| part(k) * part(k)).sum::<f64>()
    };
    let (mut low, mut high) = (values[2], values[2] + size);
    // To the last bit.
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            break;
        }
        // NaN, from 0/0 on an eigenvalue, is no length above 1.
        if length(middle) > 1.0 { low = middle } else { high = middle }
    }
    let mut parts = [0, 1, 2].map(|k| match high - values[k] {
        gap if gap > 0.0 => pulls[k] / gap,
        _ => 0.0,
    });
    // If the gradient along the best eigenvector is zero, both directions along it are equally
    // good.
    let rest = 1.0 - math::dot(parts, parts);
    if rest > 0.0 {
        parts[2] += (parts[2] * parts[2] + rest).sqrt().copysign(parts[2]) - parts[2];
    }
    let axis = math::normalized([0, 1, 2].map(|i| (0..3).map(|k| vectors[k][i] * parts[k]).sum()));
    let [x, y, z] = math::scaled(axis, sin);
    Ok(math::mat_mul(&quaternion_matrix([cos, x, y, z]), &center))
}

#[cfg(test)]
mod tests;
