//! The error bound, against the double loop and against the dense pass.

use proptest::prelude::*;
use proptest::sample::select;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::tile::{Reducer, Scaling, weigh_block};
use super::super::{FeatureView, FullConnection, Moments, naive};
use super::PrunedPass;
use super::bounded_side::{BLOCK, BoundedSide, GROUP, PrincipalAxes};
use super::gathered_tile::{GatheredTile, MAX_GROUPS_PER_TILE};
use crate::cloud::Descriptors;
use crate::error::Error;
use crate::math::{self, Vec3};
use crate::par;
use crate::weight::{Gaussian, Normalization, WeightScheme};

const NORMALIZATIONS: [Normalization; 5] = [
    Normalization::None,
    Normalization::Source,
    Normalization::Target,
    Normalization::Both,
    Normalization::Sinkhorn(3),
];

struct RandomSide {
    points: Vec<[f32; 3]>,
    descriptors: Descriptors,
}

impl RandomSide {
    /// Integer descriptors around `clusters` centres within ±`apart`, each within ±`spread` of its
    /// own centre, each followed by its negative: the mean is 0, and all squared distances are
    /// exact in f32. One in four is a duplicate of another.
    fn new(shape: Shape, n: usize, seed: u64) -> RandomSide {
        let Shape { dim, clusters, apart, spread, .. } = shape;
        let row = |rng: &mut ChaCha8Rng, size: i32| -> Vec<i32> {
            (0..dim).map(|_| rng.random_range(-size..=size)).collect()
        };
        // Both sides share the centres.
        let mut rng = ChaCha8Rng::seed_from_u64(shape.seed);
        let centres: Vec<Vec<i32>> = (0..clusters).map(|_| row(&mut rng, apart)).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut rows: Vec<Vec<i32>> = Vec::new();
        for pair in 0..n / 2 {
            let own = match pair % 4 {
                3 => rows[rng.random_range(0..rows.len())].clone(),
                _ => {
                    let centre = &centres[rng.random_range(0..clusters)];
                    centre.iter().zip(row(&mut rng, spread)).map(|(a, b)| a + b).collect()
                }
            };
            rows.push(own.iter().map(|x| -x).collect());
            rows.push(own);
        }
        rows.resize(n, vec![0; dim]);
        let values = rows.concat().into_iter().map(|x| x as f32).collect();
        let points = (0..n).map(|_| [0; 3].map(|_| rng.random_range(-1.0..1.0f32))).collect();
        RandomSide { points, descriptors: Descriptors::new(dim, values).unwrap() }
    }

    fn described(&self) -> FeatureView<'_> {
        let RandomSide { points, descriptors } = self;
        FeatureView { points, origin: [500.0, -20.0, 3.0], descriptors }
    }
}

#[derive(Debug, Clone, Copy)]
struct Shape {
    sizes: [usize; 2],
    dim: usize,
    clusters: usize,
    apart: i32,
    spread: i32,
    seed: u64,
}

impl Shape {
    fn sides(self) -> [RandomSide; 2] {
        let [n, m] = self.sizes;
        [RandomSide::new(self, n, self.seed), RandomSide::new(self, m, !self.seed)]
    }
}

/// Sizes around a group (8), a block (64) and a tile (480); descriptors in one heap, in clusters,
/// and spread out until few have a near one.
fn shape() -> impl Strategy<Value = Shape> {
    let size = || select(vec![1, 2, 7, 8, 9, 63, 65, 100, 479, 481, 700]);
    let dim = select(vec![1, 3, 7, 8, 33, 99]);
    let form = (select(vec![1, 5, 40]), select(vec![0, 10, 100]), select(vec![0, 1, 5]));
    ([size(), size()], dim, form, any::<u64>()).prop_map(
        |(sizes, dim, (clusters, apart, spread), seed)| Shape {
            sizes,
            dim,
            clusters,
            apart,
            spread,
            seed,
        },
    )
}

/// Squared bandwidths that differ from all integers.
fn beta() -> impl Strategy<Value = f64> {
    select(vec![2.5, 30.5, 500.5])
}

fn tolerance() -> impl Strategy<Value = f64> {
    select(vec![1e-9, 1e-6, 1e-3, 1e-2, 0.1, 0.5, 0.9])
}

/// Error of f32: exponentials and sums, as in the dense pass.
const ROUNDING: f64 = 5e-6;

fn connect([source, target]: &[RandomSide; 2]) -> FullConnection {
    FullConnection::new(source.described(), target.described()).unwrap()
}

/// Largest difference of a moment in the error bound's unit Σw max|f|.
fn differ_by(exact: &Moments, found: &Moments) -> f64 {
    let found = naive::shift_origins(found, exact.source_origin, exact.target_origin);
    // Points and their mean are within the same cube of side 2.
    let (longest, w) = (12f64.sqrt(), exact.weight);
    let vector = |a: Vec3, b: Vec3| math::norm(math::sub(a, b)) / (longest * w);
    let square = |a: f64, b: f64| (a - b).abs() / (longest * longest * w);
    let cross = math::frobenius(&math::mat_sub(&exact.cross, &found.cross));
    [
        (exact.weight - found.weight).abs() / w,
        square(exact.source_squares, found.source_squares),
        square(exact.target_squares, found.target_squares),
        vector(exact.source_sum, found.source_sum),
        vector(exact.target_sum, found.target_sum),
        square(cross, 0.0),
    ]
    // `max` would drop a NaN.
    .into_iter()
    .fold(0.0, |worst, x| if x <= worst { worst } else { x })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn moments_keep_the_promise(shape in shape(), beta in beta(), tolerance in tolerance()) {
        let sides = shape.sides();
        let [source, target] = [&sides[0], &sides[1]].map(RandomSide::described);
        let connection = connect(&sides);
        for scheme in WeightScheme::ALL.into_iter().chain([WeightScheme::StudentT(50.0)]) {
            for normalization in NORMALIZATIONS {
                let what = format!("{scheme} {normalization}");
                let (found, weighed) =
                    connection.pruned_moments_with_count(scheme, beta, normalization, tolerance).unwrap();
                let passes = match normalization {
                    Normalization::None => 1,
                    Normalization::Source | Normalization::Target => 2,
                    Normalization::Both => 3,
                    Normalization::Sinkhorn(rounds) => 2 * u64::from(rounds) + 1,
                };
                prop_assert!(weighed <= passes * connection.pairs(), "{what}");
                let Ok(dense) = connection.scheme_moments(scheme, beta, normalization) else {
                    prop_assert_eq!(found.weight, 0.0, "{}", what);
                    continue;
                };
                let off = differ_by(&dense, &found);
                prop_assert!(off <= tolerance + ROUNDING, "{what}: {off:e}");
                // A normalisation must not restore weights that vanish in f32.
                let weight = |d2: f64| f64::from(scheme.weight(beta, d2 as f32).unwrap());
                let exact = naive::moments(source, target, weight, normalization);
                let off = differ_by(&exact, &found);
                // Sinkhorn-Knopp amplifies weights that f32 represents badly, close to vanishing:
                // there the dense pass has the same error.
                let dense_off = differ_by(&exact, &dense);
                let hard = matches!(normalization, Normalization::Sinkhorn(_));
                prop_assert!(hard || dense_off <= ROUNDING, "{what}, dense: {dense_off:e}");
                let allowed = tolerance + dense_off + ROUNDING;
                prop_assert!(off <= allowed, "{what}, exact: {off:e}, dense {dense_off:e}");
                if normalization == Normalization::None {
                    let left_out = exact.weight - found.weight;
                    prop_assert!(left_out >= -ROUNDING * exact.weight, "{what}: {left_out:e}");
                }
            }
        }
    }

    /// The rows are in another order; sorted sums keep a bound that each of them keeps.
    #[test]
    fn sums_keep_the_promise_row_by_row(
        shape in shape(), beta in beta(), share in tolerance(), factors in any::<bool>(),
    ) {
        let connection = connect(&shape.sides());
        let axes = PrincipalAxes::compute(&connection.source.rows, &connection.target.rows);
        let rows = BoundedSide::new(&connection.source, &axes);
        let columns = BoundedSide::new(&connection.target, &axes);
        let kernel = Gaussian { beta: beta as f32 };
        let pass = PrunedPass { rows: &rows, columns: &columns, kernel: &kernel };
        let v: Vec<f32> = (0..shape.sizes[1]).map(|j| 1.0 / (1 + j % 7) as f32).collect();
        let scaling = if factors { Scaling::Target(&v) } else { Scaling::None };
        let (sums, _) = pass.sums(scaling, share);
        let (whole, _) = pass.sums(scaling, 0.0);
        for (sum, whole) in sums.iter().zip(&whole) {
            let least = (1.0 - share - ROUNDING) * whole;
            prop_assert!((least..=(1.0 + ROUNDING) * whole).contains(sum), "{sum:e} of {whole:e}");
        }
        if !factors {
            let mut dense = connection.source_sums(&kernel);
            let mut whole = whole;
            dense.sort_by(f64::total_cmp);
            whole.sort_by(f64::total_cmp);
            for (a, b) in dense.iter().zip(&whole) {
                prop_assert!((a - b).abs() <= ROUNDING * a, "{a:e} {b:e}");
            }
        }
    }

    /// Descriptors far from integers and from their mean, some much larger than the rest: computed
    /// distances have rounding errors, and the bound must be below them.
    #[test]
    fn no_computed_distance_is_below_its_bound(
        shape in shape(), offset in select(vec![0.0, 1e3, 1e6f32]), stretch in 0.1..20.0f32,
    ) {
        let sides = shape.sides().map(|side| {
            let rows = side.descriptors.rows().enumerate();
            let bent = |(i, row): (usize, &[f32])| -> Vec<f32> {
                let factor = stretch * if i % 50 == 0 { 30.1 } else { 1.1 };
                row.iter().map(|x| offset + factor * x.sin() + x / 3.0).collect()
            };
            let values: Vec<f32> = rows.flat_map(bent).collect();
            RandomSide { descriptors: Descriptors::new(shape.dim, values).unwrap(), ..side }
        });
        let connection = connect(&sides);
        let axes = PrincipalAxes::compute(&connection.source.rows, &connection.target.rows);
        let rows = BoundedSide::new(&connection.source, &axes);
        let columns = BoundedSide::new(&connection.target, &axes);
        let every: Vec<u32> = (0..shape.sizes[1].div_ceil(GROUP) as u32).collect();
        let (mut gathered, mut bounds, mut tile) = (GatheredTile::default(), Vec::new(), Vec::new());
        for block in 0..shape.sizes[0].div_ceil(BLOCK) {
            columns.distance_bounds(&rows, block, &mut bounds);
            let mut above = Above { bounds: &bounds, first: 0, all: true };
            for groups in every.chunks(MAX_GROUPS_PER_TILE) {
                gathered.gather_descriptors(&columns, groups, Scaling::None);
                let range = block * BLOCK..((block + 1) * BLOCK).min(shape.sizes[0]);
                let distance = |d2: f32| d2;
                let panels = &gathered.panels;
                above.first = groups[0] as usize * GROUP;
                weigh_block(&rows.rows, range, panels, &distance, Scaling::None, &mut above, &mut tile);
            }
            prop_assert!(above.all);
        }
    }

    #[test]
    fn moments_do_not_depend_on_the_number_of_threads(
        shape in shape(), beta in beta(), tolerance in tolerance(),
    ) {
        let connection = connect(&shape.sides());
        let bits = |threads| {
            let all = NORMALIZATIONS.map(|normalization| {
                par::with_threads(threads, || {
                    connection.pruned_moments_with_count(WeightScheme::Gaussian, beta, normalization, tolerance)
                })
            });
            format!("{all:?}")
        };
        let one = bits(1);
        for threads in [2, 3] {
            prop_assert_eq!(&one, &bits(threads), "{} threads", threads);
        }
    }
}

/// Returns whether all distances are at least their bounds.
struct Above<'a> {
    bounds: &'a [f32],
    first: usize,
    all: bool,
}

impl Reducer for Above<'_> {
    #[inline(always)]
    fn row(&mut self, _row: usize, first: usize, distances: &[f32]) {
        let bounds = &self.bounds[self.first + first..];
        self.all &= distances.iter().zip(bounds).all(|(distance, bound)| distance >= bound);
    }
}

#[test]
fn what_lies_apart_is_left_out() {
    let shape = Shape { sizes: [2000, 3000], dim: 33, clusters: 4, apart: 100, spread: 1, seed: 3 };
    let connection = connect(&shape.sides());
    for (normalization, passes) in NORMALIZATIONS.into_iter().zip([1, 2, 2, 3, 7]) {
        for tolerance in [1e-9, 1e-3] {
            let (_, weighed) = connection
                .pruned_moments_with_count(WeightScheme::Gaussian, 30.5, normalization, tolerance)
                .unwrap();
            let share = weighed as f64 / (passes * connection.pairs()) as f64;
            // One pair in eight is of one cluster; blocks may be in two.
            assert!(share < 0.25, "{normalization} {tolerance:e}: {share}");
        }
    }
}

#[test]
fn more_is_left_out_for_more_tolerance() {
    let shape = Shape { sizes: [3000, 3000], dim: 3, clusters: 1, apart: 0, spread: 100, seed: 3 };
    let connection = connect(&shape.sides());
    let weighed = [1e-9, 1e-6, 1e-3, 1e-1].map(|tolerance| {
        let scheme = WeightScheme::Gaussian;
        connection
            .pruned_moments_with_count(scheme, 500.5, Normalization::None, tolerance)
            .unwrap()
            .1
    });
    assert!(weighed.is_sorted_by(|a, b| a > b) && weighed[0] < connection.pairs(), "{weighed:?}");
}

#[test]
fn nothing_is_left_out_for_no_tolerance_or_of_few_connections() {
    let shape = Shape { sizes: [100, 90], dim: 33, clusters: 5, apart: 10, spread: 1, seed: 3 };
    let connection = connect(&shape.sides());
    for normalization in NORMALIZATIONS {
        let moments = |tolerance| {
            connection.pruned_moments(WeightScheme::Gaussian, 30.5, normalization, tolerance)
        };
        let dense = connection.scheme_moments(WeightScheme::Gaussian, 30.5, normalization).unwrap();
        for tolerance in [0.0, 0.5] {
            assert_eq!(moments(tolerance).unwrap(), dense);
        }
        for tolerance in [-1e-3, 1.0, f64::NAN, f64::INFINITY] {
            let refused = moments(tolerance);
            assert!(matches!(refused, Err(Error::Config { field: "tolerance", .. })));
        }
    }
}
