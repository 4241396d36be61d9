//! Values printed in the paper: mean and deviation of Tables I and II.

use super::cell::{Contender, Shape, Test};
use crate::{Motion, Spread};

const fn spread(mean: f64, deviation: f64) -> Spread {
    Spread { mean, deviation }
}

/// Table I (section IV-C): average shift in metres; small centred, large not centred.
const ROBUSTNESS: [(Contender, [Spread; 2]); 6] = [
    (Contender::Icp, [spread(0.0019, 0.0062), spread(0.070, 0.023)]),
    (Contender::Cpd, [spread(2.4e-9, 1.7e-10), spread(0.040, 0.047)]),
    (Contender::Dare, [spread(0.012, 0.019), spread(0.053, 0.035)]),
    (Contender::Teaser, [spread(0.0055, 0.0027), spread(0.0057, 0.0035)]),
    (Contender::Cf, [spread(0.0075, 0.0028), spread(0.0078, 0.0032)]),
    (Contender::Cfk, [spread(0.0096, 0.0043), spread(0.0099, 0.0052)]),
];

/// Table II (section IV-D): ‖I − R R_gtᵀ‖_F; bunny, dragon, Armadillo small, then large.
const ACCURACY: [(Contender, [Spread; 6]); 6] = [
    (
        Contender::Icp,
        [
            spread(0.045, 0.018),
            spread(0.045, 0.19),
            spread(0.036, 0.022),
            spread(0.96, 1.14),
            spread(1.09, 1.13),
            spread(1.17, 1.15),
        ],
    ),
    (
        Contender::Cpd,
        [
            spread(0.016, 0.0089),
            spread(0.014, 0.0083),
            spread(0.012, 0.0074),
            spread(1.15, 1.30),
            spread(1.11, 1.19),
            spread(1.13, 1.15),
        ],
    ),
    (
        Contender::Dare,
        [
            spread(0.020, 0.0093),
            spread(0.016, 0.0090),
            spread(0.016, 0.0083),
            spread(1.30, 1.26),
            spread(1.34, 1.22),
            spread(1.48, 1.16),
        ],
    ),
    (
        Contender::Teaser,
        [
            spread(0.14, 0.076),
            spread(0.15, 0.084),
            spread(0.16, 0.095),
            spread(0.15, 0.096),
            spread(0.13, 0.082),
            spread(0.14, 0.093),
        ],
    ),
    (
        Contender::Cf,
        [
            spread(0.16, 0.10),
            spread(0.19, 0.13),
            spread(0.28, 0.42),
            spread(0.18, 0.14),
            spread(0.14, 0.11),
            spread(0.15, 0.12),
        ],
    ),
    (
        Contender::Cfk,
        [
            spread(0.26, 0.26),
            spread(0.25, 0.22),
            spread(0.33, 0.35),
            spread(0.26, 0.23),
            spread(0.19, 0.18),
            spread(0.20, 0.17),
        ],
    ),
];

/// Returns the paper's value for a cell of its tables; `None` if it prints none.
pub fn printed(test: Test, contender: Contender, shape: Shape, motion: Motion) -> Option<Spread> {
    let large = usize::from(motion == Motion::Large);
    let of = |name: &Contender| *name == contender;
    match test {
        Test::Robustness if shape == Shape::Bunny => {
            ROBUSTNESS.iter().find(|(name, _)| of(name)).map(|(_, row)| row[large])
        }
        Test::Accuracy => {
            let column = 3 * large + shape as usize;
            ACCURACY.iter().find(|(name, _)| of(name)).map(|(_, row)| row[column])
        }
        Test::Robustness | Test::Sensitivity => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_where_the_paper_has_them() {
        let of = |test, contender, shape, motion| {
            printed(test, contender, shape, motion).map(|spread| spread.mean)
        };
        assert_eq!(of(Test::Robustness, Contender::Cf, Shape::Bunny, Motion::Large), Some(0.0078));
        assert_eq!(of(Test::Accuracy, Contender::Cf, Shape::Armadillo, Motion::Small), Some(0.28));
        assert_eq!(of(Test::Accuracy, Contender::Teaser, Shape::Dragon, Motion::Large), Some(0.13));
        assert_eq!(of(Test::Robustness, Contender::Cf, Shape::Dragon, Motion::Large), None);
    }
}
