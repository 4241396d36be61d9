//! Real pairs with a known pose, moved apart at random.

use std::path::Path;

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
    let table = std::fs::read_to_string(folder.join("pairs.csv")).unwrap();
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|&x| x == name).unwrap();
    let (first, overlap) = (column("t00"), column("overlap"));
    let (mut set, mut within) = (String::new(), 0);
    let mut pairs = Vec::new();
    for (row, line) in lines.enumerate() {
        let fields: Vec<&str> = line.split(',').collect();
        if fields[0] != set {
            (set, within) = (fields[0].to_string(), 0);
        }
        within += 1;
        if (within - 1) % step != 0 {
            continue;
        }
        let entry = |k: usize| fields[first + k].parse().unwrap();
        let matrix = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| entry(4 * i + j)));
        let read =
            |file: &str, seed| filter::sample(&io::read(folder.join(file)).unwrap(), points, seed);
        let (source, target) =
            (read(fields[1], 2 * row as u64), read(fields[2], 2 * row as u64 + 1));
        let motion = random_motion(row as u64, source.diagonal());
        pairs.push(RealPair {
            name: format!("{} -> {}", fields[1], fields[2]),
            source: source.transformed(&motion).unwrap(),
            target,
            truth: Transform::from_matrix(matrix).unwrap().after(&motion.inverse()),
            overlap: fields[overlap].parse().unwrap(),
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
