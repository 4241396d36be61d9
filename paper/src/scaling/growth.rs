//! The exponent of a power law.

/// The exponent p of y ≈ c·Nᵖ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// p.
    pub exponent: f64,
    /// Its standard error, from the residuals of the straight line in logarithms.
    pub error: f64,
    /// Smallest N of the fit.
    pub from: f64,
}

/// Values of a fit at the least: two make a line without any error.
const MIN_SIZES: usize = 3;
/// Largest N over the smallest of a fit, where there are values enough: at small N what does
/// not grow, or less, hides the power.
const MIN_SIZE_RATIO: f64 = 10.0;

impl Growth {
    /// Fits log y over log N of the pairs (N, y), in order of growing N, by least squares. Uses the
    /// pairs of the last decade, or the last three if that has fewer. `None` for fewer than three
    /// pairs, or values that are not above zero.
    pub fn fit(pairs: &[[f64; 2]]) -> Option<Self> {
        let last = pairs.last()?[0];
        let within =
            pairs.iter().filter(|pair| pair[0] * MIN_SIZE_RATIO >= last * (1.0 - 1e-9)).count();
        let first = pairs.len().checked_sub(within.max(MIN_SIZES))?;
        let upper = &pairs[first..];
        if upper.as_flattened().iter().any(|x| !(*x > 0.0 && x.is_finite())) {
            return None;
        }
        let logs: Vec<[f64; 2]> = upper.iter().map(|pair| pair.map(f64::ln)).collect();
        let n = logs.len() as f64;
        let mean = [0, 1].map(|a| logs.iter().map(|p| p[a]).sum::<f64>() / n);
        let centred = || logs.iter().map(|p| [p[0] - mean[0], p[1] - mean[1]]);
        let spread: f64 = centred().map(|[x, _]| x * x).sum();
        let exponent = centred().map(|[x, y]| x * y).sum::<f64>() / spread;
        let rest: f64 = centred().map(|[x, y]| (y - exponent * x).powi(2)).sum();
        let error = (rest / (n - 2.0) / spread).sqrt();
        exponent.is_finite().then_some(Growth { exponent, error, from: upper[0][0] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_exponent_comes_back_with_its_error() {
        let pairs = |y: fn(f64) -> f64| [1e2, 2e2, 5e2, 1e3, 2e3, 5e3].map(|n| [n, y(n)]);
        let exact = Growth::fit(&pairs(|n| 3e-7 * n.powf(1.7))).unwrap();
        assert!((exact.exponent - 1.7).abs() < 1e-12 && exact.error < 1e-12, "{exact:?}");
        assert_eq!(exact.from, 5e2);
        // A constant that the last decade hardly sees.
        let raised = Growth::fit(&pairs(|n| 1e4 + n * n)).unwrap();
        assert!((raised.exponent - 2.0).abs() < 0.03, "{raised:?}");
        // Deviations of a tenth up and down: for log y = 2 log N ± 0.1, at log N = 0, 1, 2, 3 times
        // ln 2, the slope is 2 - 0.04/ln 2, with a residual of 0.032.
        let off =
            |k: i32| [2f64.powi(k), 4f64.powi(k) * (if k % 2 == 0 { 0.1f64 } else { -0.1 }).exp()];
        let uneven = Growth::fit(&[0, 1, 2, 3].map(off)).unwrap();
        let slope = 2.0 - 0.04 / 2f64.ln();
        let error = (0.032f64 / 2.0 / 5.0).sqrt() / 2f64.ln();
        assert!((uneven.exponent - slope).abs() < 1e-12, "{uneven:?}");
        assert!((uneven.error - error).abs() < 1e-12, "{uneven:?} {error}");
    }

    #[test]
    fn too_few_or_impossible_values_have_no_exponent() {
        assert_eq!(Growth::fit(&[]), None);
        assert_eq!(Growth::fit(&[[1.0, 1.0], [2.0, 4.0]]), None);
        assert_eq!(Growth::fit(&[[1.0, 0.0], [2.0, 4.0], [4.0, 8.0]]), None);
        assert_eq!(Growth::fit(&[[1.0, 1.0]; 3]), None);
        // Three that are far apart.
        let far = Growth::fit(&[[1.0, 2.0], [100.0, 200.0], [1e4, 2e4]]).unwrap();
        assert!((far.exponent - 1.0).abs() < 1e-12);
    }
}
