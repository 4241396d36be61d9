//! Confidence intervals of shares.

/// Returns the interval of Clopper and Pearson (Biometrika 1934) for the probability behind `right`
/// successes of `all`, at the confidence 95 %: exact, never too short. (0, 1) without trials.
pub fn clopper_pearson(right: usize, all: usize) -> (f64, f64) {
    const TAIL: f64 = 0.025;
    if all == 0 {
        return (0.0, 1.0);
    }
    // The probability of at least `right` successes grows with p, of at most `right` it falls.
    let low = bisect(|p| upper_tail(right, all, p) < TAIL);
    let high = bisect(|p| 1.0 - upper_tail(right + 1, all, p) > TAIL);
    (if right == 0 { 0.0 } else { low }, if right >= all { 1.0 } else { high })
}

/// Returns where `is_below` turns false between 0 and 1.
fn bisect(is_below: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if is_below(middle) { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Returns the probability of at least `least` successes in `all` trials.
fn upper_tail(least: usize, all: usize, p: f64) -> f64 {
    let mut logarithm = 0.0;
    let mut sum = 0.0;
    for k in 0..=all {
        if k > 0 {
            logarithm += ((all - k + 1) as f64 / k as f64).ln();
        }
        if k >= least {
            sum += (logarithm + k as f64 * p.ln() + (all - k) as f64 * (1.0 - p).ln()).exp();
        }
    }
    sum.min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_tables() {
        // scipy.stats.binomtest(k, n).proportion_ci(0.95, "exact").
        for (right, all, low, high) in [
            (0, 32, 0.0, 0.108_881),
            (4, 22, 0.051_867_3, 0.402_846),
            (26, 26, 0.867_725, 1.0),
            (61, 69, 0.784_267, 0.948_593),
        ] {
            let (found_low, found_high) = clopper_pearson(right, all);
            assert!((found_low - low).abs() < 2e-6, "{right}/{all}: {found_low}");
            assert!((found_high - high).abs() < 2e-6, "{right}/{all}: {found_high}");
        }
        assert_eq!(clopper_pearson(0, 0), (0.0, 1.0));
    }
}
