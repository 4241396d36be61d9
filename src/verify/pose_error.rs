//! Errors of a pose against a known truth.

use serde::Serialize;

use crate::cloud::Transform;
use crate::math::{self, Vec3};

/// Error of a pose against the true pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PoseError {
    /// Angle between the two rotations, degrees in [0, 180].
    pub rotation_deg: f64,
    /// `‖I − R R_gtᵀ‖_F` in [0, 2√2]: the paper's accuracy (section IV-D).
    pub rotation_frobenius: f64,
    /// Distance between the positions of the centre (the source's centroid) under the two poses, in
    /// the target's unit. Unlike the difference of the translation vectors, this distance does not
    /// grow with the distance of the coordinates from zero.
    pub translation: f64,
}

/// Compares `estimate` with `truth`, both from source to target, about `center` in the
/// source's frame.
pub fn pose_error(estimate: &Transform, truth: &Transform, center: Vec3) -> PoseError {
    let rotation = math::mat_mul(&estimate.rotation, &math::transpose(&truth.rotation));
    let shift = math::sub(estimate.apply(center), truth.apply(center));
    PoseError {
        rotation_deg: Transform::rigid(rotation, [0.0; 3]).angle().to_degrees(),
        rotation_frobenius: math::frobenius(&math::mat_sub(&math::IDENTITY, &rotation)),
        translation: math::norm(shift),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_a_known_difference() {
        let truth = Transform::from_rotation_vector([0.3, -0.7, 1.1]);
        let mut off = Transform::from_rotation_vector([0.0, 0.0, 0.1]);
        off.translation = [0.0, 3.0, 4.0];
        let error = pose_error(&off.after(&truth), &truth, [0.0; 3]);
        assert!((error.rotation_deg - 0.1f64.to_degrees()).abs() < 1e-9);
        // ‖I − R‖_F = 2√2 sin(angle/2).
        assert!((error.rotation_frobenius - 8f64.sqrt() * 0.05f64.sin()).abs() < 1e-12);
        assert!((error.translation - 5.0).abs() < 1e-12);
        assert_eq!(pose_error(&truth, &truth, [1e6; 3]).translation, 0.0);
    }
}
