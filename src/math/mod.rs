//! Fixed-size algebra: 3-vectors and 3×3 matrices in f64, the symmetric 3×3
//! eigenproblem, 6×6 Cholesky, and f32 elementary functions that vectorise.
//!
//! Matrices are arrays of rows. The one decomposition per solve is faer's ([`crate::pose`]);
//! computations once per point are here.

pub mod cholesky;
pub mod eigen;
pub mod fast;
mod matrix;

pub use matrix::{
    IDENTITY, Mat3, Vec3, add, cross, determinant, dot, frobenius, mat_mul, mat_sub, mat_vec, norm,
    normalized, outer, scaled, sub, trace, transpose,
};
