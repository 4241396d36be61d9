//! Gauss-Newton on surfaces: point-to-plane and generalized ICP.
//!
//! Both minimise Σ w eᵀ M e with e = T p − q (Segal, Hähnel and Thrun 2009, eq. 2):
//! M = n nᵀ is point-to-plane (Chen and Medioni 1991), M = (C_q + R C_p Rᵀ)⁻¹ with the
//! covariances of flat discs is generalized ICP.

use std::sync::Arc;

use super::Metric;
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::cholesky::Vec6;
use crate::math::{self, Mat3, Vec3};
use crate::method::cache::{Cached, HeapSize};
use crate::moments::WeightedPair;
use crate::normals::{self, Orientation};
use crate::par;
use crate::search::{Neighborhood, Neighbors};
use crate::surface::NormalEquations;
use crate::verify::Warning;

/// Variance of a disc along its normal; 1 in its plane (Segal et al., section III-C).
const NORMAL_VARIANCE: f64 = 1e-3;
/// Share of the mean curvature added to every direction: directions constrained only by rounding do
/// not move.
const DAMPING: f64 = 1e-9;
/// Smallest pivot of the surfaces below which a pose gets a warning ([`Warning::Degenerate`]).
/// Chosen by hand.
const MIN_PIVOT: f64 = 1e-4;
const BLOCK: usize = 1024;

/// Normals of the clouds, zero where a neighbourhood has no plane.
pub(super) struct SurfaceProblem {
    metric: Metric,
    /// The target's for point-to-plane, which does not use the source's normals.
    source: Arc<CloudNormals>,
    target: Arc<CloudNormals>,
    /// Centre of motions, and their unit of length: rotation and translation then weigh equally,
    /// and no tolerance has a unit.
    center: Vec3,
    unit: f64,
}

/// Unit normals of a cloud, zero where undefined.
struct CloudNormals(Vec<[f32; 3]>);

/// Key of normals by their number of neighbours.
#[derive(PartialEq)]
struct NormalsKey(usize);

impl HeapSize for CloudNormals {
    fn bytes(&self) -> usize {
        size_of_val(&self.0[..])
    }
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

    /// Returns the pose after one damped step from `pose`; `pose` itself if no step is better.
    ///
    /// # Errors
    /// [`Error::NoWeight`] when no pair has a surface.
    pub(super) fn gauss_newton_step(&self, on: PairSet<'_>, pose: &Transform) -> Result<Transform> {
        // M is constant during a step, as in small_gicp: it changes little with R.
        let information = self.information_matrices(on, pose);
        let system = self.normal_equations(on, pose, &information);
        let mean = system.mean_curvature();
        if mean.is_nan() || mean <= 0.0 {
            return Err(Error::NO_WEIGHT);
        }
        let mut damping = DAMPING;
        while damping < 1e6 {
            if let Some(twist) = system.solve(damping * mean) {
                let next = self.apply_twist(pose, twist);
                if self.weighted_error(on, &next, &information) <= system.error {
                    return Ok(next);
                }
            }
            damping *= 100.0;
        }
        Ok(*pose)
    }

    /// Returns a warning if the surfaces hardly constrain the pose.
    pub(super) fn check_pivot(&self, on: PairSet<'_>, pose: &Transform) -> Option<Warning> {
        let found = self.min_pivot(on, pose);
        (found.is_nan() || found < MIN_PIVOT)
            .then_some(Warning::Degenerate { found, needed: MIN_PIVOT })
    }

    /// Returns the smallest pivot of the point-to-plane curvature over its mean: how well the
    /// surfaces constrain the least constrained direction of the pose. About 0 for a plane or a
    /// sphere, along which the clouds slide.
    fn min_pivot(&self, on: PairSet<'_>, pose: &Transform) -> f64 {
        let normal = |pair: &WeightedPair| self.normal(pair);
        let information: Vec<Mat3> =
            on.pairs.iter().map(|p| math::outer(normal(p), normal(p))).collect();
        self.normal_equations(on, pose, &information).min_pivot()
    }

    fn normal(&self, pair: &WeightedPair) -> Vec3 {
        self.target.0[pair.target as usize].map(f64::from)
    }

    /// Returns M of every pair; zero if a surface is missing.
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

    /// Returns e and T p, both in units, T p about the center.
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
    ) -> NormalEquations<6> {
        let blocks = par::map_blocks(
            on.pairs.len(),
            BLOCK,
            || (),
            |_, block| {
                let mut sums = NormalEquations::ZERO;
                for k in block {
                    let (e, y) = self.residual(on, &on.pairs[k], pose);
                    sums.add_residual(on.pairs[k].weight, e, y, &information[k]);
                }
                sums
            },
        );
        blocks.iter().fold(NormalEquations::ZERO, |mut sums, block| {
            sums.merge(block);
            sums
        })
    }

    /// Applies `pose`, then the motion (rotation vector, translation in units) about the center.
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

/// Returns the covariance of a disc with unit normal `n`: I − (1 − ε) n nᵀ.
fn disc_covariance(n: Vec3) -> Mat3 {
    let flat = math::outer(n, math::scaled(n, 1.0 - NORMAL_VARIANCE));
    math::mat_sub(&math::IDENTITY, &flat)
}

fn add_matrices(a: &Mat3, b: &Mat3) -> Mat3 {
    [0, 1, 2].map(|i| math::add(a[i], b[i]))
}

/// Inverts a symmetric, positive definite matrix: cofactors over the determinant.
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
}
