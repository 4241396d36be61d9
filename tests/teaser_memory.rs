//! Ten thousand matches, nearly all wrong, in under 1 GB. A process of its own, for the
//! peak is the process's.
//!
//! `cargo test --release --features cli --test teaser_memory -- --nocapture` prints memory and times.

use cfreg::cloud::shape::boulder;
use cfreg::method::Teaser;
use cfreg::verify::Warning;
use cfreg::{PointCloud, Transform, math};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const MATCHES: usize = 10_000;
/// Of a shape of two units: three in a hundred pairs of wrong matches agree within it.
const BOUND: f64 = 0.01;

#[test]
fn ten_thousand_matches_take_less_than_a_gigabyte() {
    for (share, seed) in [(0.95, 1), (0.99, 2)] {
        let truth = Transform::from_rotation_vector([0.4, 2.0, -1.1]);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let source = boulder().sample(MATCHES, seed).unwrap();
        let off = |rng: &mut ChaCha8Rng| [(); 3].map(|()| rng.random_range(-0.5..0.5) * BOUND);
        let target: Vec<_> =
            source.positions().map(|p| math::add(truth.apply(p), off(&mut rng))).collect();
        let target = PointCloud::new(&target).unwrap();
        let mut ends: Vec<u32> = (0..MATCHES as u32).collect();
        ends[..(share * MATCHES as f64) as usize].shuffle(&mut rng);
        let pairs: Vec<_> = ends.iter().enumerate().map(|(i, &j)| (i as u32, j)).collect();
        let teaser = Teaser { noise_bound: Some(BOUND), ..Teaser::default() };
        let found = teaser.register_correspondences(&source, &target, &pairs).unwrap();
        let turned = math::mat_sub(&found.transform.rotation, &truth.rotation);
        assert!(math::frobenius(&turned) < BOUND, "{turned:?}");
        let unproved = |doubt: &Warning| matches!(doubt, Warning::CliqueNotProved { .. });
        assert!(found.trusted && !found.doubts.iter().any(unproved), "{:?}", found.doubts);
        println!("{share} wrong: {} inliers, {:?}", found.effective_connections, found.time_s);
    }
    match peak() {
        Some(bytes) => {
            println!("peak {} MB", bytes >> 20);
            assert!(bytes < 1 << 30, "{bytes}");
        }
        None => eprintln!("skipped: no peak memory in /proc/self/status"),
    }
}

/// Most memory this process has held, in bytes, where the system tells.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes << 10)
}
