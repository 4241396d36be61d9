//! Observation weights: the share of the surface that each point represents.

use crate::error::Result;
use crate::math::{self, Mat3, Vec3};
use crate::par;
use crate::search::{Neighborhood, Neighbors};

/// Weights above this many times their mean are clamped to it, as in the authors' program: the
/// neighbourhood of a stray point spans far more than the point represents.
const MAX_RELATIVE_WEIGHT: f64 = 8.0;

/// Returns one weight per point, inverse to the local sampling density, with sum 1: the product of
/// the two largest standard deviations of its `k` nearest points (the area they span), then the
/// median over these neighbours (the empirical sample model of the DARE paper). Equal weights if no
/// neighbourhood spans an area.
///
/// # Errors
/// Those of [`Neighbors::find`].
pub(super) fn observation_weights(points: &[[f32; 3]], k: usize) -> Result<Vec<f64>> {
    let neighbors = Neighbors::find(points, Neighborhood::Nearest(k))?;
    let n = points.len();
    let areas = par::map(
        n,
        || (),
        |_, i| spanned_area(neighbors.indices(i).iter().map(|&j| points[j as usize]), points[i]),
    );
    let mut weights = par::map(
        n,
        || (),
        |_, i| {
            let mut around: Vec<f64> =
                neighbors.indices(i).iter().map(|&j| areas[j as usize]).collect();
            around.sort_unstable_by(f64::total_cmp);
            let middle = around.len() / 2;
            (around[middle] + around[(around.len() - 1) / 2]) / 2.0
        },
    );
    let mean = weights.iter().sum::<f64>() / n as f64;
    if mean <= 0.0 {
        return Ok(equal_weights(n));
    }
    weights.iter_mut().for_each(|weight| *weight = weight.min(MAX_RELATIVE_WEIGHT * mean));
    let sum: f64 = weights.iter().sum();
    Ok(weights.iter().map(|weight| weight / sum).collect())
}

/// Returns the same weight for every point, with sum 1.
pub(super) fn equal_weights(n: usize) -> Vec<f64> {
    vec![1.0 / n as f64; n]
}

/// Returns √(λ₂λ₃) of the covariance, in squared units of the points.
fn spanned_area(points: impl ExactSizeIterator<Item = [f32; 3]>, about: [f32; 3]) -> f64 {
    let n = points.len() as f64;
    let (mut sum, mut squares): (Vec3, Mat3) = ([0.0; 3], [[0.0; 3]; 3]);
    for point in points {
        let p = math::sub(point.map(f64::from), about.map(f64::from));
        sum = math::add(sum, p);
        let outer = math::outer(p, p);
        squares = [0, 1, 2].map(|a| math::add(squares[a], outer[a]));
    }
    let mean = math::scaled(sum, 1.0 / n);
    let squares = squares.map(|row| math::scaled(row, 1.0 / n));
    let covariance = math::mat_sub(&squares, &math::outer(mean, mean));
    let (values, _) = math::eigen::symmetric(&covariance);
    (values[1].max(0.0) * values[2].max(0.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_point_weighs_as_much_as_the_surface_it_stands_for() {
        // A plane, sampled with step 1 on one half and step 2 on the other: four times the area per
        // point.
        let grid = |x0: f32, step: f32, n: usize| {
            (0..n * n).map(move |i| [x0 + step * (i % n) as f32, step * (i / n) as f32, 0.0])
        };
        let points: Vec<[f32; 3]> = grid(0.0, 1.0, 20).chain(grid(100.0, 2.0, 20)).collect();
        let weights = observation_weights(&points, 9).unwrap();
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let (fine, coarse) = (weights[10 * 20 + 10], weights[400 + 10 * 20 + 10]);
        assert!((coarse / fine - 4.0).abs() < 1e-6, "{fine} {coarse}");
    }

    #[test]
    fn a_line_spans_no_area_and_counts_evenly() {
        let line: Vec<[f32; 3]> = (0..30).map(|i| [i as f32, 0.0, 0.0]).collect();
        assert_eq!(observation_weights(&line, 5).unwrap(), equal_weights(30));
    }
}
