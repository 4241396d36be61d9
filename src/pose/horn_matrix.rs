//! Horn, Hilden and Negahdaripour 1988: "Closed-form solution of absolute orientation
//! using orthonormal matrices".

use crate::math::{self, Mat3};

/// Computes R = M (MᵀM)^(−½) with M = Σw q pᵀ, by the eigenvectors u₁, u₂, u₃ of MᵀM: R maps them
/// to M u / √λ.
///
/// The third image is the cross product of the first two instead of M u₃ / √λ₃. It is the same
/// where det M > 0, gives the nearest rotation where M reflects, and is defined where M has rank
/// two (the paper's planar case).
pub(super) fn rotation(covariance: &Mat3) -> Mat3 {
    let m = math::transpose(covariance);
    let (_, vectors) = math::eigen::symmetric(&math::mat_mul(covariance, &m));
    let (u1, u2) = (vectors[2], vectors[1]);
    let a1 = math::normalized(math::mat_vec(&m, u1));
    let image = math::mat_vec(&m, u2);
    let a2 = math::normalized(math::sub(image, math::scaled(a1, math::dot(a1, image))));
    let (a3, u3) = (math::cross(a1, a2), math::cross(u1, u2));
    let terms = [math::outer(a1, u1), math::outer(a2, u2), math::outer(a3, u3)];
    [0, 1, 2].map(|i| math::add(math::add(terms[0][i], terms[1][i]), terms[2][i]))
}
