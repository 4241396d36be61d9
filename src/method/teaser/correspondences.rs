//! Correspondences, and their differences, which no translation changes.

use crate::math::{self, Vec3};
use crate::moments::{FullConnection, Moments};

/// Putative correspondences: `source[k]` to `target[k]`, each about its own origin.
#[derive(Debug, Clone)]
pub(super) struct CenteredCorrespondences {
    source_origin: Vec3,
    target_origin: Vec3,
    pub(super) source: Vec<Vec3>,
    pub(super) target: Vec<Vec3>,
}

/// Returns mutual nearest neighbours by descriptor, or, without the check, every source point with
/// its nearest target point.
pub(in crate::method) fn match_features(
    connection: &FullConnection,
    cross_check: bool,
) -> Vec<(u32, u32)> {
    if cross_check {
        return connection.mutual_nearest();
    }
    connection.nearest_targets().into_iter().zip(0..).map(|(j, i)| (i, j)).collect()
}

impl CenteredCorrespondences {
    /// Builds them from points relative to `origins`, about the centroids of the points in `pairs`.
    pub(super) fn new(
        pairs: &[(u32, u32)],
        [source, target]: [&[[f32; 3]]; 2],
        [source_origin, target_origin]: [Vec3; 2],
    ) -> Self {
        let about = |points: Vec<Vec3>, origin: Vec3| {
            let sum = points.iter().fold([0.0; 3], |sum, &p| math::add(sum, p));
            let mean = math::scaled(sum, 1.0 / points.len().max(1) as f64);
            let local = points.into_iter().map(|p| math::sub(p, mean)).collect::<Vec<Vec3>>();
            (local, math::add(origin, mean))
        };
        let place = |points: &[[f32; 3]], i: u32| points[i as usize].map(f64::from);
        let (source, source_origin) =
            about(pairs.iter().map(|&(i, _)| place(source, i)).collect(), source_origin);
        let (target, target_origin) =
            about(pairs.iter().map(|&(_, j)| place(target, j)).collect(), target_origin);
        CenteredCorrespondences { source_origin, target_origin, source, target }
    }

    pub(super) fn len(&self) -> usize {
        self.source.len()
    }

    /// Returns the given correspondences, in that order.
    pub(super) fn select(&self, indices: &[usize]) -> CenteredCorrespondences {
        CenteredCorrespondences {
            source: indices.iter().map(|&k| self.source[k]).collect(),
            target: indices.iter().map(|&k| self.target[k]).collect(),
            ..*self
        }
    }

    /// Returns translation-invariant measurements: differences (aₖₗ, bₖₗ) between each
    /// correspondence k and the next ones in a ring, at most `most`; all pairs of correspondences
    /// if there are no more than that.
    pub(super) fn pairwise_differences(&self, most: usize) -> Vec<(Vec3, Vec3)> {
        let n = self.len();
        let between = |k: usize, l: usize| {
            (math::sub(self.source[l], self.source[k]), math::sub(self.target[l], self.target[k]))
        };
        if n * n.saturating_sub(1) / 2 <= most {
            return (0..n)
                .flat_map(|k| (k + 1..n).map(move |l| (k, l)))
                .map(|(k, l)| between(k, l))
                .collect();
        }
        let reach = (most / n).max(1);
        (1..=reach)
            .flat_map(|step| (0..n).map(move |k| (k, (k + step) % n)))
            .map(|(k, l)| between(k, l))
            .collect()
    }

    /// Returns at most `most` differences: of correspondences spread evenly over the list if it has
    /// more.
    pub(super) fn subsampled_differences(&self, most: usize) -> Vec<(Vec3, Vec3)> {
        if self.len() <= most {
            return self.pairwise_differences(most);
        }
        let spread: Vec<usize> = (0..most).map(|i| i * self.len() / most).collect();
        self.select(&spread).pairwise_differences(most)
    }

    /// Returns whether correspondences `k` and `l` are as far apart in the target as in the source,
    /// times `scale`, to within `bound`.
    pub(super) fn are_consistent(&self, k: usize, l: usize, scale: f64, bound: f64) -> bool {
        let a = math::norm(math::sub(self.source[l], self.source[k]));
        let b = math::norm(math::sub(self.target[l], self.target[k]));
        (b - scale * a).abs() <= bound
    }

    /// Returns the origins of the source and of the target points.
    pub(super) fn origins(&self) -> (Vec3, Vec3) {
        (self.source_origin, self.target_origin)
    }

    /// Returns the moments of all correspondences, each with weight 1.
    pub(super) fn moments(&self) -> Moments {
        let mut moments = Moments::about(self.source_origin, self.target_origin);
        self.source.iter().zip(&self.target).for_each(|(&p, &q)| moments.add_pair(1.0, p, q));
        moments
    }
}
