//! The fused moments are those of the double loop, and depend on nothing else.

use crate::common;

use cfreg::moments::{FullConnection, Moments, naive};
use cfreg::par;
use cfreg::weight::{Normalization, WeightScheme};
use common::compare::moments_difference;
use common::sides::{NORMALIZATIONS, RandomCloud, bandwidth_for};
use proptest::prelude::*;
use proptest::sample::select;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// How far f32 tiles may be from f64: squared distances are off by some 1e-7 of
/// themselves and partial sums run over up to 32 values.
fn tolerance(scheme: WeightScheme) -> f64 {
    match scheme {
        // (1 − x)² doubles the relative error of 1 − x, which is 1/500 next to the cut; it
        // shows where a few points have no other connections.
        WeightScheme::Tukey => 1e-3,
        _ => 2e-6,
    }
}

/// Around the widths of a lane (16), a block (64) and a tile (512).
fn edge() -> impl Strategy<Value = usize> {
    select(vec![1, 2, 15, 16, 17, 63, 64, 65, 511, 512, 513, 700])
}

/// A problem, by what makes it.
#[derive(Debug, Clone, Copy)]
struct Case {
    source: usize,
    target: usize,
    dim: usize,
    offset: f32,
    seed: u64,
}

impl Case {
    fn sides(self) -> [RandomCloud; 2] {
        let Case { source, target, dim, offset, seed } = self;
        [
            RandomCloud::random(source, dim, offset, seed),
            RandomCloud::random(target, dim, offset, !seed),
        ]
    }

    fn beta(self) -> f64 {
        bandwidth_for(self.dim)
    }
}

/// Dimensions on either side of where the product takes over (8); the offsets test that
/// descriptors are compared about their mean.
fn case() -> impl Strategy<Value = Case> {
    let dim = select(vec![1, 3, 7, 8, 33]);
    let offset = select(vec![0.0, 1e3, 1e6f32]);
    (edge(), edge(), dim, offset, any::<u64>())
        .prop_map(|(source, target, dim, offset, seed)| Case { source, target, dim, offset, seed })
}

fn connect([source, target]: &[RandomCloud; 2]) -> FullConnection {
    FullConnection::new(source.feature_view(), target.feature_view()).unwrap()
}

/// All that the normalisations and kernels make of the sides; `None` where no connection
/// has weight.
fn outcomes(
    sides: &[RandomCloud; 2],
    beta: f64,
) -> Vec<(WeightScheme, Normalization, Option<Moments>)> {
    let connection = connect(sides);
    let cases = WeightScheme::ALL.into_iter().flat_map(|k| NORMALIZATIONS.map(|n| (k, n)));
    cases.map(|(k, n)| (k, n, connection.scheme_moments(k, beta, n).ok())).collect()
}

/// The formulas of the catalogue in f64.
fn weight(scheme: WeightScheme, beta: f64, d2: f64) -> f64 {
    let x = d2 / beta;
    match scheme {
        WeightScheme::Gaussian => (-x).exp(),
        WeightScheme::Laplacian => (-x.sqrt()).exp(),
        WeightScheme::Cauchy => 1.0 / (1.0 + x),
        WeightScheme::GemanMcClure => (1.0 + x).powi(-2),
        WeightScheme::TruncatedQuadratic => f64::from(u8::from(x <= 1.0)),
        WeightScheme::StudentT(nu) => {
            let nu = f64::from(nu);
            (1.0 + x / nu).powf(-(nu + 1.0) / 2.0)
        }
        WeightScheme::Tukey => (1.0 - x).max(0.0).powi(2),
        WeightScheme::Uniform => 1.0,
        WeightScheme::Custom => panic!("is no kernel"),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn they_are_those_of_the_double_loop(case in case()) {
        let [source, target] = case.sides();
        for (scheme, normalization, fused) in outcomes(&case.sides(), case.beta()) {
            let kernel = |d2| weight(scheme, case.beta(), d2);
            let exact = naive::moments(source.feature_view(), target.feature_view(), kernel, normalization);
            let Some(fused) = fused else {
                prop_assert_eq!(exact.weight, 0.0, "{} {}", scheme, normalization);
                continue;
            };
            let error = moments_difference(&exact, &fused);
            prop_assert!(error < tolerance(scheme), "{scheme} {normalization}: {error:e}");
        }
    }

    #[test]
    fn they_do_not_depend_on_the_number_of_threads(case in case()) {
        // The text of a float is the shortest that reads back to its bits.
        let bits = |threads| {
            let all = par::with_threads(threads, || outcomes(&case.sides(), case.beta()));
            format!("{:?}", all.unwrap())
        };
        let one = bits(1);
        for threads in [2, 3, 7] {
            prop_assert_eq!(&one, &bits(threads), "{} threads", threads);
        }
    }

    #[test]
    fn they_swap_with_the_sides(case in case()) {
        let [source, target] = case.sides();
        let swapped = connect(&[target, source]);
        for (scheme, normalization, there) in outcomes(&case.sides(), case.beta()) {
            let normalization = match normalization {
                Normalization::Source => Normalization::Target,
                Normalization::Target => Normalization::Source,
                // Ends on the columns, which the swap makes rows.
                Normalization::Sinkhorn(_) => continue,
                symmetric => symmetric,
            };
            let back = swapped.scheme_moments(scheme, case.beta(), normalization).ok();
            prop_assert_eq!(there.is_some(), back.is_some());
            let (Some(there), Some(back)) = (there, back) else { continue };
            let error = moments_difference(&there, &back.swapped());
            prop_assert!(error < tolerance(scheme), "{scheme} {normalization}: {error:e}");
        }
    }

    #[test]
    fn they_do_not_depend_on_the_order_of_points(case in case()) {
        let mut rng = ChaCha8Rng::seed_from_u64(case.seed);
        let shuffled = case.sides().map(|side| {
            let mut order: Vec<usize> = (0..side.points.len()).collect();
            order.shuffle(&mut rng);
            side.select(&order)
        });
        let beta = case.beta();
        let pairs = outcomes(&case.sides(), beta).into_iter().zip(outcomes(&shuffled, beta));
        for ((scheme, normalization, a), (_, _, b)) in pairs {
            prop_assert_eq!(a.is_some(), b.is_some());
            let (Some(a), Some(b)) = (a, b) else { continue };
            let error = moments_difference(&a, &b);
            prop_assert!(error < tolerance(scheme), "{scheme} {normalization}: {error:e}");
        }
    }

    /// By powers of two, which f32 multiplies exactly: the digits are then the same, and a
    /// normalisation removes the factor altogether.
    #[test]
    fn they_scale_with_the_weights(case in case(), power in -20..20i32) {
        let connection = connect(&case.sides());
        let (factor, scale) = (f32::powi(2.0, power), f64::powi(2.0, power));
        let beta = case.beta() as f32;
        let kernel = |d2: f32| 1.0 / (1.0 + d2 / beta);
        for normalization in NORMALIZATIONS {
            let plain = connection.moments(&kernel, normalization).unwrap();
            let scaled = connection.moments(&|d2: f32| factor * kernel(d2), normalization).unwrap();
            let expected = match normalization {
                Normalization::None => times(&plain, scale),
                _ => plain,
            };
            prop_assert_eq!(scaled, expected, "{} times 2^{}", normalization, power);
        }
    }
}

fn times(moments: &Moments, factor: f64) -> Moments {
    Moments {
        weight: moments.weight * factor,
        weight_squared: moments.weight_squared * factor * factor,
        source_sum: moments.source_sum.map(|x| x * factor),
        target_sum: moments.target_sum.map(|x| x * factor),
        cross: moments.cross.map(|row| row.map(|x| x * factor)),
        source_squares: moments.source_squares * factor,
        target_squares: moments.target_squares * factor,
        ..*moments
    }
}

#[test]
fn a_point_finds_itself_among_many() {
    // Where descriptors coincide, the product's rounding is all there is of d²: some 1e-7
    // of |a|² ≈ 130. The Laplacian sees its root, some 1e-4 of √β.
    let side = RandomCloud::random(700, 33, 0.0, 5);
    let twins = [side.clone(), side];
    for (scheme, normalization, fused) in outcomes(&twins, bandwidth_for(33)) {
        let described = twins[0].feature_view();
        let kernel = |d2| weight(scheme, bandwidth_for(33), d2);
        let exact = naive::moments(described, described, kernel, normalization);
        let error = moments_difference(&exact, &fused.unwrap());
        let tolerance = if scheme == WeightScheme::Laplacian { 1e-4 } else { 2e-6 };
        assert!(error < tolerance, "{scheme} {normalization}: {error:e}");
    }
}

#[test]
fn a_tolerance_is_kept_and_used_where_it_pays() {
    // Above the 5·10⁷ connections below which nothing is left out.
    for dim in [3, 33] {
        let [source, target] =
            [(7_300, 1), (6_900, 2)].map(|(n, seed)| RandomCloud::random(n, dim, 0.0, seed));
        let (connection, beta) = (connect(&[source, target]), dim as f64 / 6.0);
        for normalization in [Normalization::None, Normalization::Source, Normalization::Both] {
            let moments = |tolerance| {
                let scheme = WeightScheme::Gaussian;
                connection.pruned_moments(scheme, beta, normalization, tolerance).unwrap()
            };
            let dense =
                connection.scheme_moments(WeightScheme::Gaussian, beta, normalization).unwrap();
            assert_eq!(moments(0.0), dense);
            let within = moments(1e-2);
            let off = (within.weight / dense.weight - 1.0).abs();
            assert!(off <= 1e-2 + 2e-6, "{dim} {normalization}: {off:e}");
            assert_ne!(within, dense, "{dim} {normalization}");
            let two = par::with_threads(2, || moments(1e-2)).unwrap();
            assert_eq!(within, two, "{dim} {normalization}");
        }
    }
}
