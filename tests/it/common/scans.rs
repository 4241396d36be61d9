//! Real pairs with a known pose, moved apart at random.

use std::path::Path;

use cfreg::benchmark::list;
use cfreg::math::Vec3;
use cfreg::{PointCloud, Transform, filter, io};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A pair of real scans: the source has been moved, the truth undoes it.
pub struct RealPair {
    pub name: String,
    pub source: PointCloud,
    pub target: PointCloud,
    /// Source into target frame.
    pub truth: Transform,
    /// Share of source points that the target shows too.
    pub overlap: f64,
}

/// Every `step`-th pair of each data set in `pairs.csv`, both clouds thinned to `points`
/// drawn at random, the source moved by a random rotation and shift.
pub fn real_pairs(folder: &Path, step: usize, points: usize) -> Vec<RealPair> {
    let listed = list::read(&folder.join("pairs.csv"), folder).unwrap();
    let (mut set, mut within) = (String::new(), 0);
    let mut pairs = Vec::new();
    for (row, pair) in listed.into_iter().enumerate() {
        if pair.dataset != set {
            (set, within) = (pair.dataset, 0);
        }
        within += 1;
        if (within - 1) % step != 0 {
            continue;
        }
        let read = |file: &Path, seed| filter::sample(&io::read(file).unwrap(), points, seed);
        let (source, target) =
            (read(&pair.source, 2 * row as u64), read(&pair.target, 2 * row as u64 + 1));
        let motion = random_motion(row as u64, source.diagonal());
        let name = |file: &Path| file.strip_prefix(folder).unwrap().display().to_string();
        pairs.push(RealPair {
            name: format!("{} -> {}", name(&pair.source), name(&pair.target)),
            source: source.transformed(&motion).unwrap(),
            target,
            truth: pair.truth.unwrap().after(&motion.inverse()),
            overlap: pair.overlap.unwrap(),
        });
    }
    pairs
}

/// Any rotation, and a shift of up to `size` along each axis.
fn random_motion(seed: u64, size: f64) -> Transform {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = || 2.0 * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64 - 1.0;
    // Directions by rejection from the cube; then any angle.
    let axis: Vec3 = loop {
        let axis = [(); 3].map(|()| uniform());
        let length = cfreg::math::norm(axis);
        if (0.1..=1.0).contains(&length) {
            break cfreg::math::normalized(axis);
        }
    };
    let angle = std::f64::consts::PI * uniform();
    let translation = [(); 3].map(|()| size * uniform());
    Transform { translation, ..Transform::from_rotation_vector(cfreg::math::scaled(axis, angle)) }
}
