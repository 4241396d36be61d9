//! What weights mean: any kernel works, every normalisation keeps its promise as seen from
//! the moments, and weights that say nothing are an error.

use crate::common;

use cfreg::moments::{FeatureView, FullConnection, Moments, naive};
use cfreg::pose::{self, RANK_TOLERANCE, ScaleEstimate, Solver};
use cfreg::weight::{Bandwidth, Cauchy, Gaussian, Normalization, TruncatedQuadratic, Uniform};
use cfreg::{Descriptors, Error, math};
use common::compare::moments_difference;
use common::sides::{NORMALIZATIONS, RandomCloud, bandwidth_for};
use proptest::prelude::*;

const DIM: usize = 8;

fn connect(source: &RandomCloud, target: &RandomCloud) -> FullConnection {
    FullConnection::new(source.feature_view(), target.feature_view()).unwrap()
}

fn connection(source: usize, target: usize, seed: u64) -> FullConnection {
    connect(
        &RandomCloud::random(source, DIM, 0.0, seed),
        &RandomCloud::random(target, DIM, 0.0, !seed),
    )
}

// --- Kernels of one's own ------------------------------------------------------------

#[test]
fn a_closure_is_as_good_as_a_kernel_of_the_catalogue() {
    let connection = connection(300, 700, 1);
    let beta = bandwidth_for(DIM) as f32;
    let step = |d2: f32| if d2 <= beta { 1.0 } else { 0.0 };
    let cauchy = |d2: f32| 1.0 / (1.0 + d2 * (1.0 / beta));
    let exp = |d2: f32| (-d2 / beta).exp();
    for normalization in NORMALIZATIONS {
        let of = |moments: Result<Moments, Error>| moments.unwrap();
        let catalogue = of(connection.moments(&TruncatedQuadratic { beta }, normalization));
        assert_eq!(of(connection.moments(&step, normalization)), catalogue, "{normalization}");
        let catalogue = of(connection.moments(&Cauchy { beta }, normalization));
        assert_eq!(of(connection.moments(&cauchy, normalization)), catalogue, "{normalization}");
        // The catalogue's exponential is its own, good to 4e-7.
        let catalogue = of(connection.moments(&Gaussian { beta }, normalization));
        let error = moments_difference(&catalogue, &of(connection.moments(&exp, normalization)));
        assert!(error < 4e-7, "{normalization}: {error:e}");
    }
}

#[test]
fn one_bad_weight_is_reported_whatever_is_done_with_it() {
    let mut source = RandomCloud::random(100, 1, 0.0, 1);
    let target = RandomCloud::random(600, 1, 0.0, 2);
    let mut values = source.descriptors.as_slice().to_vec();
    values[77] = 100.0;
    source.descriptors = Descriptors::new(1, values).unwrap();
    let connection = connect(&source, &target);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        // d² is above 9000 from the odd one out to everyone, and at most 36 else.
        let kernel = |d2: f32| if d2 > 1000.0 { bad } else { 1.0 };
        for normalization in NORMALIZATIONS {
            let found = connection.moments(&kernel, normalization);
            assert!(
                matches!(found, Err(Error::NonFinite { .. })),
                "{bad} {normalization}: {found:?}"
            );
        }
    }
}

#[test]
fn weights_that_all_vanish_are_an_error() {
    let connection = connection(20, 30, 1);
    for normalization in NORMALIZATIONS {
        let zero = connection.moments(&|_: f32| 0.0, normalization);
        assert!(matches!(zero, Err(Error::NoWeight { .. })), "{normalization}: {zero:?}");
        // A subnormal sum has no reciprocal in f32.
        let subnormal = connection.moments(&|_: f32| 1e-42, normalization);
        match normalization {
            Normalization::None => assert!(subnormal.is_ok()),
            _ => assert!(matches!(subnormal, Err(Error::NoWeight { .. })), "{normalization}"),
        }
    }
}

// --- Weights that do not tell points apart -------------------------------------------

#[test]
fn equal_weights_determine_no_rotation() {
    for (source, target) in [(1, 1), (7, 900), (513, 65), (1000, 3000)] {
        let connection = connection(source, target, 3);
        for normalization in NORMALIZATIONS {
            let moments = connection.moments(&Uniform, normalization).unwrap();
            for solver in Solver::ALL {
                match pose::solve(&moments, solver, ScaleEstimate::Fixed) {
                    Err(Error::Degenerate { rank: 0, singular_values }) => {
                        // All rows of W Q̃ have the same bits, so that rounding is f64's.
                        assert!(singular_values[0] < 1e-12, "{singular_values:?}");
                    }
                    other => panic!("{source} x {target}, {normalization}, {solver}: {other:?}"),
                }
            }
        }
    }
}

#[test]
fn the_message_names_the_tolerance_that_was_missed() {
    let moments = connection(20, 30, 3).moments(&Uniform, Normalization::None).unwrap();
    let error = pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed).unwrap_err();
    assert!(error.to_string().contains(&format!("exceed {RANK_TOLERANCE:e}")), "{error}");
}

// --- Bandwidths that follow from the descriptors --------------------------------------

/// Least squared distance from each row of `from` to any of `to`, by a double loop in f64.
fn least(from: &RandomCloud, to: &RandomCloud) -> Vec<f64> {
    let d2 = |a: &[f32], b: &[f32]| -> f64 {
        a.iter().zip(b).map(|(x, y)| (f64::from(*x) - f64::from(*y)).powi(2)).sum()
    };
    let nearest = |a| to.descriptors.rows().map(|b| d2(a, b)).fold(f64::INFINITY, f64::min);
    from.descriptors.rows().map(nearest).collect()
}

#[test]
fn an_automatic_bandwidth_is_a_share_of_the_median_least_distance_both_ways() {
    let (source, target) =
        (RandomCloud::random(300, DIM, 0.0, 1), RandomCloud::random(701, DIM, 0.0, 2));
    let mut all = [least(&source, &target), least(&target, &source)].concat();
    all.sort_by(f64::total_cmp);
    for share in [0.1, 0.25, 3.0] {
        let expected = share * all[all.len() / 2];
        let auto = Bandwidth::Auto(share);
        let found = connect(&source, &target).bandwidth(auto).unwrap();
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
        assert_eq!(connect(&target, &source).bandwidth(auto).unwrap(), found);
    }
}

#[test]
fn an_automatic_bandwidth_stays_above_the_rounding_of_distances() {
    let side = RandomCloud::random(200, DIM, 0.0, 3);
    let connection = connect(&side, &side);
    let found = connection.bandwidth(Bandwidth::Auto(0.25)).unwrap();
    // Rows are drawn with a variance of 1/12 or 1 in each dimension; the same rows are 0 apart.
    assert!((1e-4..1e-1).contains(&found), "{found}");
    let moments = connection.moments(&Gaussian { beta: found as f32 }, Normalization::Both);
    assert!((moments.unwrap().weight / 200.0 - 1.0).abs() < 1e-2);
    let flat = RandomCloud { descriptors: Descriptors::new(1, vec![5.0; 200]).unwrap(), ..side };
    let least = connect(&flat, &flat).bandwidth(Bandwidth::Auto(0.25)).unwrap();
    assert!(least > 0.0 && least < 1e-9, "{least}");
    let refused = connection.bandwidth(Bandwidth::Auto(f64::NAN));
    assert!(matches!(refused, Err(Error::Config { field: "beta", .. })));
}

// --- Normalisations, seen from outside -----------------------------------------------

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// If every source weighs one, sums that only know the source are those of its points.
    #[test]
    fn under_source_every_source_speaks_with_one_voice(n in 1..200usize, m in 1..600usize, seed: u64) {
        let source = RandomCloud::random(n, DIM, 0.0, seed);
        let connection = connect(&source, &RandomCloud::random(m, DIM, 0.0, !seed));
        let kernel = Gaussian { beta: bandwidth_for(DIM) as f32 };
        let moments = connection.moments(&kernel, Normalization::Source).unwrap();
        assert_voices(&moments, &source, n as f64);
    }

    #[test]
    fn under_target_every_target_speaks_with_one_voice(n in 1..200usize, m in 1..600usize, seed: u64) {
        let target = RandomCloud::random(m, DIM, 0.0, !seed);
        let connection = connect(&RandomCloud::random(n, DIM, 0.0, seed), &target);
        let kernel = Gaussian { beta: bandwidth_for(DIM) as f32 };
        let moments = connection.moments(&kernel, Normalization::Target).unwrap();
        assert_voices(&moments.swapped(), &target, m as f64);
    }

    #[test]
    fn under_sinkhorn_both_sides_speak_with_equal_voices(n in 1..200usize, m in 1..600usize, seed: u64) {
        let (source, target) = (RandomCloud::random(n, DIM, 0.0, seed), RandomCloud::random(m, DIM, 0.0, !seed));
        let connection = connect(&source, &target);
        let kernel = Gaussian { beta: bandwidth_for(DIM) as f32 };
        let one = connection.moments(&kernel, Normalization::Sinkhorn(1)).unwrap();
        // It ends on the columns; the rows take a few rounds.
        assert_voices(&one.swapped(), &target, 1.0);
        let many = connection.moments(&kernel, Normalization::Sinkhorn(40)).unwrap();
        assert_voices(&many.swapped(), &target, 1.0);
        assert_voices(&many, &source, 1.0);
    }
}

/// Whether all points of the source side have the same share of `weight`, as far as
/// moments tell.
fn assert_voices(moments: &Moments, side: &RandomCloud, weight: f64) {
    let share = weight / side.points.len() as f64;
    let mut points = Moments::about(side.origin, side.origin);
    side.points.iter().map(|p| p.map(f64::from)).for_each(|p| points.add_pair(share, p, p));
    let found = naive::shift_origins(moments, side.origin, moments.target_origin);
    let close = |found: f64, want: f64| (found - want).abs() < 2e-6 * weight;
    assert!(close(found.weight, weight), "{} {weight}", found.weight);
    assert!(close(found.source_squares, points.source_squares), "{found:?} {points:?}");
    let rest = math::norm(math::sub(found.source_sum, points.source_sum));
    assert!(close(rest, 0.0), "{found:?} {points:?}");
}

/// An outlier a side that only knows the other, and that from so far that their weight is
/// 1e-25, which would square to zero.
#[test]
fn tiny_weights_get_their_due_under_every_normalisation() {
    let beta = 2.0f32;
    let far = (25.0 * std::f32::consts::LN_10 * beta).sqrt();
    let crowd = |at: f32| (0..40).map(move |i| at + (i % 5) as f32 * 0.1);
    let side = |outlier: f32, seed| {
        let values = crowd(0.0).chain([outlier]).collect();
        RandomCloud {
            descriptors: Descriptors::new(1, values).unwrap(),
            ..RandomCloud::random(41, 1, 0.0, seed)
        }
    };
    // 100 away from the crowd, `far` from each other.
    let (source, target) = (side(100.0, 1), side(100.0 + far, 2));
    let connection = connect(&source, &target);
    let weight = |d2: f64| (-d2 / f64::from(beta)).exp();
    for normalization in NORMALIZATIONS {
        let fused = connection.moments(&Gaussian { beta }, normalization).unwrap();
        let exact =
            naive::moments(source.feature_view(), target.feature_view(), weight, normalization);
        let error = moments_difference(&exact, &fused);
        assert!(error < 1e-6, "{normalization}: {error:e}");
    }
    let dual = connection.moments(&Gaussian { beta }, Normalization::Both).unwrap();
    let crowd_only: Vec<usize> = (0..40).collect();
    let without = connect(&source.select(&crowd_only), &target.select(&crowd_only));
    let without = without.moments(&Gaussian { beta }, Normalization::Both).unwrap();
    assert!(
        (dual.weight - without.weight - 1.0).abs() < 1e-6,
        "{} {}",
        dual.weight,
        without.weight
    );
}

#[test]
fn the_effective_number_of_connections_has_no_unit() {
    let connection = connection(100, 200, 1);
    let weighed = |weight: f32| connection.moments(&|_: f32| weight, Normalization::None);
    for weight in [1e-27, 1e-10, 1.0, 1e9f32] {
        let found = weighed(weight).unwrap().effective_connections();
        assert!((found / 20_000.0 - 1.0).abs() < 1e-6, "{weight}: {found}");
    }
    // Squares that leave f32 are no number of connections.
    assert!(matches!(weighed(1e25), Err(Error::NonFinite { .. })));
}

// --- Shapes --------------------------------------------------------------------------

#[test]
fn sides_that_do_not_fit_are_refused() {
    let side = RandomCloud::random(5, DIM, 0.0, 1);
    let described = side.feature_view();
    let refused = |source, target| FullConnection::new(source, target).err().unwrap();
    let narrow = RandomCloud::random(5, 7, 0.0, 1);
    let found = refused(described, narrow.feature_view());
    assert!(matches!(found, Error::Shape { expected: DIM, found: 7, .. }), "{found}");
    let short = FeatureView { points: &side.points[1..], ..described };
    for found in [refused(short, described), refused(described, short)] {
        assert!(matches!(found, Error::Shape { expected: 4, found: 5, .. }), "{found}");
    }
    let none = side.select(&[]);
    for found in [refused(none.feature_view(), described), refused(described, none.feature_view())]
    {
        assert!(matches!(found, Error::TooFewPoints { found: 0, needed: 1, .. }), "{found}");
    }
    let huge = Descriptors::new(DIM, [0.0, 0.0, 1e19, 0.0, 0.0].repeat(DIM)).unwrap();
    let found = refused(described, FeatureView { descriptors: &huge, ..described });
    assert!(matches!(found, Error::NonFinite { .. }), "{found}");
}
