//! The E-step: responsibilities of the mixture, summed directly into moments.

use std::f64::consts::PI;

use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::math::{self, Vec3};
use crate::method::position_problem::PositionProblem;
use crate::moments::Moments;
use crate::par;
use crate::search::SearchTree;
use crate::weight::Gaussian;

/// Largest radius at which search is faster than the tiles, in root mean square radii of the
/// target: a target point then connects to about one source in a hundred.
const MAX_SEARCH_RADIUS: f64 = 0.2;
/// Smallest sum of f32 weights that still has correct digits.
const MIN_WEIGHT_SUM: f64 = 1e-30;
/// Target points per partial sum: fixed, so that the bits do not depend on the threads.
const BLOCK: usize = 64;

/// The mixture given by the moved source, with the target as its data.
pub(super) struct SourceMixture<'a> {
    positions: &'a PositionProblem<'a>,
    source: &'a PointCloud,
    target: &'a PointCloud,
    /// c / (2πσ²)^{3/2}.
    outlier_density: f64,
    truncation: f64,
}

/// Result of an E-step for the M-step.
pub(super) struct EStepResult {
    pub(super) moments: Moments,
    /// Negative log-likelihood per target point, without constants.
    pub(super) objective: f64,
    /// Number of weighted pairs.
    pub(super) connections: u64,
}

impl<'a> SourceMixture<'a> {
    pub(super) fn new(
        positions: &'a PositionProblem<'a>,
        source: &'a PointCloud,
        target: &'a PointCloud,
        outliers: f64,
        truncation: f64,
    ) -> Self {
        let ratio = source.len() as f64 / target.len() as f64;
        let outlier_density = outliers / (1.0 - outliers) * ratio;
        SourceMixture { positions, source, target, outlier_density, truncation }
    }

    /// Computes responsibilities at `pose` with `sigma` in the target's radii.
    pub(super) fn e_step(&self, pose: &Transform, sigma: f64) -> Result<EStepResult> {
        let reach =
            self.max_squared_distance_gap(sigma).filter(|&reach| reach.sqrt() <= MAX_SEARCH_RADIUS);
        if reach.is_none()
            && let Some(expectation) = self.e_step_dense(pose, sigma)?
        {
            return Ok(expectation);
        }
        self.e_step_by_search(pose, sigma)
    }

    /// Squared distance beyond the nearest source's at which sources are left out: all N of them
    /// together then weigh less than the allowed share of the nearest, which may have the smallest
    /// weight.
    fn max_squared_distance_gap(&self, sigma: f64) -> Option<f64> {
        let weights = self.positions.source_weights().unwrap_or_default();
        let lightest = weights.iter().fold(1.0, |least: f64, &a| least.min(f64::from(a)));
        let share = self.truncation * lightest / self.source.len() as f64;
        (share > 0.0).then(|| -2.0 * sigma * sigma * share.ln())
    }

    fn outlier_term(&self, sigma: f64) -> f64 {
        (2.0 * PI * sigma * sigma).powf(1.5) * self.outlier_density
    }

    fn objective(&self, log_sum: f64, sigma: f64) -> f64 {
        3.0 * sigma.ln() - log_sum / self.target.len() as f64
    }

    /// bⱼ: weight of a target point.
    fn target_weight(&self, j: usize) -> f64 {
        self.positions.target_weights().map_or(1.0, |weights| f64::from(weights[j]))
    }

    /// aᵢ: weight of a source point in the mixture.
    fn source_weight(&self, i: usize) -> f64 {
        self.positions.source_weights().map_or(1.0, |weights| f64::from(weights[i]))
    }

    /// Sums all pairs, in tiles. `None` if weights of a target point underflow and search may be
    /// better.
    fn e_step_dense(&self, pose: &Transform, sigma: f64) -> Result<Option<EStepResult>> {
        let connection = self.positions.full_connection(pose)?;
        let kernel = Gaussian { beta: (2.0 * sigma * sigma) as f32 };
        let c = self.outlier_term(sigma);
        let sums: Vec<f64> =
            connection.point_weighted_target_sums(&kernel).iter().map(|sum| sum + c).collect();
        if self.truncation > 0.0 && sums.iter().any(|&sum| sum < MIN_WEIGHT_SUM) {
            return Ok(None);
        }
        let factor = |&sum: &f64| if sum < MIN_WEIGHT_SUM { 0.0 } else { (1.0 / sum) as f32 };
        let factors: Vec<f32> = sums.iter().map(factor).collect();
        let log = |(j, sum): (usize, &f64)| self.target_weight(j) * sum.max(MIN_WEIGHT_SUM).ln();
        let log_sum: f64 = sums.iter().enumerate().map(log).sum();
        Ok(Some(EStepResult {
            moments: connection.moments_with_factors(&kernel, &factors)?,
            objective: self.objective(log_sum, sigma),
            connections: connection.pairs(),
        }))
    }

    /// Sums the relevant pairs, found by search, in f64.
    fn e_step_by_search(&self, pose: &Transform, sigma: f64) -> Result<EStepResult> {
        let unit = self.positions.rms_radius();
        let moved = self.positions.transform_source(pose)?;
        let tree = SearchTree::new(&moved)?;
        let reach = self.max_squared_distance_gap(sigma).unwrap_or(f64::INFINITY) * unit * unit;
        let inverse = 1.0 / (2.0 * (sigma * unit).powi(2));
        let c = self.outlier_term(sigma);
        let start = Moments::about(self.source.centroid(), self.target.centroid());
        let shift_p = math::sub(self.source.origin(), start.source_origin);
        let shift_q = math::sub(self.target.origin(), start.target_origin);
        let local = |point: [f32; 3], shift: Vec3| math::add(point.map(f64::from), shift);
        let blocks = par::map_blocks(self.target.len(), BLOCK, Vec::new, |weights, block| {
            let (mut moments, mut log_sum, mut pairs) = (start, 0.0, 0);
            for j in block {
                let place = self.target.points()[j];
                let nearest = f64::from(tree.nearest(&place).squared_distance);
                let near = tree.within(&place, (nearest + reach).sqrt() * (1.0 + 1e-6));
                // Relative to the nearest, so that nothing underflows at any distance.
                let lift = nearest * inverse;
                let relative = |found: &crate::search::Neighbor| {
                    let centre = self.source_weight(found.index as usize);
                    centre * (lift - f64::from(found.squared_distance) * inverse).exp()
                };
                weights.clear();
                weights.extend(near.iter().map(relative));
                let sum = weights.iter().sum::<f64>();
                let log_mixture = sum.ln() - lift;
                let log_outlier = c.ln();
                let high = log_mixture.max(log_outlier);
                let log_total =
                    high + ((log_mixture - high).exp() + (log_outlier - high).exp()).ln();
                let share = self.target_weight(j) * (log_mixture - log_total).exp() / sum;
                let q = local(place, shift_q);
                for (found, weight) in near.iter().zip(&*weights) {
                    let p = local(self.source.points()[found.index as usize], shift_p);
                    moments.add_pair(weight * share, p, q);
                }
                log_sum += self.target_weight(j) * log_total;
                pairs += near.len() as u64;
            }
            (moments, log_sum, pairs)
        });
        let (mut moments, mut log_sum, mut connections) = (start, 0.0, 0);
        for (block, logs, pairs) in &blocks {
            moments.merge(block);
            log_sum += logs;
            connections += pairs;
        }
        moments.centered()?;
        Ok(EStepResult { moments, objective: self.objective(log_sum, sigma), connections })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clouds() -> (PointCloud, PointCloud) {
        let at = |i: u32, seed: f64| {
            let t = f64::from(i) + seed;
            [(12.9 * t).sin(), (7.3 * t).cos() * 0.7, (3.1 * t + 1.0).sin() * 0.4]
        };
        let source: Vec<_> = (0..150).map(|i| at(i, 0.0)).collect();
        let target: Vec<_> = (0..90).map(|i| at(i, 0.4)).collect();
        (PointCloud::new(&source).unwrap(), PointCloud::new(&target).unwrap())
    }

    /// Computes Σw, Σw d² at the pose and the objective by the formulas as printed.
    fn printed(mixture: &SourceMixture, pose: &Transform, sigma: f64, w: f64) -> [f64; 3] {
        let (source, target) = (mixture.source, mixture.target);
        let (n, m) = (source.len() as f64, target.len() as f64);
        let unit = mixture.positions.rms_radius();
        let c = (2.0 * PI * sigma * sigma).powf(1.5) * w / (1.0 - w) * n / m;
        let (mut weight, mut residual, mut log_sum) = (0.0, 0.0, 0.0);
        for q in target.positions() {
            let squares: Vec<f64> = source
                .positions()
                .map(|p| math::sub(pose.apply(p), q))
                .map(|d| math::dot(d, d) / (unit * unit))
                .collect();
            let kernel = |d2: f64| (-d2 / (2.0 * sigma * sigma)).exp();
            let sum = squares.iter().map(|&d2| kernel(d2)).sum::<f64>() + c;
            weight += squares.iter().map(|&d2| kernel(d2) / sum).sum::<f64>();
            residual += squares.iter().map(|&d2| d2 * kernel(d2) / sum).sum::<f64>();
            log_sum += sum.ln();
        }
        [weight, residual * unit * unit, 1.5 * (sigma * sigma).ln() - log_sum / m]
    }

    #[test]
    fn tiles_and_search_are_the_printed_formulas() {
        let (source, target) = clouds();
        let positions = PositionProblem::new((&source).into(), (&target).into()).unwrap();
        let pose = Transform {
            translation: [0.05, 0.0, -0.1],
            scale: 1.1,
            ..Transform::from_rotation_vector([0.1, 0.2, -0.1])
        };
        for w in [0.0, 0.1, 0.7] {
            let mixture = SourceMixture::new(&positions, &source, &target, w, 1e-7);
            for sigma in [1.0, 0.3, 0.1, 0.05] {
                let want = printed(&mixture, &pose, sigma, w);
                let found = [
                    mixture.e_step_dense(&pose, sigma).unwrap().unwrap(),
                    mixture.e_step_by_search(&pose, sigma).unwrap(),
                ];
                for EStepResult { moments, objective, .. } in found {
                    let found = [moments.weight, moments.residual(&pose), objective];
                    for (x, y) in found.iter().zip(want) {
                        assert!((x - y).abs() < 3e-6 * (1.0 + y.abs()), "{w} {sigma}: {x} {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_left_out_keeps_its_bound() {
        let (source, target) = clouds();
        let positions = PositionProblem::new((&source).into(), (&target).into()).unwrap();
        for truncation in [1e-1, 1e-3, 1e-5] {
            let mixture = SourceMixture::new(&positions, &source, &target, 0.3, truncation);
            for sigma in [0.3, 0.1, 0.03] {
                let found = mixture.e_step_by_search(&Transform::IDENTITY, sigma).unwrap();
                let [all, ..] = printed(&mixture, &Transform::IDENTITY, sigma, 0.3);
                let missing = (all - found.moments.weight) / all;
                assert!((-1e-6..=truncation + 1e-6).contains(&missing), "{truncation} {missing}");
            }
        }
    }
}
