//! Symmetric positive definite systems of few unknowns; six for one Gauss-Newton step of a pose.

/// A vector of six.
pub type Vec6 = [f64; 6];
/// A 6×6 matrix as rows.
pub type Mat6 = [[f64; 6]; 6];

/// Computes the Cholesky factor L of `a` = L Lᵀ (reads the lower triangle only); `None` unless
/// every pivot is positive.
pub fn factor<const N: usize>(a: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut l = [[0.0; N]; N];
    for i in 0..N {
        for j in 0..=i {
            let rest = a[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            if i != j {
                l[i][j] = rest / l[j][j];
            } else if rest > 0.0 && rest.is_finite() {
                l[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(l)
}

/// Solves L Lᵀ x = `b` for x.
pub fn solve<const N: usize>(l: &[[f64; N]; N], b: &[f64; N]) -> [f64; N] {
    let mut x = *b;
    for i in 0..N {
        let rest = x[i] - (0..i).map(|k| l[i][k] * x[k]).sum::<f64>();
        x[i] = rest / l[i][i];
    }
    for i in (0..N).rev() {
        let rest = x[i] - (i + 1..N).map(|k| l[k][i] * x[k]).sum::<f64>();
        x[i] = rest / l[i][i];
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_solution_solves() {
        let root: Mat6 = std::array::from_fn(|i| {
            std::array::from_fn(|j| ((3 * i + 5 * j) as f64).sin() + if i == j { 3.0 } else { 0.0 })
        });
        let a: Mat6 = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..6).map(|k| root[i][k] * root[j][k]).sum())
        });
        let want = [1.0, -2.0, 3.0, 0.5, 0.0, -7.0];
        let b: Vec6 = std::array::from_fn(|i| (0..6).map(|j| a[i][j] * want[j]).sum());
        let found = solve(&factor(&a).unwrap(), &b);
        assert!(found.iter().zip(want).all(|(x, y)| (x - y).abs() < 1e-10), "{found:?}");
    }

    #[test]
    fn what_is_not_positive_definite_has_no_factor() {
        let mut a = [[0.0; 6]; 6];
        (0..6).for_each(|i| a[i][i] = 1.0);
        assert!(factor(&a).is_some());
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            a[4][4] = bad;
            assert!(factor(&a).is_none());
        }
    }
}
