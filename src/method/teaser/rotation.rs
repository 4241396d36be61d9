//! The rotation by graduated non-convexity on truncated least squares.

use crate::error::{Error, Result};
use crate::math::{self, Mat3, Vec3};
use crate::moments::Moments;
use crate::pose::{self, Prior, ScaleEstimate, Solver};

/// Schedule of the control parameter, and when the iterations end.
#[derive(Debug, Clone, Copy)]
pub(super) struct GncOptions {
    /// μ is multiplied by this after every solve.
    pub(super) factor: f64,
    /// Change of the cost, in squared bounds, at which the iterations end.
    pub(super) cost_threshold: f64,
    pub(super) max_iterations: u32,
}

/// One solve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GncIteration {
    pub(super) rotation: Mat3,
    /// Σ w r²/c² over the measurements, before this solve's weights were updated.
    pub(super) cost: f64,
    /// Σ w.
    pub(super) weight: f64,
}

/// Returns the rounds of weights and solves for R in b ≈ R a, and whether they converged (else the
/// last allowed one was reached).
///
/// Graduated non-convexity with the weights of truncated least squares (Yang, Antonante, Tzoumas
/// and Carlone 2020): with r = ‖b − R a‖ and the bound c, w is 1 for r² ≤ c² μ/(μ+1), 0 for r² ≥ c²
/// (μ+1)/μ, and (c/r) √(μ(μ+1)) − μ between. μ starts at c²/(2 r²_max − c²), where the cost is
/// convex; ends when it is not positive, and when the measurements that still have a weight leave
/// the rotation unconstrained.
///
/// # Errors
/// Those of [`pose::solve`] if all measurements together leave the rotation unconstrained.
pub(super) fn estimate_rotation(
    measurements: &[(Vec3, Vec3)],
    bound: f64,
    schedule: GncOptions,
    prior: &Prior,
) -> Result<(Vec<GncIteration>, bool)> {
    let square = bound * bound;
    let mut weights = vec![1.0; measurements.len()];
    let mut rounds: Vec<GncIteration> = Vec::new();
    let mut control = 0.0;
    loop {
        let rotation = match solve_rotation(measurements, &weights, prior) {
            Ok(rotation) => rotation,
            // Hardly any measurement is consistent with another: the last rotation is as good.
            Err(Error::Degenerate { .. }) if !rounds.is_empty() => return Ok((rounds, true)),
            Err(error) => return Err(error),
        };
        let residual = |&(a, b): &(Vec3, Vec3)| {
            let rest = math::sub(b, math::mat_vec(&rotation, a));
            math::dot(rest, rest) / square
        };
        let residuals: Vec<f64> = measurements.iter().map(residual).collect();
        let cost = weights.iter().zip(&residuals).map(|(w, r)| w * r).sum::<f64>();
        let before = rounds.last().map(|round| round.cost);
        rounds.push(GncIteration { rotation, cost, weight: weights.iter().sum() });
        match before {
            None => {
                let worst = residuals.iter().fold(0.0f64, |worst, &r| worst.max(r));
                control = 1.0 / (2.0 * worst - 1.0);
                // All well within their bounds: nothing to truncate.
                if control <= 0.0 || !control.is_finite() {
                    return Ok((rounds, true));
                }
            }
            Some(before) if (before - cost).abs() < schedule.cost_threshold => {
                return Ok((rounds, true));
            }
            Some(_) => control *= schedule.factor,
        }
        if rounds.len() >= schedule.max_iterations as usize {
            return Ok((rounds, false));
        }
        let reweigh = |(weight, &r): (&mut f64, &f64)| *weight = tls_weight(r, control);
        weights.iter_mut().zip(&residuals).for_each(reweigh);
    }
}

/// Returns the weight of a residual whose square is `squared` bounds² at control parameter μ.
fn tls_weight(squared: f64, control: f64) -> f64 {
    if squared <= control / (control + 1.0) {
        1.0
    } else if squared >= (control + 1.0) / control {
        0.0
    } else {
        ((control * (control + 1.0) / squared).sqrt() - control).clamp(0.0, 1.0)
    }
}

/// Solves with every measurement counted with both signs, which makes the means zero: the rotation
/// of differences is independent of the translation.
pub(super) fn solve_rotation(
    measurements: &[(Vec3, Vec3)],
    weights: &[f64],
    prior: &Prior,
) -> Result<Mat3> {
    let mut moments = Moments::about([0.0; 3], [0.0; 3]);
    for (&(a, b), &weight) in measurements.iter().zip(weights) {
        moments.add_pair(weight, a, b);
        moments.add_pair(weight, math::scaled(a, -1.0), math::scaled(b, -1.0));
    }
    let solution = pose::solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, prior)?;
    Ok(solution.transform.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;

    const SCHEDULE: GncOptions =
        GncOptions { factor: 1.4, cost_threshold: 0.005, max_iterations: 1000 };

    #[test]
    fn weights_are_continuous_and_truncate() {
        for control in [1e-3, 0.1, 1.0, 50.0] {
            let (low, high) = (control / (control + 1.0), (control + 1.0) / control);
            assert!((tls_weight(low * 1.000_001, control) - 1.0).abs() < 1e-3 * (1.0 + control));
            assert!(tls_weight(high * 0.999_999, control) < 1e-3 * (1.0 + control));
            assert_eq!((tls_weight(0.0, control), tls_weight(2.0 * high, control)), (1.0, 0.0));
        }
    }

    #[test]
    fn measurements_that_contradict_each_other_end_it() {
        // Two that are consistent in one direction, and a third at an impossible angle to them.
        let (x, y) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let measurements = [(x, x), (x, x), (y, [0.6, 0.8, 0.0])];
        let (rounds, settled) =
            estimate_rotation(&measurements, 1e-3, SCHEDULE, &Prior::default()).unwrap();
        let last = rounds.last().unwrap();
        assert!(settled && rounds.len() > 1 && last.weight < 3.0, "{rounds:?}");
        assert!((math::determinant(&last.rotation) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn wrong_measurements_lose_their_weight() {
        let truth = Transform::from_rotation_vector([0.5, -1.0, 2.0]);
        let at = |i: usize, k: f64| {
            let t = i as f64 * k;
            [t.sin(), (1.7 * t).cos(), (0.6 * t + k).sin()]
        };
        let measure = |i: usize| {
            let a = at(i, 0.7);
            // A third have random directions.
            (a, if i.is_multiple_of(3) { at(i, 2.9) } else { truth.rotate(a) })
        };
        let measurements: Vec<_> = (0..90).map(measure).collect();
        let (rounds, settled) =
            estimate_rotation(&measurements, 0.01, SCHEDULE, &Prior::default()).unwrap();
        let last = rounds.last().unwrap();
        let error = math::frobenius(&math::mat_sub(&last.rotation, &truth.rotation));
        assert!(settled && error < 1e-6, "{error} after {}", rounds.len());
        assert!((last.weight - 60.0).abs() < 1.0, "{}", last.weight);
        let short = GncOptions { max_iterations: 2, ..SCHEDULE };
        assert!(
            matches!(estimate_rotation(&measurements, 0.01, short, &Prior::default()), Ok((rounds, false)) if rounds.len() == 2)
        );
    }
}
