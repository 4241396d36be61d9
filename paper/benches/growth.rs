//! How do time and memory of every stage grow with the number of points, and where does a stage
//! stop being practical?
//!
//! Two samples of one surface from 500 points to a million; times on one thread, wall clock, of
//! one run where it is long; memory is the most allocated at a time beyond what went in. A
//! stage stops at the first size where its growth leads to expect more than [`LIMIT`]. Exponents
//! are of the last decade. `cfreg reproduce` has the same of whole methods.

#[path = "../../benches/common/mod.rs"]
mod common;

use std::hint::black_box;
use std::time::{Duration, Instant};

use cfreg::cloud::shape::boulder;
use cfreg::descriptor::{HistogramScale, fpfh};
use cfreg::moments::{FeatureView, FullConnection};
use cfreg::normals::{self, Orientation};
use cfreg::search::{Neighborhood, Neighbors, resolution};
use cfreg::weight::{Normalization, WeightScheme};
use cfreg::{Descriptors, PointCloud, Transform, par, verify};
use cfreg_paper::scaling::Growth;
use peak_alloc::PeakAlloc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

const SIZES: [usize; 8] = [500, 2_000, 5_000, 10_000, 30_000, 100_000, 300_000, 1_000_000];
/// What a run may take.
const LIMIT: Duration = Duration::from_secs(60);
/// Shorter runs are repeated, and the shortest counts.
const SHORT: Duration = Duration::from_millis(200);
const NEAREST: Neighborhood = Neighborhood::Nearest(150);
const BETA: f64 = 100.0;

/// Time, seconds, and memory, bytes, by number of points.
struct Stage {
    name: &'static str,
    times: Vec<[f64; 2]>,
    bytes: Vec<[f64; 2]>,
}

impl Stage {
    fn new(name: &'static str) -> Self {
        Stage { name, times: Vec::new(), bytes: Vec::new() }
    }

    /// Runs `work` at `n` points, unless that would take too long; the first of a size counts.
    fn measure<T>(&mut self, n: usize, work: impl Fn() -> T) -> Option<T> {
        if self.times.last().is_some_and(|last| last[0] == n as f64) {
            return Some(work());
        }
        if let [.., before, last] = self.times[..] {
            let exponent = (last[1] / before[1]).ln() / (last[0] / before[0]).ln();
            let expected = last[1] * (n as f64 / last[0]).powf(exponent);
            if expected > LIMIT.as_secs_f64() {
                return None;
            }
        }
        MEMORY.reset_peak_usage();
        let held = MEMORY.current_usage();
        let start = Instant::now();
        let found = work();
        let first = start.elapsed();
        let bytes = MEMORY.peak_usage().saturating_sub(held);
        let again = if first < SHORT { 5 } else { 0 };
        let time = (0..again)
            .fold(first, |least, _| least.min(common::shortest(1, || _ = black_box(work()))));
        self.times.push([n as f64, time.as_secs_f64()]);
        self.bytes.push([n as f64, bytes as f64]);
        Some(found)
    }

    fn row(&self) -> String {
        let exponent = |pairs: &[[f64; 2]]| {
            Growth::fit(pairs).map_or("".into(), |growth| format!("{:.2}", growth.exponent))
        };
        let at = |n: usize| self.times.iter().find(|pair| pair[0] == n as f64);
        let cell = |&n: &usize| match at(n) {
            Some(&[_, seconds]) => format!("{:.3?}", Duration::from_secs_f64(seconds)),
            None => "-".into(),
        };
        let times: Vec<String> = SIZES.iter().map(cell).collect();
        let [_, most] = self.bytes[self.bytes.len() - 1];
        format!(
            "| {} | {} | N^{} | {:.1} MB | N^{} |",
            self.name,
            times.join(" | "),
            exponent(&self.times),
            most / 1e6,
            exponent(&self.bytes)
        )
    }
}

struct Side {
    cloud: PointCloud,
    descriptors: Descriptors,
}

fn main() {
    let names = ["resolution", "neighbours, k = 150", "normals", "FPFH"];
    let mut features: Vec<Stage> = names.into_iter().map(Stage::new).collect();
    let mut dense = Stage::new("full connection, dense");
    let mut within = Stage::new("full connection within 1e-3");
    let mut look = Stage::new("look at a pose");
    let mut run = || {
        for n in SIZES {
            let [source, target] = [1, 2].map(|seed| described(n, seed, &mut features));
            let [a, b] = [&source, &target].map(|side| FeatureView {
                points: side.cloud.points(),
                origin: side.cloud.origin(),
                descriptors: &side.descriptors,
            });
            let moments = |tolerance| {
                let connection = FullConnection::new(a, b).unwrap();
                let (scheme, plain) = (WeightScheme::Gaussian, Normalization::None);
                connection.pruned_moments(scheme, BETA, plain, tolerance).unwrap()
            };
            dense.measure(n, || moments(0.0));
            within.measure(n, || moments(1e-3));
            look.measure(n, || {
                let distance = verify::default_distance(&source.cloud, &target.cloud, 1.0)?;
                verify::evaluate(&source.cloud, &target.cloud, &Transform::IDENTITY, distance)
            });
            eprintln!("{n} points done");
        }
    };
    par::with_threads(1, &mut run).unwrap();
    let sizes: Vec<String> = SIZES.iter().map(|n| n.to_string()).collect();
    println!("cfreg {}, one thread, {}", env!("CARGO_PKG_VERSION"), processor());
    println!();
    println!("| stage | {} | time | memory at most | memory |", sizes.join(" | "));
    println!("|---|{}---|---|---|", "---|".repeat(SIZES.len()));
    for stage in features.iter().chain([&dense, &within, &look]) {
        println!("{}", stage.row());
    }
}

/// Its name, where the system tells.
fn processor() -> String {
    let facts = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = facts.lines().find_map(|line| line.strip_prefix("model name")?.split(": ").nth(1));
    name.unwrap_or("of an unnamed processor").into()
}

fn described(n: usize, seed: u64, features: &mut [Stage]) -> Side {
    let [resolved, neighboring, oriented, describing] = features else { unreachable!() };
    let cloud = boulder().sample(n, seed).unwrap();
    let points = cloud.points();
    let limit = "no stage of features comes near the limit";
    resolved.measure(n, || resolution(points)).expect(limit).unwrap();
    let neighbors =
        neighboring.measure(n, || Neighbors::find(points, NEAREST).unwrap()).expect(limit);
    let normals = oriented
        .measure(n, || normals::estimate(&cloud, &neighbors, Orientation::Outward).unwrap())
        .expect(limit)
        .vectors;
    let fpfh = || fpfh(points, &normals, &neighbors, HistogramScale::Pcl).unwrap();
    let descriptors = describing.measure(n, fpfh).expect(limit);
    Side { cloud, descriptors }
}
