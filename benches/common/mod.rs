//! Inputs shared by the benches: made outside the timed part, the same every time.
#![allow(dead_code, reason = "each bench uses its part")]

use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Sizes of the benches that grow with the number of points.
pub const SIZES: [usize; 3] = [500, 5_000, 30_000];

/// A seeded generator.
pub fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

/// Uniform in [0, 1).
pub fn uniform(rng: &mut ChaCha8Rng) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1u32 << 24) as f32
}

/// Shortest of `runs` runs: what the machine can do when nobody disturbs it.
pub fn shortest(runs: usize, mut f: impl FnMut()) -> Duration {
    (0..runs)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed()
        })
        .min()
        .expect("at least one run")
}
