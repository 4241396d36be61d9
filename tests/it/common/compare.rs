//! Distances between two results, each relative to what its numbers are made of.

use cfreg::Transform;
use cfreg::math;
use cfreg::moments::{Moments, naive};

/// Largest difference between two sums over the same pairs, about the origins of the
/// first: weights relative to Σw and Σw², first moments to √(Σw Σw|p|²), the cross moment
/// to √(Σw|p|² Σw|q|²). Sums of many signs are small beside their terms, and rounding
/// follows the terms.
pub fn moments_difference(a: &Moments, b: &Moments) -> f64 {
    let b = naive::shift_origins(b, a.source_origin, a.target_origin);
    let share = |difference: f64, size: f64| match difference.abs() {
        0.0 => 0.0,
        difference => difference / size,
    };
    let vector =
        |x, y, squares: f64| share(math::norm(math::sub(x, y)), (a.weight * squares).sqrt());
    let cross = math::frobenius(&math::mat_sub(&a.cross, &b.cross));
    [
        share(a.weight - b.weight, a.weight),
        share(a.weight_squared - b.weight_squared, a.weight_squared),
        share(a.source_squares - b.source_squares, a.source_squares),
        share(a.target_squares - b.target_squares, a.target_squares),
        vector(a.source_sum, b.source_sum, a.source_squares),
        vector(a.target_sum, b.target_sum, a.target_squares),
        share(cross, (a.source_squares * a.target_squares).sqrt()),
    ]
    // `max` would drop a NaN.
    .into_iter()
    .fold(0.0, |worst, x| if x <= worst { worst } else { x })
}

/// Largest difference between two poses, entry by entry of their matrices.
pub fn pose_difference(a: &Transform, b: &Transform) -> f64 {
    let (a, b) = (a.matrix(), b.matrix());
    a.as_flattened().iter().zip(b.as_flattened()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

/// Largest difference between two lists of rows.
///
/// # Panics
/// When they differ in number.
pub fn row_difference<const N: usize>(found: &[[f32; N]], expected: &[[f64; N]]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let (found, expected) = (found.as_flattened(), expected.as_flattened());
    found.iter().zip(expected).map(|(&x, y)| (f64::from(x) - y).abs()).fold(0.0, f64::max)
}
