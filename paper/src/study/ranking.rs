//! Ranking of schemes, with confidence intervals.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::condition::Condition;
use super::trials::TrialOutcome;

/// A figure and the interval that contains it in 95 of 100 repetitions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// From all trials.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// A scheme's mean error over that of the paper's, below 1 if it is better: for each kind of
/// condition the geometric mean over its conditions, and overall with equal weight for each kind.
#[derive(Debug, Clone, PartialEq)]
pub struct SchemeRanking {
    /// Name of the scheme.
    pub scheme: String,
    /// Over all kinds.
    pub overall: Interval,
    /// By kind, in the order of the conditions.
    pub kinds: Vec<(&'static str, Interval)>,
}

/// Errors of every entrant in one condition: `errors[entrant][trial]`.
pub(super) struct Errors {
    pub(super) condition: Condition,
    pub(super) errors: Vec<Vec<f64>>,
}

impl Errors {
    /// Of outcomes that go trial by trial through the `entrants`.
    pub(super) fn from_outcomes(
        condition: Condition,
        outcomes: &[TrialOutcome],
        entrants: usize,
    ) -> Self {
        let of = |entrant: usize| {
            outcomes
                .iter()
                .skip(entrant)
                .step_by(entrants.max(1))
                .map(TrialOutcome::error)
                .collect()
        };
        Errors { condition, errors: (0..entrants).map(of).collect() }
    }

    /// Returns the mean error of every entrant over the trials `chosen`.
    pub(super) fn means(&self, chosen: impl ExactSizeIterator<Item = usize> + Clone) -> Vec<f64> {
        let n = chosen.len() as f64;
        let mean = |errors: &Vec<f64>| chosen.clone().map(|trial| errors[trial]).sum::<f64>() / n;
        self.errors.iter().map(mean).collect()
    }

    /// Returns the number of trials.
    pub(super) fn trials(&self) -> usize {
        self.errors.first().map_or(0, Vec::len)
    }
}

/// Times that trials are drawn again, with replacement, the same for all entrants (Efron and
/// Tibshirani 1993, the percentile interval).
const BOOTSTRAP_SAMPLES: usize = 1000;

/// Standings of all entrants against the one numbered `base`, the best first.
pub(super) fn rank_schemes(
    names: &[String],
    base: usize,
    conditions: &[Errors],
) -> Vec<SchemeRanking> {
    let conditions: Vec<&Errors> =
        conditions.iter().filter(|condition| condition.trials() > 0).collect();
    let of: Vec<Condition> = conditions.iter().map(|errors| errors.condition).collect();
    let whole: Vec<Vec<f64>> =
        conditions.iter().map(|errors| errors.means(0..errors.trials())).collect();
    let all = scores(&of, &whole, base);
    let n = conditions.iter().map(|errors| errors.trials()).min().unwrap_or(0);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let drawn: Vec<Vec<Vec<f64>>> = (0..BOOTSTRAP_SAMPLES)
        .map(|_| {
            // The same numbers in all conditions: trials of a number share their random draws.
            let chosen: Vec<usize> = (0..n).map(|_| rng.random_range(0..n)).collect();
            let means: Vec<Vec<f64>> =
                conditions.iter().map(|errors| errors.means(chosen.iter().copied())).collect();
            scores(&of, &means, base)
        })
        .collect();
    let interval = |entrant: usize, column: usize| {
        let mut values: Vec<f64> = drawn.iter().map(|scores| scores[entrant][column]).collect();
        values.sort_by(f64::total_cmp);
        let at =
            |share: f64| values[(share * (BOOTSTRAP_SAMPLES - 1) as f64).round() as usize].exp();
        Interval { value: all[entrant][column].exp(), low: at(0.025), high: at(0.975) }
    };
    let by_kind = |entrant: usize| {
        kinds(&of).into_iter().enumerate().map(move |(k, kind)| (kind, interval(entrant, k + 1)))
    };
    let standing = |(entrant, name): (usize, &String)| SchemeRanking {
        scheme: name.clone(),
        overall: interval(entrant, 0),
        kinds: by_kind(entrant).collect(),
    };
    let mut standings: Vec<SchemeRanking> = names.iter().enumerate().map(standing).collect();
    standings.sort_by(|a, b| a.overall.value.total_cmp(&b.overall.value));
    standings
}

/// Returns the kinds of the conditions, each once, in order.
pub(super) fn kinds(conditions: &[Condition]) -> Vec<&'static str> {
    let mut kinds: Vec<&'static str> =
        conditions.iter().map(|condition| condition.kind().0).collect();
    kinds.dedup();
    kinds
}

/// Returns `[entrant][column]`: the mean logarithm of the ratio to `base` over all kinds, then by
/// kind, from `means[condition][entrant]`.
pub(super) fn scores(conditions: &[Condition], means: &[Vec<f64>], base: usize) -> Vec<Vec<f64>> {
    let kinds = kinds(conditions);
    let entrants = means.first().map_or(0, Vec::len);
    let row = |entrant: usize| {
        let of_kind = |kind: &&'static str| {
            let ratios: Vec<f64> = conditions
                .iter()
                .zip(means)
                .filter(|(condition, _)| condition.kind().0 == *kind)
                // An error of exactly zero has no logarithm.
                .map(|(_, means)| (means[entrant].max(1e-12) / means[base].max(1e-12)).ln())
                .collect();
            ratios.iter().sum::<f64>() / ratios.len() as f64
        };
        let by_kind: Vec<f64> = kinds.iter().map(of_kind).collect();
        let overall = by_kind.iter().sum::<f64>() / by_kind.len() as f64;
        [vec![overall], by_kind].concat()
    };
    (0..entrants).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(condition: Condition, base: &[f64], factor: f64) -> Errors {
        let other = base.iter().map(|error| factor * error).collect();
        Errors { condition, errors: vec![base.to_vec(), other] }
    }

    #[test]
    fn a_constant_factor_is_found_with_certainty() {
        let names = ["paper".to_string(), "better".to_string()];
        let conditions = [
            errors(Condition::Independent, &[0.1, 0.4, 0.2], 0.5),
            errors(Condition::Noise(0.01), &[0.3, 0.3, 0.3], 0.5),
            errors(Condition::Noise(0.02), &[1.0, 2.0, 1.0], 0.02),
        ];
        let standings = rank_schemes(&names, 0, &conditions);
        assert_eq!(standings[0].scheme, "better");
        let kinds: Vec<_> = standings[0].kinds.iter().map(|(kind, i)| (*kind, i.value)).collect();
        assert_eq!(kinds[0], ("independent", 0.5));
        // Geometric mean of 0.5 and 0.02, then of 0.5 and 0.1.
        assert!(kinds[1].0 == "noise" && (kinds[1].1 - 0.1).abs() < 1e-12);
        let overall = standings[0].overall;
        assert!((overall.value - 0.05f64.sqrt()).abs() < 1e-12);
        assert!(overall.high - overall.low < 1e-12);
        assert_eq!(standings[1].overall.value, 1.0);
    }

    #[test]
    fn conditions_that_share_their_trials_are_no_more_certain_than_one() {
        let names = ["paper".to_string(), "other".to_string()];
        let one = |sigma| {
            let other: Vec<f64> = (0..40).map(|k| if k % 4 == 0 { 2.0 } else { 0.4 }).collect();
            Errors { condition: Condition::Noise(sigma), errors: vec![vec![1.0; 40], other] }
        };
        let of = |conditions: &[Errors]| {
            let found = rank_schemes(&names, 0, conditions);
            found.iter().find(|s| s.scheme == "other").unwrap().overall
        };
        let (alone, twice) = (of(&[one(0.01)]), of(&[one(0.01), one(0.02)]));
        for (a, b) in [(alone.low, twice.low), (alone.high, twice.high)] {
            assert!((a - b).abs() < 1e-12, "{alone:?} {twice:?}");
        }
    }

    #[test]
    fn an_interval_widens_with_the_spread_and_holds_its_figure() {
        let names = ["paper".to_string(), "other".to_string()];
        let paper = vec![1.0; 40];
        let other: Vec<f64> = (0..40).map(|k| if k % 4 == 0 { 2.0 } else { 0.4 }).collect();
        let one = Errors { condition: Condition::Independent, errors: vec![paper, other] };
        let found = rank_schemes(&names, 0, &[one]);
        let interval = found.iter().find(|s| s.scheme == "other").unwrap().overall;
        assert!((interval.value - 0.8).abs() < 1e-12);
        // Standard error 0.69/√40 = 0.11, twice that on either side.
        assert!((0.5..0.68).contains(&interval.low), "{interval:?}");
        assert!((0.92..1.1).contains(&interval.high), "{interval:?}");
    }
}
