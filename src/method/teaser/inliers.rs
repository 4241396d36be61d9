//! Inliers of a pose, and the number that chance alone would produce.

use super::correspondences::CenteredCorrespondences;
use crate::cloud::Transform;
use crate::math::{self, Vec3};

/// Fewest inliers of a trusted pose, for any chance level: three determine a pose, a fourth and a
/// fifth confirm it.
const MIN_INLIERS: usize = 5;

/// Most differences for the chance level, on either side. Chosen by hand.
const MAX_CHANCE_DIFFERENCES: usize = 125_000;

/// Returns the fewest inliers of a trusted pose.
pub(super) fn min_inliers(
    matches: &CenteredCorrespondences,
    scale: f64,
    difference_bound: f64,
) -> usize {
    min_significant_size(matches.len(), chance_consistency(matches, scale, difference_bound))
        .max(MIN_INLIERS)
}

/// Returns the share of consistent pairs of a source and a target distance, from any
/// correspondences: how often wrong correspondences are consistent, however many are correct.
fn chance_consistency(matches: &CenteredCorrespondences, scale: f64, difference_bound: f64) -> f64 {
    let lengths = |(a, b): (Vec3, Vec3)| (scale * math::norm(a), math::norm(b));
    let (mut there, mut here): (Vec<f64>, Vec<f64>) =
        matches.pairwise_differences(MAX_CHANCE_DIFFERENCES).into_iter().map(lengths).unzip();
    there.sort_unstable_by(f64::total_cmp);
    here.sort_unstable_by(f64::total_cmp);
    // Both ends of the window only grow.
    let (mut low, mut high, mut agreeing) = (0, 0, 0);
    for length in &there {
        while here.get(low).is_some_and(|x| *x < length - difference_bound) {
            low += 1;
        }
        while here.get(high).is_some_and(|x| *x <= length + difference_bound) {
            high += 1;
        }
        agreeing += high - low;
    }
    agreeing as f64 / (there.len() * here.len()).max(1) as f64
}

/// Returns the correspondences whose error is within the bound along every axis.
pub(super) fn find_inliers(
    matches: &CenteredCorrespondences,
    transform: &Transform,
    bound: f64,
) -> Vec<usize> {
    let (source_origin, target_origin) = matches.origins();
    let shift = math::sub(transform.apply(source_origin), target_origin);
    let within = |&k: &usize| {
        let turned = math::scaled(transform.rotate(matches.source[k]), transform.scale);
        let rest = math::sub(math::add(turned, shift), matches.target[k]);
        rest.iter().all(|x| x.abs() <= bound)
    };
    (0..matches.len()).filter(within).collect()
}

/// Returns the size from which a set of consistent correspondences is hardly chance, if the share
/// `density` of the pairs of `matches` correspondences is consistent.
///
/// k points in space have 3k − 6 independent distances, so that chance produces about C(n, k)
/// density^(3k − 6) consistent sets of k. Returns the smallest k beyond the maximum of that number
/// at which it is below 1/100.
fn min_significant_size(matches: usize, density: f64) -> usize {
    let n = matches as f64;
    let mut logarithm = 0.0;
    for k in 1..=matches {
        // ln C(n, k), term by term.
        logarithm += ((n - k as f64 + 1.0) / k as f64).ln();
        let sets = logarithm + (3.0 * k as f64 - 6.0) * density.ln();
        let growth = ((n - k as f64) / (k as f64 + 1.0)).ln() + 3.0 * density.ln();
        if k > 3 && growth < 0.0 && sets < -100f64.ln() {
            return k;
        }
    }
    matches + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_agreeing_pairs_call_for_more_inliers() {
        assert!(min_significant_size(1000, 0.01) <= MIN_INLIERS);
        assert!(min_significant_size(1000, 0.05) < min_significant_size(1000, 0.1));
        assert_eq!(min_significant_size(10, 1.0), 10 + 1);
    }
}
