//! Bound on how much better than the rotation found any other rotation can be.
//!
//! With residuals in units of their bounds, truncated least squares Σₖ min(‖bₖ − R aₖ‖², 1) is a
//! quadratic form xᵀ Q x of x = [q, θ₁q, …, θ_K q]: q the quaternion of R and θₖ = ±1 for kept and
//! truncated (TEASER's binary cloning). For these x, qₖqₖᵀ = qqᵀ, and qᵢqⱼᵀ is symmetric: forms Λ
//! whose diagonal blocks sum to zero and whose other blocks are skew vanish on them. As ‖x‖² = K +
//! 1, no rotation costs less than μ + (K + 1) min(0, λ_min(Q − μJ − Λ)), where J is 1 on the first
//! block: the weak duality of the paper's optimality certification. The rotation is optimal if a Λ
//! makes that μ its own cost.
//!
//! Λ is found by Douglas-Rachford splitting between the positive semidefinite matrices and those of
//! the form Q − μJ − Λ, as in TEASER++. Everything is expressed relative to R (a and Rᵀb for a and
//! b, and θₖqₖ for qₖ), which makes x = [e, …, e] with e = (1, 0, 0, 0): then the nearest matrix of
//! that form that also has x in its kernel, as the optimal one must, has a closed form, without a
//! linear system.

use faer::{Mat, Side};

use super::rotation::{self, GncOptions};
use crate::cloud::Transform;
use crate::error::Result;
use crate::math::{self, Mat3, Vec3};
use crate::method::registration::Certificate;
use crate::pose::{self, Prior};
use crate::verify;

/// Gap at which the splitting ends.
const GAP_TOLERANCE: f64 = 1e-3;
/// Most rounds; if the gap closes, 20 are usual.
const MAX_ITERATIONS: u32 = 200;
/// Step of the splitting, below 2. Chosen by hand.
const RELAXATION: f64 = 1.99;
/// Cost per difference below which it is rounding.
const MIN_COST: f64 = 1e-6;

/// Returns the certificate of b ≈ R a truncated at `bound`; `None` if the rotation is unconstrained
/// by the measurements.
pub(super) fn certify(
    measurements: &[(Vec3, Vec3)],
    bound: f64,
    schedule: GncOptions,
    answer: &Transform,
) -> Option<Certificate> {
    let in_bounds = |v: Vec3| math::scaled(v, 1.0 / bound);
    let measurements: Vec<(Vec3, Vec3)> =
        measurements.iter().map(|&(a, b)| (in_bounds(a), in_bounds(b))).collect();
    let (rotation, cost) = minimize_truncated_cost(&measurements, schedule).ok()?;
    let dual = DualProblem::new(&measurements, &rotation, cost);
    let (gap, iterations) = dual.minimize_gap()?;
    let found = Transform { rotation, ..*answer };
    let rotation_deg = verify::pose_error(&found, answer, [0.0; 3]).rotation_deg;
    Some(Certificate { gap, rotation_deg, differences: measurements.len(), iterations })
}

/// Returns a rotation that is the least-squares one of the measurements within its bound of 1, and
/// its truncated cost.
fn minimize_truncated_cost(
    measurements: &[(Vec3, Vec3)],
    schedule: GncOptions,
) -> Result<(Mat3, f64)> {
    let (rounds, _) = rotation::estimate_rotation(measurements, 1.0, schedule, &Prior::default())?;
    let mut rotation = rounds.last().map_or(math::IDENTITY, |round| round.rotation);
    let mut weights = Vec::new();
    // Every pass lowers the cost, so that the loop ends; a limit all the same.
    for _ in 0..100 {
        let kept: Vec<f64> = squared_residuals(measurements, &rotation)
            .map(|r| if r <= 1.0 { 1.0 } else { 0.0 })
            .collect();
        if kept == weights {
            break;
        }
        rotation = rotation::solve_rotation(measurements, &kept, &Prior::default())?;
        weights = kept;
    }
    Ok((rotation, squared_residuals(measurements, &rotation).map(|r| r.min(1.0)).sum()))
}

/// Returns the squared residuals.
fn squared_residuals<'a>(
    measurements: &'a [(Vec3, Vec3)],
    rotation: &'a Mat3,
) -> impl Iterator<Item = f64> + 'a {
    measurements.iter().map(move |&(a, b)| {
        let rest = math::sub(b, math::mat_vec(rotation, a));
        math::dot(rest, rest)
    })
}

type Block = [[f64; 4]; 4];

/// The matrices Q − μJ − Λ, K + 1 blocks of 4 rows, about the rotation found.
struct DualProblem {
    cost: f64,
    /// Blocks (0, k) of Q.
    first_row_blocks: Vec<Block>,
    /// Sum of the diagonal blocks.
    diagonal_sum: Block,
    /// Initial matrix of the splitting.
    initial: Mat<f64>,
}

impl DualProblem {
    fn new(measurements: &[(Vec3, Vec3)], rotation: &Mat3, cost: f64) -> Self {
        let n = measurements.len() + 1;
        let mut start = Mat::zeros(4 * n, 4 * n);
        let identity = |x: f64| -> Block {
            [0, 1, 2, 3].map(|r| [0, 1, 2, 3].map(|c| if r == c { x } else { 0.0 }))
        };
        let mut ties = vec![identity(0.0)];
        let mut sum = identity(-cost);
        let mut first = sum;
        let back = math::transpose(rotation);
        for (k, (&(a, b), r)) in
            measurements.iter().zip(squared_residuals(measurements, rotation)).enumerate()
        {
            let form = pose::product_form(&math::outer(a, math::mat_vec(&back, b)));
            let squares = math::dot(a, a) + math::dot(b, b);
            let sign = if r <= 1.0 { 0.5 } else { -0.5 };
            let tie =
                combine_blocks(&identity((squares - 1.0) / 2.0), &form, |x, p| sign * (x - p));
            let own = combine_blocks(&identity((squares + 1.0) / 2.0), &form, |x, p| x - p);
            // Half of the measurement's excess over its share of the cost remains with it, half
            // goes to the first block: both then have equal parts of their coupling.
            let mut half = combine_blocks(&own, &identity(r.min(1.0)), |x, p| (x - p) / 2.0);
            for r in 0..4 {
                (half[r][0], half[0][r]) = (-tie[r][0], -tie[r][0]);
            }
            first =
                combine_blocks(&first, &combine_blocks(&own, &half, |x, h| x - h), |x, y| x + y);
            sum = combine_blocks(&sum, &own, |x, y| x + y);
            let at = 4 * (k + 1);
            for (r, c) in block_entries() {
                start[(at + r, at + c)] = half[r][c];
                start[(r, at + c)] = tie[r][c];
                start[(at + c, r)] = tie[r][c];
            }
            ties.push(tie);
        }
        block_entries().for_each(|(r, c)| start[(r, c)] = first[r][c]);
        DualProblem { cost, first_row_blocks: ties, diagonal_sum: sum, initial: start }
    }

    /// Returns the smallest gap found and the number of rounds; `None` if an eigendecomposition
    /// failed.
    fn minimize_gap(self) -> Option<(f64, u32)> {
        let n = self.first_row_blocks.len() as f64;
        let size = self.cost.max(MIN_COST * (n - 1.0));
        let mut point = self.initial.clone();
        let mut gap = 1.0f64;
        for round in 1..=MAX_ITERATIONS {
            let positive = project_to_psd(&point)?;
            let mut near = &positive + &positive - &point;
            self.project_to_dual(&mut near);
            let least = *near.self_adjoint_eigenvalues(Side::Lower).ok()?.first()?;
            gap = gap.min(n * (-least).max(0.0) / size);
            if gap <= GAP_TOLERANCE {
                return Some((gap, round));
            }
            for (j, column) in point.col_iter_mut().enumerate() {
                for (i, x) in column.iter_mut().enumerate() {
                    *x += RELAXATION * (near[(i, j)] - positive[(i, j)]);
                }
            }
        }
        Some((gap, MAX_ITERATIONS))
    }

    /// Projects the symmetric `x` to the nearest matrix of the form Q − μJ − Λ with [e, …, e] in
    /// its kernel.
    fn project_to_dual(&self, x: &mut Mat<f64>) {
        let n = self.first_row_blocks.len();
        let mut excess = self.diagonal_sum;
        for (i, (r, c)) in (0..n).flat_map(|i| block_entries().map(move |at| (i, at))) {
            excess[r][c] -= x[(4 * i + r, 4 * i + c)];
        }
        // Residual of each block row: its product with [e, …, e], which shall be zero.
        let mut rest = vec![[0.0; 4]; n];
        for i in 0..n {
            for (r, c) in block_entries() {
                x[(4 * i + r, 4 * i + c)] += excess[r][c] / n as f64;
            }
            (0..4).for_each(|r| rest[i][r] += x[(4 * i + r, 4 * i)]);
            for j in i + 1..n {
                let skew = combine_with_transpose(x, i, j, |here, across| (here - across) / 2.0);
                for (r, c) in block_entries() {
                    let tie = if i == 0 { self.first_row_blocks[j][r][c] } else { 0.0 };
                    set_symmetric(x, (4 * i + r, 4 * j + c), tie + skew[r][c]);
                }
                (0..4).for_each(|r| rest[i][r] += x[(4 * i + r, 4 * j)]);
                (0..4).for_each(|r| rest[j][r] += x[(4 * j + r, 4 * i)]);
            }
        }
        // They sum to zero if the rotation is a least-squares one, except for rounding.
        let mean = [0, 1, 2, 3].map(|r| rest.iter().map(|row| row[r]).sum::<f64>() / n as f64);
        let weight = n as f64 / 4.0 + 0.5;
        for row in &mut rest {
            let centred = [0, 1, 2, 3].map(|r| row[r] - mean[r]);
            *row = [centred[0], centred[1] / weight, centred[2] / weight, centred[3] / weight];
        }
        for i in 0..n {
            for r in 0..4 {
                x[(4 * i + r, 4 * i)] -= rest[i][r] / 2.0;
                x[(4 * i, 4 * i + r)] -= rest[i][r] / 2.0;
            }
            for j in i + 1..n {
                for r in 1..4 {
                    let part = (rest[i][r] - rest[j][r]) / 4.0;
                    let (down, across) = ((4 * i + r, 4 * j), (4 * i, 4 * j + r));
                    set_symmetric(x, down, x[down] - part);
                    set_symmetric(x, across, x[across] + part);
                }
            }
        }
    }
}

fn block_entries() -> impl Iterator<Item = (usize, usize)> {
    (0..4).flat_map(|r| (0..4).map(move |c| (r, c)))
}

fn combine_blocks(a: &Block, b: &Block, with: impl Fn(f64, f64) -> f64) -> Block {
    [0, 1, 2, 3].map(|r| [0, 1, 2, 3].map(|c| with(a[r][c], b[r][c])))
}

/// Combines block (i, j) with its transpose.
fn combine_with_transpose(
    x: &Mat<f64>,
    i: usize,
    j: usize,
    with: impl Fn(f64, f64) -> f64,
) -> Block {
    let at = |r: usize, c: usize| x[(4 * i + r, 4 * j + c)];
    [0, 1, 2, 3].map(|r| [0, 1, 2, 3].map(|c| with(at(r, c), at(c, r))))
}

/// Sets an entry and its mirror image.
fn set_symmetric(x: &mut Mat<f64>, (row, column): (usize, usize), value: f64) {
    x[(row, column)] = value;
    x[(column, row)] = value;
}

/// Returns the nearest positive semidefinite matrix.
fn project_to_psd(x: &Mat<f64>) -> Option<Mat<f64>> {
    let eigen = x.self_adjoint_eigen(Side::Lower).ok()?;
    let n = x.nrows();
    let roots: Vec<f64> = (0..n).map(|k| eigen.S()[k].max(0.0).sqrt()).collect();
    let first = roots.iter().position(|&root| root > 0.0).unwrap_or(n);
    let half = Mat::from_fn(n, n - first, |i, k| eigen.U()[(i, first + k)] * roots[first + k]);
    Some(&half * half.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const SCHEDULE: GncOptions =
        GncOptions { factor: 1.4, cost_threshold: 0.005, max_iterations: 1000 };

    /// Returns unit vectors under a rotation, the first `wrong` of them random; all off by up to
    /// `noise` along each axis.
    fn measurements(count: usize, wrong: usize, noise: f64, seed: u64) -> Vec<(Vec3, Vec3)> {
        let truth = Transform::from_rotation_vector([0.5, -1.0, 2.0]);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut vector =
            || [(); 3].map(|()| 2.0 * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64 - 1.0);
        (0..count)
            .map(|k| {
                let a = math::normalized(vector());
                let image = if k < wrong { math::normalized(vector()) } else { truth.rotate(a) };
                (a, math::add(image, math::scaled(vector(), noise)))
            })
            .collect()
    }

    #[test]
    fn the_optimum_is_certified_among_outliers() {
        for (count, wrong) in [(4, 0), (20, 0), (40, 10), (40, 20), (99, 20)] {
            let measurements = measurements(count, wrong, 0.02, count as u64);
            let found = certify(&measurements, 0.1, SCHEDULE, &Transform::IDENTITY).unwrap();
            assert!(found.gap <= GAP_TOLERANCE && found.differences == count, "{found:?}");
        }
    }

    #[test]
    fn a_worse_rotation_is_not_certified() {
        let measurements: Vec<_> = measurements(20, 0, 0.02, 3)
            .iter()
            .map(|&(a, b)| (math::scaled(a, 10.0), math::scaled(b, 10.0)))
            .collect();
        let (best, cost) = minimize_truncated_cost(&measurements, SCHEDULE).unwrap();
        for angle in [0.02, 0.1, 3.0] {
            let turn = Transform::from_rotation_vector([angle, 0.0, 0.0]).rotation;
            let worse = math::mat_mul(&best, &turn);
            let found: f64 = squared_residuals(&measurements, &worse).map(|r| r.min(1.0)).sum();
            let (gap, _) = DualProblem::new(&measurements, &worse, found).minimize_gap().unwrap();
            // The bound is valid: no larger than the saving of the best rotation.
            assert!(gap >= 1.0 - cost / found, "{angle}: {gap} {cost} {found}");
        }
    }

    /// The lower bound holds for an enumeration: every rotation of a fine grid.
    #[test]
    fn no_rotation_beats_the_bound() {
        for seed in 0..4 {
            let measurements: Vec<_> = measurements(6, 3, 0.02, seed)
                .iter()
                .map(|&(a, b)| (math::scaled(a, 4.0), math::scaled(b, 4.0)))
                .collect();
            let (rotation, cost) = minimize_truncated_cost(&measurements, SCHEDULE).unwrap();
            let (gap, _) = DualProblem::new(&measurements, &rotation, cost).minimize_gap().unwrap();
            let steps = |k: usize| (0..24).map(move |i| k as f64 * (i as f64 / 12.0 - 1.0));
            for (x, y, z) in
                steps(3).flat_map(|x| steps(3).flat_map(move |y| steps(3).map(move |z| (x, y, z))))
            {
                let turn = Transform::from_rotation_vector([x, y, z]).rotation;
                let found: f64 = squared_residuals(&measurements, &turn).map(|r| r.min(1.0)).sum();
                assert!(found >= cost * (1.0 - gap) - 1e-9, "{seed}: {found} {cost} {gap}");
            }
        }
    }

    #[test]
    fn the_projection_is_the_nearest_of_its_form() {
        let measurements = measurements(5, 2, 0.02, 1);
        let (rotation, cost) = minimize_truncated_cost(&measurements, SCHEDULE).unwrap();
        let dual = DualProblem::new(&measurements, &rotation, cost);
        let n = 4 * dual.first_row_blocks.len();
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut near = |_: usize, _: usize| (rng.next_u64() >> 40) as f64 / (1u64 << 24) as f64;
        let any = Mat::from_fn(n, n, &mut near);
        let any = &any + any.transpose();
        let project = |x: &Mat<f64>| {
            let mut x = x.clone();
            dual.project_to_dual(&mut x);
            x
        };
        let (a, b) = (project(&any), project(&dual.initial));
        let kernel: f64 =
            (0..n).map(|i| (0..n / 4).map(|j| a[(i, 4 * j)]).sum::<f64>().abs()).sum();
        assert!(kernel < 1e-9, "{kernel}");
        // A second projection changes nothing, and the removed part is orthogonal to the set.
        let again = project(&a);
        assert!((&again - &a).norm_l2() < 1e-12);
        let product: f64 = (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .map(|at| (any[at] - a[at]) * (b[at] - a[at]))
            .sum();
        assert!(product.abs() < 1e-9, "{product}");
    }
}
