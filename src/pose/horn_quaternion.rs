//! Horn 1987: "Closed-form solution of absolute orientation using unit quaternions".

use super::{largest_eigenvector, quaternion_matrix};
use crate::error::Result;
use crate::math::Mat3;

/// Finds the quaternion that maximises qᵀ N q, N from the sums of products S = Σw p qᵀ.
pub(super) fn rotation(s: &Mat3) -> Result<Mat3> {
    Ok(quaternion_matrix(largest_eigenvector(&product_form(s))?))
}

/// Returns N with qᵀ N q = Σw q·R(q) p for unit quaternions `[w, x, y, z]`, from S = Σw p qᵀ.
pub(crate) fn product_form(s: &Mat3) -> [[f64; 4]; 4] {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = *s;
    [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ]
}
