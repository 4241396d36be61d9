//! f32 elementary functions without branches or tables, so that loops over them
//! vectorise inside [`pulp`]'s dispatch.

/// Computes `eˣ` for `x ≤ 0`, relative error below 4e-7 down to `x = −87.3`, and exactly 0 below
/// (where f32 would be subnormal). NaN gives NaN.
///
/// Cody-Waite reduction to `|r| ≤ ln 2 / 2`, then the Taylor series to `r⁶` by Horner.
#[inline(always)]
pub fn exp_neg(x: f32) -> f32 {
    const LOG2_E: f32 = std::f32::consts::LOG2_E;
    const LN_2_HIGH: f32 = 0.693_359_4;
    const LN_2_LOW: f32 = -2.121_944_4e-4;
    // Adding and subtracting 1.5·2²³ rounds to the nearest integer.
    const ROUND: f32 = 12_582_912.0;
    let shifted = x.mul_add(LOG2_E, ROUND);
    let n = shifted - ROUND;
    let r = (-n).mul_add(LN_2_LOW, (-n).mul_add(LN_2_HIGH, x));
    let mut series = 1.0 / 720.0;
    for coefficient in [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        series = r.mul_add(series, coefficient);
    }
    // The low bits of `shifted` are n: moved into the exponent they make 2ⁿ.
    let power = f32::from_bits(((shifted.to_bits() as i32 + 127) << 23) as u32);
    if x < -87.3 { 0.0 } else { series * power }
}

/// Computes `ln x` for normal `x > 0`, absolute error below 2e-7 near 1, relative above.
///
/// Separates the exponent so that the mantissa is in `[√½, √2)`, then `2 artanh((m − 1) / (m + 1))`
/// as an odd series to the 11th power.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    const SQRT_HALF: u32 = 0x3f35_04f3;
    let bits = x.to_bits().wrapping_sub(SQRT_HALF);
    let exponent = ((bits as i32) >> 23) as f32;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) + SQRT_HALF);
    let z = (mantissa - 1.0) / (mantissa + 1.0);
    let z2 = z * z;
    let mut series = 2.0 / 11.0;
    for coefficient in [2.0 / 9.0, 2.0 / 7.0, 2.0 / 5.0, 2.0 / 3.0, 2.0] {
        series = z2.mul_add(series, coefficient);
    }
    exponent.mul_add(std::f32::consts::LN_2, z * series)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp_neg_is_exp() {
        let mut worst = 0.0f64;
        // Miri takes a thousand times longer.
        let step = if cfg!(miri) { 997 } else { 1 };
        for i in (0..=873_000).step_by(step) {
            let x = -(i as f32) * 1e-4;
            let want = f64::from(x).exp();
            worst = worst.max((f64::from(exp_neg(x)) - want).abs() / want);
        }
        assert!(worst < 4e-7, "{worst:e}");
        assert_eq!(exp_neg(0.0), 1.0);
        assert_eq!(exp_neg(-87.4), 0.0);
        assert_eq!(exp_neg(-1e30), 0.0);
        assert_eq!(exp_neg(f32::NEG_INFINITY), 0.0);
    }

    #[test]
    fn ln_is_ln() {
        let mut x = 1e-30f32;
        while x < 1e30 {
            let want = f64::from(x).ln();
            let error = (f64::from(ln(x)) - want).abs();
            assert!(error < 2e-7 * want.abs().max(1.0), "ln {x} off by {error:e}");
            x *= 1.0137;
        }
        assert_eq!(ln(1.0), 0.0);
    }
}
