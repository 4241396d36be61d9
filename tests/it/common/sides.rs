//! Described clouds for the full connection, the same for the same seed.

use cfreg::Descriptors;
use cfreg::moments::FeatureView;
use cfreg::weight::Normalization;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Every normalisation.
pub const NORMALIZATIONS: [Normalization; 5] = [
    Normalization::None,
    Normalization::Source,
    Normalization::Target,
    Normalization::Both,
    Normalization::Sinkhorn(10),
];

/// What [`FeatureView`] borrows.
#[derive(Debug, Clone)]
pub struct RandomCloud {
    pub points: Vec<[f32; 3]>,
    pub origin: [f64; 3],
    pub descriptors: Descriptors,
}

impl RandomCloud {
    /// `n` points within ±1 of (½, −½, ¼), with descriptors of whole numbers within ±3 of
    /// `offset`: all squared distances are whole numbers, so that a bandwidth between two
    /// of them leaves no doubt on which side of it a connection is.
    pub fn random(n: usize, dim: usize, offset: f32, seed: u64) -> RandomCloud {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut point = || [0.5, -0.5, 0.25f32].map(|center| center + rng.random_range(-1.0..1.0));
        let points = (0..n).map(|_| point()).collect();
        let whole = |_| offset + rng.random_range(-3..=3i32) as f32;
        let descriptors = Descriptors::new(dim, (0..n * dim).map(whole).collect()).unwrap();
        RandomCloud { points, origin: [500.0, -20.0, 3.0], descriptors }
    }

    pub fn feature_view(&self) -> FeatureView<'_> {
        let RandomCloud { points, origin, descriptors } = self;
        FeatureView { points, origin: *origin, descriptors }
    }

    /// The points named by `indices`, in that order.
    pub fn select(&self, indices: &[usize]) -> RandomCloud {
        RandomCloud {
            points: indices.iter().map(|&i| self.points[i]).collect(),
            origin: self.origin,
            descriptors: self.descriptors.select(indices),
        }
    }
}

/// A squared bandwidth that goes with [`Side::random`]: half of the connections are
/// nearer, and none is at it.
pub fn bandwidth_for(dim: usize) -> f64 {
    8.0 * dim as f64 + 0.5
}
