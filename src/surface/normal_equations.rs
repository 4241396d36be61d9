//! Normal equations of a small motion: of six unknowns, a rotation vector and a translation, or of
//! seven, with the logarithm of a scale last.

use crate::math::cholesky;
use crate::math::{self, Mat3, Vec3};

/// Σ w JᵀMJ, Σ w JᵀMe and Σ w eᵀMe over residuals e with Jacobians J = ∂e/∂motion.
///
/// Point-to-plane residuals are scalars along a direction, with M = 1 ([`add_row`]); those of
/// generalized ICP are 3-vectors, with M the inverse of a covariance ([`add_residual`]).
///
/// [`add_row`]: Self::add_row
/// [`add_residual`]: NormalEquations::add_residual
#[derive(Debug, Clone, Copy)]
pub(crate) struct NormalEquations<const N: usize> {
    pub(crate) hessian: [[f64; N]; N],
    pub(crate) gradient: [f64; N],
    pub(crate) error: f64,
}

impl<const N: usize> NormalEquations<N> {
    pub(crate) const ZERO: Self =
        NormalEquations { hessian: [[0.0; N]; N], gradient: [0.0; N], error: 0.0 };

    /// Adds one scalar residual with its Jacobian, a row.
    pub(crate) fn add_row(&mut self, weight: f64, row: &[f64; N], residual: f64) {
        for u in 0..N {
            self.gradient[u] += weight * row[u] * residual;
            (0..N).for_each(|v| self.hessian[u][v] += weight * row[u] * row[v]);
        }
    }

    /// Adds the sums of other residuals.
    pub(crate) fn merge(&mut self, other: &Self) {
        for u in 0..N {
            self.gradient[u] += other.gradient[u];
            (0..N).for_each(|v| self.hessian[u][v] += other.hessian[u][v]);
        }
        self.error += other.error;
    }

    /// Mean of the diagonal of the Hessian.
    pub(crate) fn mean_curvature(&self) -> f64 {
        (0..N).map(|u| self.hessian[u][u]).sum::<f64>() / N as f64
    }

    /// Smallest pivot of the Hessian over the mean of its diagonal: how well the least constrained
    /// motion is constrained; 0 for a Hessian that is not positive definite.
    pub(crate) fn min_pivot(&self) -> f64 {
        let pivots =
            cholesky::factor(&self.hessian).map(|l| (0..N).map(move |u| l[u][u] * l[u][u]));
        pivots.map_or(0.0, |pivots| pivots.fold(f64::INFINITY, f64::min) / self.mean_curvature())
    }

    /// Returns the motion that minimises the quadratic model, with `damping` added to the diagonal
    /// of the Hessian; `None` unless the damped Hessian is positive definite.
    pub(crate) fn solve(&self, damping: f64) -> Option<[f64; N]> {
        let mut damped = self.hessian;
        (0..N).for_each(|u| damped[u][u] += damping);
        Some(cholesky::solve(&cholesky::factor(&damped)?, &self.gradient.map(|x| -x)))
    }
}

impl NormalEquations<6> {
    /// Adds a 3-vector residual at the moved point `at`, with the symmetric `information` M.
    pub(crate) fn add_residual(&mut self, weight: f64, e: Vec3, at: Vec3, information: &Mat3) {
        // A unit rotation about each axis, a unit translation along each.
        let columns = [
            [0.0, -at[2], at[1]],
            [at[2], 0.0, -at[0]],
            [-at[1], at[0], 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
        ];
        let pulled = math::mat_vec(information, e);
        self.error += weight * math::dot(e, pulled);
        for a in 0..6 {
            self.gradient[a] += weight * math::dot(columns[a], pulled);
            let held = math::scaled(math::mat_vec(information, columns[a]), weight);
            (0..=a).for_each(|b| self.hessian[a][b] += math::dot(columns[b], held));
        }
    }
}

/// Derivative of the distance along `direction` of a point at `arm` from the centre of rotation by
/// a rotation vector and by a translation in units of `length`.
pub(crate) fn twist_row(arm: Vec3, direction: Vec3, length: f64) -> [f64; 6] {
    let [a, b, c] = math::cross(arm, direction);
    let [x, y, z] = math::scaled(direction, length);
    [a, b, c, x, y, z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;

    #[test]
    fn the_gradient_is_the_derivative_of_the_error() {
        let (e, at) = ([0.3, -0.2, 0.5], [1.0, 2.0, -0.7]);
        let information = [[2.0, 0.3, -0.1], [0.3, 1.0, 0.2], [-0.1, 0.2, 0.5]];
        let mut system = NormalEquations::<6>::ZERO;
        system.add_residual(2.0, e, at, &information);
        let error = |[a, b, c, x, y, z]: [f64; 6]| {
            let turned = Transform::from_rotation_vector([a, b, c]).apply(at);
            let e = math::add(math::sub(math::add(turned, [x, y, z]), at), e);
            2.0 * math::dot(e, math::mat_vec(&information, e))
        };
        for axis in 0..6 {
            let (mut up, mut down) = ([0.0; 6], [0.0; 6]);
            (up[axis], down[axis]) = (1e-5, -1e-5);
            let slope = (error(up) - error(down)) / 2e-5;
            let gradient = 2.0 * system.gradient[axis];
            assert!((slope - gradient).abs() < 1e-5 * slope.abs().max(1.0), "{axis}");
        }
    }

    #[test]
    fn a_row_is_a_residual_along_its_direction() {
        let (e, at) = ([0.3, -0.2, 0.5], [1.0, 2.0, -0.7]);
        let n = [0.0, 0.6, 0.8];
        let (mut rows, mut residuals) = (NormalEquations::<6>::ZERO, NormalEquations::<6>::ZERO);
        rows.add_row(2.0, &twist_row(at, n, 1.0), math::dot(n, e));
        residuals.add_residual(2.0, e, at, &math::outer(n, n));
        for a in 0..6 {
            assert!((rows.gradient[a] - residuals.gradient[a]).abs() < 1e-14);
            for b in 0..=a {
                assert!((rows.hessian[a][b] - residuals.hessian[a][b]).abs() < 1e-14);
            }
        }
    }

    #[test]
    fn a_solution_makes_the_error_least() {
        let mut system = NormalEquations::<6>::ZERO;
        let motion = [0.1, -0.2, 0.3, 1.0, 2.0, -1.0];
        for k in 0..20 {
            let x = f64::from(k);
            let arm = [x.sin(), (1.3 * x).cos(), (2.0 * x).sin()];
            let direction = [(0.7 * x).cos(), (1.9 * x).sin(), 0.3 + (3.1 * x).cos()];
            let row = twist_row(arm, direction, 2.0);
            let residual = -row.iter().zip(motion).map(|(a, b)| a * b).sum::<f64>();
            system.add_row(1.0 + 0.1 * x, &row, residual);
        }
        let found = system.solve(0.0).unwrap();
        assert!(found.iter().zip(motion).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        assert!(system.min_pivot() > 0.0 && system.min_pivot() < 1.0);
        let nothing = NormalEquations::<7>::ZERO;
        assert!(nothing.solve(0.0).is_none() && nothing.min_pivot() == 0.0);
    }
}
