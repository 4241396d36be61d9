//! Adaptive voting: the exact truncated least-squares estimate of one number; used for the scale,
//! and for the translation axis by axis.

use super::correspondences::CenteredCorrespondences;
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, Mat3, Vec3};

/// Most differences that vote on the scale: all pairs of 2000. Chosen by hand.
const MAX_SCALE_DIFFERENCES: usize = 2_000_000;

/// Returns the x that minimises Σ min((x − xᵢ)²/αᵢ², 1), for measurements `(xᵢ, αᵢ)` with bounds αᵢ
/// > 0 (TEASER's adaptive voting, with c̄ = 1); `None` without measurements.
///
/// The set of measurements within their bounds only changes at the 2n ends xᵢ ± αᵢ: between two of
/// them the best x is the weighted mean of that set, so that running sums over the sorted ends find
/// the global optimum in O(n log n).
fn estimate_scalar_tls(measurements: &[(f64, f64)]) -> Option<f64> {
    // About one of them, so that squares keep their digits.
    let origin = measurements.first()?.0;
    let mut ends: Vec<(f64, bool, usize)> = Vec::with_capacity(2 * measurements.len());
    for (i, &(x, bound)) in measurements.iter().enumerate() {
        ends.push((x - origin - bound, false, i));
        ends.push((x - origin + bound, true, i));
    }
    // Intervals are closed: at equal positions one begins before another ends.
    ends.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let (mut count, mut sums) = (0usize, [0.0; 3]);
    let (mut least, mut best) = (f64::INFINITY, 0.0);
    for (_, leaves, i) in ends {
        let (x, bound) = measurements[i];
        let (x, weight) = (x - origin, 1.0 / (bound * bound));
        let sign = if leaves { -1.0 } else { 1.0 };
        for (sum, term) in sums.iter_mut().zip([weight, weight * x, weight * x * x]) {
            *sum += sign * term;
        }
        count = if leaves { count - 1 } else { count + 1 };
        if count == 0 {
            sums = [0.0; 3];
            continue;
        }
        let mean = sums[1] / sums[0];
        let inside = (sums[2] - sums[1] * mean).max(0.0);
        let cost = inside + (measurements.len() - count) as f64;
        if cost < least {
            (least, best) = (cost, mean);
        }
    }
    Some(origin + best)
}

/// Estimates the scale by adaptive voting over ‖b‖/‖a‖, TEASER's measurements that neither
/// translation nor rotation changes, with bounds 2β/‖a‖.
pub(super) fn vote_scale(matches: &CenteredCorrespondences, difference_bound: f64) -> Result<f64> {
    let ratio = |(a, b): (Vec3, Vec3)| {
        let length = math::norm(a);
        (length > 0.0).then(|| (math::norm(b) / length, difference_bound / length))
    };
    let ratios: Vec<(f64, f64)> =
        matches.pairwise_differences(MAX_SCALE_DIFFERENCES).into_iter().filter_map(ratio).collect();
    match estimate_scalar_tls(&ratios).filter(|&scale| scale > 0.0 && scale.is_finite()) {
        Some(scale) => Ok(scale),
        None => Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] }),
    }
}

/// Returns the pose with this rotation, its translation estimated by voting axis by axis (TEASER's
/// component-wise translation estimation).
pub(super) fn vote_translation(
    matches: &CenteredCorrespondences,
    rotation: &Mat3,
    scale: f64,
    bound: f64,
) -> Transform {
    let turn = |p: Vec3| math::scaled(math::mat_vec(rotation, p), scale);
    let axis = |a: usize| {
        let pairs = matches.source.iter().zip(&matches.target);
        let rests: Vec<(f64, f64)> = pairs.map(|(&p, q)| (q[a] - turn(p)[a], bound)).collect();
        estimate_scalar_tls(&rests).unwrap_or_default()
    };
    // From the correspondences' origins back to the clouds' frames.
    let (source_origin, target_origin) = matches.origins();
    let shift = math::add([0, 1, 2].map(axis), math::sub(target_origin, turn(source_origin)));
    Transform { rotation: *rotation, translation: shift, scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cost(x: f64, measurements: &[(f64, f64)]) -> f64 {
        measurements.iter().map(|&(y, bound)| ((x - y) / bound).powi(2).min(1.0)).sum()
    }

    proptest! {
        #[test]
        fn no_place_is_better(
            measurements in proptest::collection::vec((-10.0..10.0f64, 0.05..3.0f64), 1..12),
        ) {
            let found = cost(estimate_scalar_tls(&measurements).unwrap(), &measurements);
            // Every subset's weighted mean: the optimum is one of them.
            for subset in 1..1u32 << measurements.len() {
                let inside = (0..measurements.len()).filter(|i| subset >> i & 1 == 1);
                let (mut weight, mut sum) = (0.0, 0.0);
                for (x, bound) in inside.map(|i| measurements[i]) {
                    weight += 1.0 / (bound * bound);
                    sum += x / (bound * bound);
                }
                prop_assert!(found <= cost(sum / weight, &measurements) + 1e-9);
            }
        }
    }

    #[test]
    fn ninety_of_a_hundred_may_be_wrong() {
        let wrong = (0..90).map(|i| (f64::from(i) * 3.0, 0.1));
        let right = (0..10).map(|i| (100.5 + 0.01 * f64::from(i), 0.1));
        let found = estimate_scalar_tls(&wrong.chain(right).collect::<Vec<_>>()).unwrap();
        assert!((found - 100.545).abs() < 1e-9, "{found}");
        assert_eq!(estimate_scalar_tls(&[]), None);
    }
}
