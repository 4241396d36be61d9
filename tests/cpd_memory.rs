//! Coherent Point Drift never holds an N × M matrix: its memory grows with N + M.
//!
//! A file of its own, for the peak of a process is that of all its tests.

use cfreg::cloud::shape::boulder;
use cfreg::method::{Cpd, Register};

/// Most bytes a point: some dozens for moved points, embeddings and search trees, and what
/// the allocator keeps. The smaller of the matrices below would take 40 000 a point.
const MOST_GROWTH: usize = 256;

/// Peak resident bytes of this process, `None` where the system does not tell.
fn peak() -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<usize>().ok().map(|kilobytes| kilobytes << 10)
}

#[test]
fn it_grows_with_n_plus_m() {
    let Some(_) = peak() else {
        eprintln!("skipped: no /proc/self/status");
        return;
    };
    // By tiles at the wide σ of all pairs, by search at a narrow one.
    for (points, sigma, iterations) in [(20_000, None, 1), (50_000, Some(0.02), 2)] {
        let [source, target] = [1, 2].map(|seed| boulder().sample(points, seed).unwrap());
        let before = peak().unwrap();
        // Tiles in work are as many as threads.
        let cpd = Cpd { sigma, max_iterations: iterations, threads: 2, ..Cpd::default() };
        let found = cpd.register(&source, &target).unwrap();
        let growth = peak().unwrap() - before;
        println!("{points} points: {} connections, {} kB more", found.connections, growth >> 10);
        assert_eq!(found.iterations, iterations);
        let most = MOST_GROWTH * (source.len() + target.len());
        assert!(growth < most, "{points} points: {growth} bytes, {most} allowed");
    }
}
