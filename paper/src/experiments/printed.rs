//! Values printed in the paper: mean and deviation of Tables I and II.

use super::cell::{Contender, Shape, Test};
use crate::{MeanStd, Motion};

const fn mean_std(mean: f64, deviation: f64) -> MeanStd {
    MeanStd { mean, deviation }
}

/// Table I (section IV-C): average shift in metres; small centred, large not centred.
const ROBUSTNESS: [(Contender, [MeanStd; 2]); 6] = [
    (Contender::Icp, [mean_std(0.0019, 0.0062), mean_std(0.070, 0.023)]),
    (Contender::Cpd, [mean_std(2.4e-9, 1.7e-10), mean_std(0.040, 0.047)]),
    (Contender::Dare, [mean_std(0.012, 0.019), mean_std(0.053, 0.035)]),
    (Contender::Teaser, [mean_std(0.0055, 0.0027), mean_std(0.0057, 0.0035)]),
    (Contender::Cf, [mean_std(0.0075, 0.0028), mean_std(0.0078, 0.0032)]),
    (Contender::Cfk, [mean_std(0.0096, 0.0043), mean_std(0.0099, 0.0052)]),
];

/// Table II (section IV-D): ‖I − R R_gtᵀ‖_F; bunny, dragon, Armadillo small, then large.
const ACCURACY: [(Contender, [MeanStd; 6]); 6] = [
    (
        Contender::Icp,
        [
            mean_std(0.045, 0.018),
            mean_std(0.045, 0.19),
            mean_std(0.036, 0.022),
            mean_std(0.96, 1.14),
            mean_std(1.09, 1.13),
            mean_std(1.17, 1.15),
        ],
    ),
    (
        Contender::Cpd,
        [
            mean_std(0.016, 0.0089),
            mean_std(0.014, 0.0083),
            mean_std(0.012, 0.0074),
            mean_std(1.15, 1.30),
            mean_std(1.11, 1.19),
            mean_std(1.13, 1.15),
        ],
    ),
    (
        Contender::Dare,
        [
            mean_std(0.020, 0.0093),
            mean_std(0.016, 0.0090),
            mean_std(0.016, 0.0083),
            mean_std(1.30, 1.26),
            mean_std(1.34, 1.22),
            mean_std(1.48, 1.16),
        ],
    ),
    (
        Contender::Teaser,
        [
            mean_std(0.14, 0.076),
            mean_std(0.15, 0.084),
            mean_std(0.16, 0.095),
            mean_std(0.15, 0.096),
            mean_std(0.13, 0.082),
            mean_std(0.14, 0.093),
        ],
    ),
    (
        Contender::Cf,
        [
            mean_std(0.16, 0.10),
            mean_std(0.19, 0.13),
            mean_std(0.28, 0.42),
            mean_std(0.18, 0.14),
            mean_std(0.14, 0.11),
            mean_std(0.15, 0.12),
        ],
    ),
    (
        Contender::Cfk,
        [
            mean_std(0.26, 0.26),
            mean_std(0.25, 0.22),
            mean_std(0.33, 0.35),
            mean_std(0.26, 0.23),
            mean_std(0.19, 0.18),
            mean_std(0.20, 0.17),
        ],
    ),
];

/// What the paper prints for a cell of its tables; `None` where it prints nothing.
pub fn printed_value(
    test: Test,
    contender: Contender,
    shape: Shape,
    motion: Motion,
) -> Option<MeanStd> {
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
            printed_value(test, contender, shape, motion).map(|spread| spread.mean)
        };
        assert_eq!(of(Test::Robustness, Contender::Cf, Shape::Bunny, Motion::Large), Some(0.0078));
        assert_eq!(of(Test::Accuracy, Contender::Cf, Shape::Armadillo, Motion::Small), Some(0.28));
        assert_eq!(of(Test::Accuracy, Contender::Teaser, Shape::Dragon, Motion::Large), Some(0.13));
        assert_eq!(of(Test::Robustness, Contender::Cf, Shape::Dragon, Motion::Large), None);
    }
}
