//! Gauss-Newton on surfaces: point-to-plane and generalized ICP.
//!
//! Both minimise Σ w eᵀ M e with e = T p − q (Segal, Hähnel and Thrun 2009, eq. 2):
//! M = n nᵀ is point-to-plane (Chen and Medioni 1991), M = (C_q + R C_p Rᵀ)⁻¹ with the
//! covariances of flat discs is generalized ICP.

use std::sync::Arc;

use super::Metric;
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::cholesky::{self, Mat6, Vec6};
use crate::math::{self, Mat3, Vec3};
use crate::method::cache::{Cached, HeapSize};
use crate::moments::WeightedPair;
use crate::normals::{self, Orientation};
use crate::par;
use crate::search::{Neighborhood, Neighbors};

/// Variance of a disc along its normal; 1 within it (Segal et al., section III-C).
const NORMAL_VARIANCE: f64 = 1e-3;
/// Share of the mean curvature added to every direction: what only rounding holds stays.
const DAMPING: f64 = 1e-9;
const BLOCK: usize = 1024;

/// Normals of the clouds, zero where a neighbourhood has no plane.
pub(super) struct SurfaceProblem {
    metric: Metric,
    /// The target's for point-to-plane, which does not look at them.
    source: Arc<CloudNormals>,
    target: Arc<CloudNormals>,
    /// What motions are about, and the length they are measured in: rotation and
    /// translation then weigh alike, and no tolerance has a unit.
    center: Vec3,
    unit: f64,
}

/// Unit normals of a cloud, zero where undefined.
struct CloudNormals(Vec<[f32; 3]>);

/// Key of normals by so many neighbours.
#[derive(PartialEq)]
struct NormalsKey(usize);

impl HeapSize for CloudNormals {
    fn bytes(&self) -> usize {
        size_of_val(&self.0[..])
    }
}

/// Σ w JᵀMJ, Σ w JᵀMe and Σ w eᵀMe.
struct NormalEquations {
    hessian: Mat6,
    gradient: Vec6,
    error: f64,
}

/// The two clouds and the pairs between them.
#[derive(Clone, Copy)]
pub(super) struct PairSet<'a> {
    pub(super) source: &'a PointCloud,
    pub(super) target: &'a PointCloud,
    pub(super) pairs: &'a [WeightedPair],
}

impl SurfaceProblem {
    /// # Errors
    /// [`Error::Degenerate`] when a cloud that needs normals has none at all.
    pub(super) fn new(
        metric: Metric,
        [source, target]: [Cached<'_>; 2],
        neighbors: usize,
        unit: f64,
    ) -> Result<Self> {
        let normals = |cloud: &PointCloud| {
            let near = Neighbors::find(cloud.points(), Neighborhood::Nearest(neighbors))?;
            let normals = normals::estimate(cloud, &near, Orientation::Viewpoint)?;
            if normals.undefined_count() == cloud.len() {
                return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
            }
            Ok(CloudNormals(normals.vectors))
        };
        let tangents =
            |end: Cached<'_>| end.get_or_compute(NormalsKey(neighbors), || normals(end.cloud));
        let center = target.cloud.centroid();
        let target = tangents(target)?;
        let source = match metric {
            Metric::Generalized => tangents(source)?,
            Metric::Point | Metric::Plane => target.clone(),
        };
        Ok(SurfaceProblem { metric, source, target, center, unit })
    }

    /// The pose after one damped step from `pose`; `pose` itself where none is better.
    ///
    /// # Errors
    /// [`Error::NoWeight`] when no pair has a surface.
    pub(super) fn gauss_newton_step(&self, on: PairSet<'_>, pose: &Transform) -> Result<Transform> {
        // M is kept during a step, as in small_gicp: it changes little with R.
        let information = self.information_matrices(on, pose);
        let system = self.normal_equations(on, pose, &information);
        let mean = (0..6).map(|i| system.hessian[i][i]).sum::<f64>() / 6.0;
        if mean.is_nan() || mean <= 0.0 {
            return Err(Error::NO_WEIGHT);
        }
        let mut damping = DAMPING;
        while damping < 1e6 {
            let mut damped = system.hessian;
            (0..6).for_each(|i| damped[i][i] += damping * mean);
            if let Some(factor) = cholesky::factor(&damped) {
                let next =
                    self.apply_twist(pose, cholesky::solve(&factor, &system.gradient.map(|x| -x)));
                if self.weighted_error(on, &next, &information) <= system.error {
                    return Ok(next);
                }
            }
            damping *= 100.0;
        }
        Ok(*pose)
    }

    /// Least pivot of the point-to-plane curvature over its mean: how firmly the surfaces
    /// hold the pose in the direction in which they hold it least. About 0 for a plane or
    /// a sphere, along which the clouds slide.
    pub(super) fn min_pivot(&self, on: PairSet<'_>, pose: &Transform) -> f64 {
        let normal = |pair: &WeightedPair| self.normal(pair);
        let information: Vec<Mat3> =
            on.pairs.iter().map(|p| math::outer(normal(p), normal(p))).collect();
        let curvature = self.normal_equations(on, pose, &information).hessian;
        let mean = (0..6).map(|i| curvature[i][i]).sum::<f64>() / 6.0;
        let pivots = cholesky::factor(&curvature).map(|l| (0..6).map(move |i| l[i][i] * l[i][i]));
        pivots.map_or(0.0, |pivots| pivots.fold(f64::INFINITY, f64::min) / mean)
    }

    fn normal(&self, pair: &WeightedPair) -> Vec3 {
        self.target.0[pair.target as usize].map(f64::from)
    }

    /// M of every pair; zero where a surface is missing.
    fn information_matrices(&self, on: PairSet<'_>, pose: &Transform) -> Vec<Mat3> {
        par::map(
            on.pairs.len(),
            || (),
            |_, k| {
                let pair = &on.pairs[k];
                let n = self.normal(pair);
                if self.metric != Metric::Generalized {
                    return math::outer(n, n);
                }
                let m = pose.rotate(self.source.0[pair.source as usize].map(f64::from));
                if n == [0.0; 3] || m == [0.0; 3] {
                    return [[0.0; 3]; 3];
                }
                invert_symmetric(&add_matrices(&disc_covariance(n), &disc_covariance(m)))
            },
        )
    }

    /// e and T p, both in units, T p about the center.
    fn residual(&self, on: PairSet<'_>, pair: &WeightedPair, pose: &Transform) -> (Vec3, Vec3) {
        let local = |x: Vec3| math::scaled(math::sub(x, self.center), 1.0 / self.unit);
        let moved = local(pose.apply(on.source.position(pair.source as usize)));
        (math::sub(moved, local(on.target.position(pair.target as usize))), moved)
    }

    fn weighted_error(&self, on: PairSet<'_>, pose: &Transform, information: &[Mat3]) -> f64 {
        let blocks = par::map_blocks(
            on.pairs.len(),
            BLOCK,
            || (),
            |_, block| {
                let term = |k: usize| {
                    let (e, _) = self.residual(on, &on.pairs[k], pose);
                    on.pairs[k].weight * math::dot(e, math::mat_vec(&information[k], e))
                };
                block.map(term).sum::<f64>()
            },
        );
        blocks.iter().sum()
    }

    fn normal_equations(
        &self,
        on: PairSet<'_>,
        pose: &Transform,
        information: &[Mat3],
    ) -> NormalEquations {
        let zero = || NormalEquations { hessian: [[0.0; 6]; 6], gradient: [0.0; 6], error: 0.0 };
        let blocks = par::map_blocks(
            on.pairs.len(),
            BLOCK,
            || (),
            |_, block| {
                let mut sums = zero();
                for k in block {
                    let (e, y) = self.residual(on, &on.pairs[k], pose);
                    sums.add(on.pairs[k].weight, e, y, &information[k]);
                }
                sums
            },
        );
        blocks.iter().fold(zero(), |mut sums, block| {
            for a in 0..6 {
                sums.gradient[a] += block.gradient[a];
                (0..6).for_each(|b| sums.hessian[a][b] += block.hessian[a][b]);
            }
            sums.error += block.error;
            sums
        })
    }

    /// `pose`, then the motion (rotation vector, translation in units) about the center.
    fn apply_twist(&self, pose: &Transform, motion: Vec6) -> Transform {
        let [a, b, c, x, y, z] = motion;
        let turn = Transform::from_rotation_vector([a, b, c]);
        let shift = math::scaled([x, y, z], self.unit);
        // About the center, so that map coordinates cost no digits.
        let at = math::sub(pose.translation, self.center);
        let translation = math::add(math::add(turn.rotate(at), shift), self.center);
        Transform { translation, ..turn.after(pose) }
    }
}

impl NormalEquations {
    /// Columns of J = ∂(T p)/∂motion: a unit rotation about each axis, a unit shift.
    fn add(&mut self, weight: f64, e: Vec3, y: Vec3, information: &Mat3) {
        let columns = [
            [0.0, -y[2], y[1]],
            [y[2], 0.0, -y[0]],
            [-y[1], y[0], 0.0],
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

/// Covariance of a disc with unit normal `n`: I − (1 − ε) n nᵀ.
fn disc_covariance(n: Vec3) -> Mat3 {
    let flat = math::outer(n, math::scaled(n, 1.0 - NORMAL_VARIANCE));
    math::mat_sub(&math::IDENTITY, &flat)
}

fn add_matrices(a: &Mat3, b: &Mat3) -> Mat3 {
    [0, 1, 2].map(|i| math::add(a[i], b[i]))
}

/// Of a symmetric, positive definite matrix: cofactors over the determinant.
fn invert_symmetric(m: &Mat3) -> Mat3 {
    let cofactors = [math::cross(m[1], m[2]), math::cross(m[2], m[0]), math::cross(m[0], m[1])];
    cofactors.map(|row| math::scaled(row, 1.0 / math::determinant(m)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_invert() {
        let discs =
            add_matrices(&disc_covariance([1.0, 0.0, 0.0]), &disc_covariance([0.0, 0.6, 0.8]));
        let product = math::mat_mul(&discs, &invert_symmetric(&discs));
        assert!(math::frobenius(&math::mat_sub(&product, &math::IDENTITY)) < 1e-12);
        assert!(
            (math::determinant(&disc_covariance([0.0, 0.6, 0.8])) - NORMAL_VARIANCE).abs() < 1e-15
        );
    }

    #[test]
    fn the_gradient_is_the_errors_derivative() {
        let (e, y) = ([0.3, -0.2, 0.5], [1.0, 2.0, -0.7]);
        let information = invert_symmetric(&add_matrices(
            &disc_covariance([0.0, 0.6, 0.8]),
            &disc_covariance([1.0, 0.0, 0.0]),
        ));
        let mut system = NormalEquations { hessian: [[0.0; 6]; 6], gradient: [0.0; 6], error: 0.0 };
        system.add(2.0, e, y, &information);
        let error = |motion: Vec6| {
            let [a, b, c, x, y2, z] = motion;
            let turned = Transform::from_rotation_vector([a, b, c]).apply(y);
            let e = math::add(math::sub(math::add(turned, [x, y2, z]), y), e);
            2.0 * math::dot(e, math::mat_vec(&information, e))
        };
        for a in 0..6 {
            let (mut up, mut down) = ([0.0; 6], [0.0; 6]);
            (up[a], down[a]) = (1e-5, -1e-5);
            let slope = (error(up) - error(down)) / 2e-5;
            assert!((slope - 2.0 * system.gradient[a]).abs() < 1e-5 * slope.abs().max(1.0), "{a}");
        }
    }
}
