//! The origin that a cloud's points are relative to, so that map coordinates keep their digits in
//! f32.

use crate::math::Vec3;

/// Distance from zero, in cloud sizes, at which a frame's own zero stops being a plausible
/// viewpoint. Chosen by hand.
pub(super) const MIN_OFFSET_FACTOR: f64 = 100.0;

/// Rounds `center` to multiples of `factor` times the power of ten at or above `extent`.
///
/// For steps of 1 and more the multiples are exact in f64; below, the division
/// by a whole power of ten is correctly rounded, so equal multiples are equal bits.
pub(super) fn round_origin(center: Vec3, extent: f64, factor: f64) -> Vec3 {
    if extent == 0.0 {
        return center;
    }
    let exponent = exponent(extent) + factor.log10() as i32;
    let power = 10f64.powi(exponent.abs());
    center.map(|x| {
        let snapped =
            if exponent >= 0 { (x / power).round() * power } else { (x * power).round() / power };
        // A cloud of size 1e-12 at 1e300 has no finite multiple: keep the coordinate itself.
        let snapped = if snapped.is_finite() { snapped } else { x };
        snapped + 0.0
    })
}

/// Returns the exponent of the power of ten at or above `extent`; 0 for no extent.
pub(super) fn exponent(extent: f64) -> i32 {
    if extent > 0.0 { extent.log10().ceil() as i32 } else { 0 }
}

/// Assumed number of decimal digits of a coordinate below the power of ten at or above a cloud's
/// size. Chosen by hand.
pub(super) const DIGITS: i32 = 8;

/// Returns `x` relative to `origin`.
///
/// With a map offset, f64 has lost the last digits of `x`. If a number with few decimals (a
/// multiple of 1/`digits`) is within that loss, the file contained that number, and using it gives
/// the same bits as without the offset.
pub(super) fn to_local(x: f64, origin: f64, digits: f64) -> f32 {
    let local = x - origin;
    if origin == 0.0 {
        return local as f32;
    }
    let lost = x.abs().next_up() - x.abs();
    let written = (local * digits).round() / digits;
    (if (written - local).abs() <= lost { written } else { local }) as f32
}
