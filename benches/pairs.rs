//! How many pairs of small clouds a second, end to end: 500 points each, described, connected,
//! solved and judged?
//!
//! Pairs are spread over the threads, each runs on one; read elements (pairs) per second. Before
//! them the pages of memory that a pair asks of the system once all are warm: near 0, since what
//! one pair gives back serves the next.

use cfreg::cloud::shape::boulder;
use cfreg::method::{Cf, Register};
use cfreg::{PointCloud, par};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};

const POINTS: usize = 500;
const PAIRS: usize = 100;

/// Pages of memory that the system has given this process so far (minor page faults: the tenth
/// field of Linux' `/proc/self/stat`); `None` on other systems.
fn pages_asked() -> Option<u64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let after_name = stat.rsplit_once(')')?.1;
    after_name.split_whitespace().nth(7)?.parse().ok()
}

fn bench(criterion: &mut Criterion) {
    let clouds: Vec<PointCloud> =
        (0..20).map(|seed| boulder().sample(POINTS, seed).unwrap()).collect();
    let pair = |i: usize| (&clouds[i % 20], &clouds[(7 * i + 1) % 20]);
    let all = || {
        let register = |_: &mut (), i| {
            let (source, target) = pair(i);
            Cf::default().register(source, target).unwrap().transform
        };
        par::map(PAIRS, || (), register)
    };
    // What is measured is the same answer on any number of threads.
    assert_eq!(par::with_threads(1, all).unwrap(), par::with_threads(3, all).unwrap());
    if let Some(before) = pages_asked() {
        par::with_threads(1, all).unwrap();
        let asked = pages_asked().unwrap_or(before) - before;
        println!("pages asked of the system: {:.2} a pair", asked as f64 / PAIRS as f64);
    }
    let mut group = criterion.benchmark_group("pairs");
    group.sample_size(10).throughput(Throughput::Elements(PAIRS as u64));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    for threads in [1, cores] {
        group.bench_function(BenchmarkId::new("threads", threads), |bencher| {
            bencher.iter(|| par::with_threads(threads, all).unwrap());
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
