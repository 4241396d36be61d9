//! Poses.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::math::{self, IDENTITY, Mat3, Vec3};

/// `x ↦ s R x + t`, from the source's frame into the target's: `T_target_source`.
///
/// Rigid (`scale` = 1) unless a scale was asked for. Serialised as the 4×4
/// homogeneous matrix, four rows of four.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(into = "[[f64; 4]; 4]", try_from = "[[f64; 4]; 4]")]
pub struct Transform {
    /// Rotation R, row-major, det R = +1.
    pub rotation: Mat3,
    /// Translation t, in the unit of the coordinates.
    pub translation: Vec3,
    /// Scale s > 0.
    pub scale: f64,
}

impl Transform {
    /// The identity: maps every point to itself.
    pub const IDENTITY: Transform =
        Transform { rotation: IDENTITY, translation: [0.0; 3], scale: 1.0 };

    /// Creates a rigid motion.
    pub fn rigid(rotation: Mat3, translation: Vec3) -> Self {
        Transform { rotation, translation, scale: 1.0 }
    }

    /// Creates a rotation by the length of `vector` (radians) about its direction (Rodrigues),
    /// without translation. The vector is the "rotation vector" of the paper's section IV.
    ///
    /// ```
    /// let quarter = cfreg::Transform::from_rotation_vector([0.0, 0.0, std::f64::consts::FRAC_PI_2]);
    /// let y = quarter.apply([1.0, 0.0, 0.0]);
    /// assert!((y[1] - 1.0).abs() < 1e-15);
    /// ```
    pub fn from_rotation_vector(vector: Vec3) -> Self {
        let angle = math::norm(vector);
        let [x, y, z] = math::normalized(vector);
        let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        let k2 = math::mat_mul(&k, &k);
        let (sin, cos) = angle.sin_cos();
        let rotation = std::array::from_fn(|i| {
            std::array::from_fn(|j| IDENTITY[i][j] + sin * k[i][j] + (1.0 - cos) * k2[i][j])
        });
        Transform::rigid(rotation, [0.0; 3])
    }

    /// Returns the homogeneous 4×4 matrix, row-major.
    pub fn matrix(&self) -> [[f64; 4]; 4] {
        let row = |i: usize| {
            let r = math::scaled(self.rotation[i], self.scale);
            [r[0], r[1], r[2], self.translation[i]]
        };
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// Reads a homogeneous 4×4 matrix whose upper left is `s R`.
    ///
    /// # Errors
    /// [`Error::Config`] when the matrix is not finite, its last row is not `0 0 0 1`, or `s R` is
    /// not a positive multiple of a rotation to 1e-3 (matrices printed with few digits pass and are
    /// not altered).
    pub fn from_matrix(matrix: [[f64; 4]; 4]) -> Result<Self> {
        let bad = |rule: &str| Error::config("transform", format!("{matrix:?}"), rule);
        if matrix.as_flattened().iter().any(|value| !value.is_finite()) {
            return Err(bad("every entry must be finite"));
        }
        if matrix[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(bad("the last row must be 0 0 0 1"));
        }
        let linear: Mat3 = [0, 1, 2].map(|i| [matrix[i][0], matrix[i][1], matrix[i][2]]);
        let determinant = math::determinant(&linear);
        if determinant <= 0.0 {
            return Err(bad("the upper left 3x3 must have a positive determinant"));
        }
        // A valid rotation keeps its digits: dividing by 1 ± 1e-16 would change them.
        let scale = determinant.cbrt();
        let scale = if (scale - 1.0).abs() < 1e-6 { 1.0 } else { scale };
        let rotation = linear.map(|row| math::scaled(row, 1.0 / scale));
        let gram = math::mat_mul(&rotation, &math::transpose(&rotation));
        let off = math::frobenius(&math::mat_sub(&gram, &IDENTITY));
        // NaN where entries are so large that their products are not finite.
        if off.is_nan() || off > 1e-3 {
            return Err(bad("the upper left 3x3 must be a rotation, or a rotation times a scale"));
        }
        let translation = [0, 1, 2].map(|i| matrix[i][3]);
        Ok(Transform { rotation, translation, scale })
    }

    /// Maps a point.
    pub fn apply(&self, point: Vec3) -> Vec3 {
        math::add(math::scaled(self.rotate(point), self.scale), self.translation)
    }

    /// Maps a direction: rotation only.
    pub fn rotate(&self, direction: Vec3) -> Vec3 {
        math::mat_vec(&self.rotation, direction)
    }

    /// Composes two transforms: first `first`, then `self`.
    pub fn after(&self, first: &Transform) -> Transform {
        Transform {
            rotation: math::mat_mul(&self.rotation, &first.rotation),
            translation: self.apply(first.translation),
            scale: self.scale * first.scale,
        }
    }

    /// Returns the inverse: target into source.
    pub fn inverse(&self) -> Transform {
        let rotation = math::transpose(&self.rotation);
        let scale = 1.0 / self.scale;
        let translation = math::scaled(math::mat_vec(&rotation, self.translation), -scale);
        Transform { rotation, translation, scale }
    }

    /// Returns the angle of the rotation, radians in [0, π].
    ///
    /// Uses both sine and cosine, so that the angle keeps its digits near 0 and π.
    pub fn angle(&self) -> f64 {
        let r = &self.rotation;
        let sin = math::norm([r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]) / 2.0;
        let cos = (math::trace(r) - 1.0) / 2.0;
        sin.atan2(cos)
    }

    /// Returns the rotation vector of the rotation: axis times [`angle`](Self::angle), radians; the
    /// inverse of [`from_rotation_vector`](Self::from_rotation_vector) up to length π.
    ///
    /// Computed by the unit quaternion, from the row of its products that is largest (Shepperd
    /// 1978).
    pub fn rotation_vector(&self) -> Vec3 {
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.rotation;
        let products = [
            [1.0 + xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, 1.0 + xx - yy - zz, xy + yx, xz + zx],
            [xz - zx, xy + yx, 1.0 - xx + yy - zz, yz + zy],
            [yx - xy, xz + zx, yz + zy, 1.0 - xx - yy + zz],
        ];
        let largest = (1..4).fold(0, |k, l| if products[l][l] > products[k][k] { l } else { k });
        let row = products[largest];
        let sign = if row[0] < 0.0 { -1.0 } else { 1.0 };
        let [w, x, y, z] =
            row.map(|value| sign * value / (2.0 * products[largest][largest].sqrt()));
        let sin = math::norm([x, y, z]);
        math::scaled(math::normalized([x, y, z]), 2.0 * sin.atan2(w))
    }
}

impl From<Transform> for [[f64; 4]; 4] {
    fn from(transform: Transform) -> Self {
        transform.matrix()
    }
}

impl TryFrom<[[f64; 4]; 4]> for Transform {
    type Error = Error;
    fn try_from(matrix: [[f64; 4]; 4]) -> Result<Self> {
        Transform::from_matrix(matrix)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: &Transform, b: &Transform) {
        let (a, b) = (a.matrix(), b.matrix());
        for (x, y) in a.as_flattened().iter().zip(b.as_flattened()) {
            assert!((x - y).abs() < 1e-12, "{a:?} {b:?}");
        }
    }

    #[test]
    fn inverse_undoes_and_matrix_round_trips() {
        let mut transform = Transform::from_rotation_vector([0.3, -1.2, 2.0]);
        transform.translation = [5.0, -7.0, 0.25];
        transform.scale = 2.5;
        close(&transform.after(&transform.inverse()), &Transform::IDENTITY);
        close(&Transform::from_matrix(transform.matrix()).unwrap(), &transform);
    }

    #[test]
    fn angle_keeps_its_digits_at_both_ends() {
        for angle in [0.0, 1e-9, 0.5, 3.0, std::f64::consts::PI - 1e-9] {
            let turn = Transform::from_rotation_vector([angle, 0.0, 0.0]);
            assert!((turn.angle() - angle).abs() < 1e-15, "{angle}");
        }
    }

    #[test]
    fn rotation_vectors_round_trip() {
        for axis in [[0.6, 0.0, -0.8], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [-0.48, 0.6, 0.64]] {
            for angle in [0.0, 1e-9, 0.5, 2.0, 3.1, std::f64::consts::PI - 1e-6] {
                let vector = math::scaled(axis, angle);
                let found = Transform::from_rotation_vector(vector).rotation_vector();
                assert!(math::norm(math::sub(found, vector)) < 1e-14, "{found:?} {vector:?}");
            }
        }
    }

    #[test]
    fn matrices_that_are_no_pose_are_refused() {
        let mut mirror = Transform::IDENTITY.matrix();
        mirror[2][2] = -1.0;
        let mut shear = Transform::IDENTITY.matrix();
        shear[0][1] = 0.5;
        let mut nan = Transform::IDENTITY.matrix();
        nan[0][3] = f64::NAN;
        let mut projective = Transform::IDENTITY.matrix();
        projective[3][0] = 0.1;
        // The determinant of this matrix is inf - inf.
        let huge = [
            [0.9, 1.2, -2.0, 1.5],
            [-2.0, 1e308, 0.0, -2.0],
            [1.2, 1.6, -1e308, 0.25],
            [0.0, 0.0, 0.0, 1.0],
        ];
        for matrix in [mirror, shear, nan, projective, huge] {
            assert!(matches!(Transform::from_matrix(matrix), Err(Error::Config { .. })));
        }
    }
}
