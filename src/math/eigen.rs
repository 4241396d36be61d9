//! Eigenvalues and eigenvectors of symmetric 3×3 matrices.

use super::{Mat3, Vec3};

/// Computes eigenvalues in ascending order, and the unit eigenvectors in the same order.
///
/// Cyclic Jacobi rotations: unlike the closed cubic formula they keep the eigenvectors of small
/// eigenvalues of nearly flat neighbourhoods, which are the normals. Deterministic; a zero matrix
/// gives zeros and the identity.
pub fn symmetric(matrix: &Mat3) -> (Vec3, [Vec3; 3]) {
    let [found] = symmetric_many(&[*matrix]);
    found
}

/// Applies [`symmetric`] to each of L matrices, with the same bits. Side by side they take little
/// longer than one, because the steps of one matrix wait for each other. Within a SIMD dispatch
/// this becomes vector code.
#[inline(always)]
pub fn symmetric_many<const L: usize>(matrices: &[Mat3; L]) -> [(Vec3, [Vec3; 3]); L] {
    let each = |of: &dyn Fn(usize) -> f64| std::array::from_fn(of);
    let mut a: [[[f64; L]; 3]; 3] =
        std::array::from_fn(|p| std::array::from_fn(|q| each(&|k| matrices[k][p][q])));
    let one = |p, q| if p == q { [1.0; L] } else { [0.0; L] };
    let mut v: [[[f64; L]; 3]; 3] = std::array::from_fn(|p| std::array::from_fn(|q| one(p, q)));
    // Jacobi converges quadratically: 3×3 takes 4-6 sweeps, 16 are never needed.
    for _ in 0..16 {
        let mut open = [false; L];
        for k in 0..L {
            let off = a[0][1][k].abs() + a[0][2][k].abs() + a[1][2][k].abs();
            let diagonal = a[0][0][k].abs() + a[1][1][k].abs() + a[2][2][k].abs();
            open[k] = off > 1e-17 * diagonal;
        }
        if open == [false; L] {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, &open, p, q);
        }
    }
    std::array::from_fn(|k| {
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| a[i][i][k].total_cmp(&a[j][j][k]));
        (order.map(|i| a[i][i][k]), order.map(|i| [v[0][i][k], v[1][i][k], v[2][i][k]]))
    })
}

/// Applies one Jacobi rotation to every matrix that is still `open`, which makes its `a[p][q]` zero
/// (Golub & Van Loan, 8.5.2).
#[inline(always)]
fn rotate<const L: usize>(
    a: &mut [[[f64; L]; 3]; 3],
    v: &mut [[[f64; L]; 3]; 3],
    open: &[bool; L],
    p: usize,
    q: usize,
) {
    let (app, aqq, apq) = (a[p][p], a[q][q], a[p][q]);
    let (mut c, mut s) = ([1.0; L], [0.0; L]);
    for k in 0..L {
        let theta = (aqq[k] - app[k]) / (2.0 * apq[k]);
        let t = theta.signum() / (theta.abs() + (1.0 + theta * theta).sqrt());
        let t = if open[k] & (apq[k] != 0.0) { t } else { 0.0 };
        c[k] = 1.0 / (1.0 + t * t).sqrt();
        s[k] = t * c[k];
    }
    // Rotates two columns of a row, or two rows.
    let turn = |x: &mut [f64; L], y: &mut [f64; L]| {
        for k in 0..L {
            (x[k], y[k]) = (c[k] * x[k] - s[k] * y[k], s[k] * x[k] + c[k] * y[k]);
        }
    };
    let columns = |row: &mut [[f64; L]; 3]| {
        let [x, y] = row.get_disjoint_mut([p, q]).expect("p is not q");
        turn(x, y);
    };
    a.iter_mut().for_each(columns);
    let [row_p, row_q] = a.get_disjoint_mut([p, q]).expect("p is not q");
    row_p.iter_mut().zip(row_q).for_each(|(x, y)| turn(x, y));
    // Exact symmetry and an exact zero keep the loop's end test valid.
    for k in 0..L {
        let kept = if open[k] { 0.0 } else { apq[k] };
        (a[p][q][k], a[q][p][k]) = (kept, kept);
    }
    v.iter_mut().for_each(columns);
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
    fn many_are_the_same_bits_as_one() {
        let matrices: [Mat3; 8] = std::array::from_fn(|k| {
            let x = k as f64;
            [[x, 0.3 * x, 0.1], [0.3 * x, 2.0, 1e-9 * x], [0.1, 1e-9 * x, 7.0 - x]]
        });
        let all = symmetric_many(&matrices);
        for (matrix, found) in matrices.iter().zip(all) {
            assert_eq!(symmetric(matrix), found);
        }
    }

    #[test]
    fn special_matrices() {
        assert_eq!(symmetric(&[[0.0; 3]; 3]).0, [0.0; 3]);
        assert_eq!(
            symmetric(&[[3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]]).0,
            [1.0, 2.0, 3.0]
        );
        // Entries whose squares overflow or underflow.
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
