//! Eigenvalues and eigenvectors of a symmetric 3×3 matrix.

use super::{IDENTITY, Mat3, Vec3};

/// Eigenvalues in ascending order, and the unit eigenvectors in the same order.
///
/// Cyclic Jacobi rotations: unlike the closed cubic formula it keeps the small
/// eigenvectors of nearly flat neighbourhoods, which is what normals are.
/// Deterministic; a zero matrix gives zeros and the identity.
pub fn symmetric(matrix: &Mat3) -> (Vec3, [Vec3; 3]) {
    let mut a = *matrix;
    let mut v = IDENTITY;
    // Jacobi converges quadratically: 3×3 takes 4-6 sweeps, 16 cannot be needed.
    for _ in 0..16 {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        let diagonal = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        if off <= 1e-17 * diagonal || off == 0.0 {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
    (order.map(|i| a[i][i]), order.map(|i| [v[0][i], v[1][i], v[2][i]]))
}

/// One Jacobi rotation that makes `a[p][q]` zero (Golub & Van Loan, 8.5.2).
fn rotate(a: &mut Mat3, v: &mut Mat3, p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (1.0 + theta * theta).sqrt());
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = t * c;
    for row in a.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
    for k in 0..3 {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
    }
    // Exact symmetry and an exact zero keep the loop's end test honest.
    (a[p][q], a[q][p]) = (0.0, 0.0);
    for row in v.iter_mut() {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{dot, mat_vec, norm, scaled, sub};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn is_an_orthonormal_decomposition(x in proptest::array::uniform6(-10.0..10.0f64)) {
            let m = [[x[0], x[1], x[2]], [x[1], x[3], x[4]], [x[2], x[4], x[5]]];
            let (values, vectors) = symmetric(&m);
            prop_assert!(values[0] <= values[1] && values[1] <= values[2]);
            for i in 0..3 {
                prop_assert!(norm(sub(mat_vec(&m, vectors[i]), scaled(vectors[i], values[i]))) < 1e-13 * 30.0);
                for j in 0..3 {
                    let want = if i == j { 1.0 } else { 0.0 };
                    prop_assert!((dot(vectors[i], vectors[j]) - want).abs() < 1e-14);
                }
            }
        }
    }

    #[test]
    fn special_matrices() {
        assert_eq!(symmetric(&[[0.0; 3]; 3]).0, [0.0; 3]);
        assert_eq!(
            symmetric(&[[3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]]).0,
            [1.0, 2.0, 3.0]
        );
        // Entries whose squares over- or underflow.
        for scale in [1e-150, 1e150] {
            let m =
                [[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 5.0]].map(|row| scaled(row, scale));
            let (values, _) = symmetric(&m);
            for (value, want) in values.iter().zip([1.0, 3.0, 5.0]) {
                assert!((value / scale - want).abs() < 1e-14);
            }
        }
    }
}
