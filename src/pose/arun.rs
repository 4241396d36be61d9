//! Arun, Huang and Blostein 1987: "Least-squares fitting of two 3-D point sets".

use crate::error::{Error, Result};
use crate::math::{self, Mat3, Vec3};

/// H = U Σ Vᵀ, singular values descending, vectors as columns.
pub(super) struct Decomposition {
    u: Mat3,
    pub(super) values: Vec3,
    v: Mat3,
}

pub(super) fn decompose(covariance: &Mat3) -> Result<Decomposition> {
    let svd = faer::Mat::from_fn(3, 3, |i, j| covariance[i][j])
        .svd()
        .map_err(|_| Error::NonFinite { what: "the cross-covariance".into(), index: 0 })?;
    let matrix = |m: faer::MatRef<'_, f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]));
    let values = [0, 1, 2].map(|k| svd.S().column_vector()[k]);
    Ok(Decomposition { u: matrix(svd.U()), values, v: matrix(svd.V()) })
}

/// Computes R = V Uᵀ; if this is a reflection, the last column of V changes its sign (the paper,
/// below eq. 9).
pub(super) fn rotation(svd: &Decomposition) -> Mat3 {
    let mut v = svd.v;
    if math::determinant(&svd.u) * math::determinant(&v) < 0.0 {
        v.iter_mut().for_each(|row| row[2] = -row[2]);
    }
    math::mat_mul(&v, &math::transpose(&svd.u))
}
