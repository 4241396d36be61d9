//! Horn 1987: "Closed-form solution of absolute orientation using unit quaternions".

use super::{largest_eigenvector, quaternion_matrix};
use crate::error::Result;
use crate::math::Mat3;

/// The quaternion that maximises qᵀ N q, N from the sums of products S = Σw p qᵀ.
pub(super) fn rotation(s: &Mat3) -> Result<Mat3> {
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = *s;
    let n = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ];
    Ok(quaternion_matrix(largest_eigenvector(&n)?))
}
