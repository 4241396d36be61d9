//! How long does the full connection take, beside the bare product of its size?
//!
//! Read the ratio, not the times: both are measured in this run, on one thread, as the
//! shortest of several. `bare product` multiplies the same descriptors tile by tile
//! through faer and throws the result away; it is what a fused pass cannot avoid. `floor` is the
//! time of [`STEPS`] fused multiply-adds a pair at the rate that the machine reaches where
//! nothing is read or waited for: what a pass of perfect code would take. The second table leaves out what does not matter, on FPFH of two samples of one surface.

mod common;

use common::{SIZES, rng, shortest, uniform};
use criterion::{Criterion, Throughput};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::{Simd, WithSimd};
use std::hint::black_box;

use cfreg::cloud::shape::boulder;
use cfreg::method::{FeatureConfig, Timings};
use cfreg::moments::{FeatureView, FullConnection, naive};
use cfreg::pose::{self, ScaleEstimate, Solver};
use cfreg::verify::pose_error;
use cfreg::weight::{Gaussian, Normalization, WeightScheme};
use cfreg::{Descriptors, par};

const DIM: usize = 33;
const BETA: f32 = 100.0;
/// Steps of a pair that only the multiply-add units can take: 33 of the product, 10 of the
/// exponential, 6 of the sums.
const STEPS: f64 = 49.0;

/// Multiply-adds of vectors, as many in flight as the units have room for.
struct Fused(u32);

impl WithSimd for Fused {
    /// How many single ones, and a sum that keeps them from being left out.
    type Output = (f64, f32);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (f64, f32) {
        const CHAINS: usize = 12;
        let (x, y) = black_box((simd.splat_f32s(0.999), simd.splat_f32s(0.002)));
        let mut sums = [simd.splat_f32s(1.0); CHAINS];
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = simd.mul_add_e_f32s(*sum, x, y);
            }
        }
        let sum = sums.into_iter().map(|sum| simd.reduce_sum_f32s(sum)).sum();
        (f64::from(self.0) * (CHAINS * S::F32_LANES) as f64, sum)
    }
}

/// Fused multiply-adds of f32 a second.
fn rate() -> f64 {
    let arch = pulp::Arch::new();
    let fused = || black_box(arch.dispatch(Fused(black_box(5_000_000))));
    let (count, _) = fused();
    count / shortest(5, || _ = fused()).as_secs_f64()
}

struct Cloud {
    points: Vec<[f32; 3]>,
    descriptors: Descriptors,
}

/// Descriptors of which a few are near any other, as FPFH's are.
fn cloud(n: usize, seed: u64) -> Cloud {
    let mut rng = rng(seed);
    let points = (0..n).map(|_| [0; 3].map(|_| uniform(&mut rng))).collect();
    let values = (0..n)
        .flat_map(|_| {
            let (a, b) = (uniform(&mut rng), uniform(&mut rng));
            (0..DIM).map(move |d| 20.0 * (a * d as f32).sin() + 10.0 * (b * 1.7 * d as f32).cos())
        })
        .collect();
    Cloud { points, descriptors: Descriptors::new(DIM, values).unwrap() }
}

impl Cloud {
    fn described(&self) -> FeatureView<'_> {
        FeatureView { points: &self.points, origin: [0.0; 3], descriptors: &self.descriptors }
    }
}

fn bare_product(a: &Descriptors, b: &Descriptors, tile: &mut [f32]) {
    let (rows, columns) = (512, 64);
    for target in b.as_slice().chunks(rows * DIM) {
        for source in a.as_slice().chunks(columns * DIM) {
            let (m, n) = (target.len() / DIM, source.len() / DIM);
            matmul(
                MatMut::from_column_major_slice_mut(&mut tile[..m * n], m, n),
                Accum::Replace,
                MatRef::from_column_major_slice(target, m, DIM),
                MatRef::from_column_major_slice(source, DIM, n),
                1.0f32,
                Par::Seq,
            );
            black_box(&mut *tile);
        }
    }
}

/// The untiled product of the same size, its N×M result written to memory.
fn whole_product(a: &Descriptors, b: &Descriptors, out: &mut [f32]) {
    matmul(
        MatMut::from_column_major_slice_mut(out, b.len(), a.len()),
        Accum::Replace,
        MatRef::from_row_major_slice(b.as_slice(), b.len(), DIM),
        MatRef::from_column_major_slice(a.as_slice(), DIM, a.len()),
        1.0f32,
        Par::Seq,
    );
    black_box(out);
}

fn check() {
    let (source, target) = (cloud(300, 1), cloud(700, 2));
    let (source, target) = (source.described(), target.described());
    let fused = FullConnection::new(source, target).unwrap();
    let fused = fused.moments(&Gaussian { beta: BETA }, Normalization::None).unwrap();
    let weight = |d2: f64| (-d2 / f64::from(BETA)).exp();
    let exact = naive::moments(source, target, weight, Normalization::None);
    let exact = naive::shift_origins(&exact, fused.source_origin, fused.target_origin);
    assert!((fused.weight / exact.weight - 1.0).abs() < 1e-5, "{fused:?} {exact:?}");
}

/// Dense and within tolerances, one thread, one run; what is promised is checked first.
fn skipping(n: usize) {
    let side = |seed| {
        let cloud = boulder().sample(n, seed).unwrap();
        FeatureConfig::default().extract(&cloud, "a sample", &mut Timings::default()).unwrap()
    };
    let (source, target) = (side(1), side(2));
    let connection = FullConnection::new(source.view(), target.view()).unwrap();
    for normalization in [Normalization::None, Normalization::Both] {
        let moments = |tolerance| {
            let (scheme, beta) = (WeightScheme::Gaussian, f64::from(BETA));
            connection.pruned_moments(scheme, beta, normalization, tolerance).unwrap()
        };
        let dense = moments(0.0);
        let pose = |moments| {
            let solution = pose::solve(moments, Solver::Arun, ScaleEstimate::Fixed).unwrap();
            solution.transform
        };
        let turned = pose_error(&pose(&moments(1e-3)), &pose(&dense), [0.0; 3]).rotation_deg;
        let times = [0.0, 1e-3, 1e-6].map(|tolerance| {
            let off = (moments(tolerance).weight / dense.weight - 1.0).abs();
            assert!(off <= tolerance + 1e-6, "{normalization} {tolerance:e}: {off:e}");
            let time = || shortest(3, || _ = black_box(moments(tolerance)));
            par::with_threads(1, time).unwrap()
        });
        let ratio = |k: usize| times[0].as_secs_f64() / times[k].as_secs_f64();
        println!(
            "{n:>7} {:>13} {:>12.3?} {:>12.3?} {:>12.3?} {:>7.2}x {:>7.2}x {:>12.1e}",
            normalization.to_string(),
            times[0],
            times[1],
            times[2],
            ratio(1),
            ratio(2),
            turned
        );
    }
}

fn main() {
    check();
    println!(
        "{:>7} {:>13} {:>12} {:>12} {:>12} {:>8} {:>8} {:>12}",
        "points", "normalisation", "dense", "within 1e-3", "1e-6", "ratio", "ratio", "turned, deg"
    );
    for n in [10_000, 30_000] {
        skipping(n);
    }
    let rate = rate();
    println!("{:.1} Gflop/s in multiply-adds of one thread", 2e-9 * rate);
    println!(
        "{:>7} {:>12} {:>12} {:>12} {:>8} {:>8} {:>8}",
        "points", "fused", "tiled prod.", "whole prod.", "ratio t", "ratio w", "of floor"
    );
    for n in SIZES {
        let (source, target) = (cloud(n, 1), cloud(n, 2));
        let connection = FullConnection::new(source.described(), target.described()).unwrap();
        let runs = if n > 10_000 { 3 } else { 20 };
        let kernel = Gaussian { beta: BETA };
        let fused = par::with_threads(1, || {
            shortest(runs, || {
                black_box(connection.moments(&kernel, Normalization::None).unwrap());
            })
        })
        .unwrap();
        let mut tile = vec![0.0; 512 * 64];
        let product =
            shortest(runs, || bare_product(&source.descriptors, &target.descriptors, &mut tile));
        let mut out = vec![0.0; n * n];
        let whole =
            shortest(runs, || whole_product(&source.descriptors, &target.descriptors, &mut out));
        println!(
            "{n:>7} {fused:>12.3?} {product:>12.3?} {whole:>12.3?} {:>7.2}x {:>7.2}x {:>7.0}%",
            fused.as_secs_f64() / product.as_secs_f64(),
            fused.as_secs_f64() / whole.as_secs_f64(),
            100.0 * STEPS * connection.pairs() as f64 / rate / fused.as_secs_f64()
        );
    }

    let mut criterion = Criterion::default().configure_from_args().sample_size(10);
    let mut group = criterion.benchmark_group("moments/dense");
    for n in SIZES {
        let (source, target) = (cloud(n, 1), cloud(n, 2));
        let connection = FullConnection::new(source.described(), target.described()).unwrap();
        group.throughput(Throughput::Elements(connection.pairs()));
        group.bench_function(n.to_string(), |bencher| {
            bencher.iter(|| connection.moments(&Gaussian { beta: BETA }, Normalization::None));
        });
    }
    group.finish();
    criterion.final_summary();
}
