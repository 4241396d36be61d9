//! Unit quaternions (w, x, y, z), in which headers and splats have rotations.

use crate::math::Mat3;
#[cfg(any(test, feature = "formats"))]
use crate::math::Vec3;

/// Returns the rotation of a unit quaternion.
#[cfg(any(test, feature = "formats"))]
pub(in crate::io) fn to_rotation([w, x, y, z]: [f64; 4]) -> [Vec3; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Returns the unit quaternion of a rotation, with w of 0 or more (Shepperd 1978: by the largest of
/// the four).
pub(in crate::io) fn from_rotation(r: &Mat3) -> [f64; 4] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let largest = [r[0][0], r[1][1], r[2][2]];
    let axis = (0..3).fold(0, |best, k| if largest[k] > largest[best] { k } else { best });
    let quaternion = if trace > largest[axis] {
        [1.0 + trace, r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]]
    } else {
        let (i, j, k) = (axis, (axis + 1) % 3, (axis + 2) % 3);
        let mut q = [0.0; 4];
        q[0] = r[k][j] - r[j][k];
        q[1 + i] = 1.0 + r[i][i] - r[j][j] - r[k][k];
        q[1 + j] = r[j][i] + r[i][j];
        q[1 + k] = r[k][i] + r[i][k];
        q
    };
    let norm = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    let sign = if quaternion[0] < 0.0 { -1.0 } else { 1.0 };
    quaternion.map(|x| sign * x / norm)
}

/// Returns the product: first `b`, then `a`.
pub(in crate::io) fn multiply(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let ([aw, ax, ay, az], [bw, bx, by, bz]) = (a, b);
    [
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;
    use crate::math;

    #[test]
    fn quaternions_are_their_rotations() {
        let vectors =
            [[0.1, 0.2, -0.3], [3.1, 0.0, 0.1], [0.0, -3.1, 0.2], [0.2, 0.1, 3.13], [0.0; 3]];
        for a in vectors {
            let first = Transform::from_rotation_vector(a).rotation;
            let q = from_rotation(&first);
            let off = math::frobenius(&math::mat_sub(&to_rotation(q), &first));
            assert!(off < 1e-14 && q[0] >= 0.0, "{a:?}: {off}");
            for b in vectors {
                let second = Transform::from_rotation_vector(b).rotation;
                let both = to_rotation(multiply(from_rotation(&second), q));
                let off = math::frobenius(&math::mat_sub(&both, &math::mat_mul(&second, &first)));
                assert!(off < 1e-14, "{off}");
            }
        }
    }
}
