//! Pose hypotheses with many inliers.
//!
//! Two correspondences are compatible if they are as far apart in the target as in the source. Many
//! wrong pairs are compatible by chance; few wrong pairs are also compatible with the *same*
//! others: the second-order measure of SC²-PCR (Chen et al., CVPR 2022), counted on rows of bits.
//! Every correspondence in turn, strongest first, weights the others by this measure and is solved
//! in closed form, unless a pose found before explains it.

use std::sync::Arc;

use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::method::compatibility_graph::{CompatibilityGraph, set_bits};
use crate::moments::Moments;
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::surface::Surface;

/// Largest difference of the distances of compatible correspondences, in voxel sizes. Chosen by
/// hand.
const MAX_LENGTH_DIFFERENCE: f64 = 1.5;
/// Distance below which two correspondences are not compared, in voxel sizes. Chosen by hand.
const MIN_PAIR_LENGTH: f32 = 2.0;
/// Most correspondences: their graph takes the square of them in bits. Chosen by hand.
pub(super) const MAX_CORRESPONDENCES: usize = 2500;
/// Others that a match is solved with first.
const SEED_NEIGHBORS: usize = 12;
/// Number of seeds that are solved before those explained by their poses are skipped. Chosen by
/// hand.
const SEED_BATCH: usize = 8;
/// Inlier distances of the refinement, step by step, in [`MAX_LENGTH_DIFFERENCE`] voxel sizes.
/// Chosen by hand.
const INLIER_SCHEDULE: [f64; 4] = [2.0, 1.5, 1.0, 1.0];

/// Corresponding points, each about its surface's origin.
pub(super) struct Correspondences {
    pub(super) source: Vec<[f32; 3]>,
    pub(super) target: Vec<[f32; 3]>,
    /// Weight of each correspondence in solves: the weights of its points.
    pub(super) weights: Vec<f64>,
    /// The points of each correspondence, by their number on either surface.
    pub(super) pairs: Vec<(u32, u32)>,
    /// The voxel size of both scans.
    pub(super) voxel_size: f64,
}

/// A correspondence from elsewhere, in the frames of the clouds.
#[derive(Debug, Clone, Copy)]
pub(in crate::method) struct PointPair {
    source: Vec3,
    target: Vec3,
    weight: f64,
}

impl PointPair {
    /// The pairs of points with these indices.
    ///
    /// # Errors
    /// [`Error::Shape`], [`Error::Config`] and [`Error::TooFewPoints`], as
    /// [`Consensus::register_correspondences`](super::Consensus::register_correspondences) says.
    pub(in crate::method) fn from_indices(
        source: &PointCloud,
        target: &PointCloud,
        pairs: &[(u32, u32)],
        scores: Option<&[f32]>,
    ) -> Result<Vec<PointPair>> {
        if let Some(scores) = scores {
            if scores.len() != pairs.len() {
                let what = "scores of the correspondences".into();
                return Err(Error::Shape { what, expected: pairs.len(), found: scores.len() });
            }
            if let Some(bad) = scores.iter().find(|score| !(score.is_finite() && **score >= 0.0)) {
                return Err(Error::config("scores", bad, "must be finite, 0 or more"));
            }
        }
        for (cloud, name, most) in [
            (source, "source", pairs.iter().map(|pair| pair.0).max()),
            (target, "target", pairs.iter().map(|pair| pair.1).max()),
        ] {
            if let Some(index) = most.filter(|&index| index as usize >= cloud.len()) {
                let what = format!("{name} points, of which a correspondence names number {index}");
                return Err(Error::Shape {
                    what,
                    expected: index as usize + 1,
                    found: cloud.len(),
                });
            }
        }
        let point_weight = |cloud: &PointCloud, i: usize| {
            cloud.relative_weights().map_or(1.0, |weights| f64::from(weights[i]))
        };
        let pair = |(k, &(i, j)): (usize, &(u32, u32))| {
            let (i, j) = (i as usize, j as usize);
            let score = scores.map_or(1.0, |scores| f64::from(scores[k]));
            PointPair {
                source: source.position(i),
                target: target.position(j),
                weight: score * point_weight(source, i) * point_weight(target, j),
            }
        };
        let mut all: Vec<PointPair> = pairs.iter().enumerate().map(pair).collect();
        all.retain(|pair| pair.weight > 0.0);
        if all.len() < 3 {
            let what = "the correspondences".into();
            return Err(Error::TooFewPoints { what, found: all.len(), needed: 3 });
        }
        Ok(all)
    }
}

/// A pose in local frames, and the matches that agree with it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hypothesis {
    pub(super) pose: Transform,
    /// Σ 1 − r²/τ² over the correspondences with a residual r below τ.
    pub(super) inlier_score: f64,
}

impl Correspondences {
    /// Correspondences from elsewhere; those whose points are not on both surfaces, as points that
    /// were excluded, are left out.
    pub(super) fn from_pairs(
        [source, target]: &[Arc<Surface>; 2],
        given: &[PointPair],
        voxel_size: f64,
    ) -> Self {
        let mut found = Correspondences {
            source: Vec::new(),
            target: Vec::new(),
            weights: Vec::new(),
            pairs: Vec::new(),
            voxel_size,
        };
        let mut order: Vec<&PointPair> = given.iter().collect();
        order.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        for pair in order {
            let [p, q] =
                [math::sub(pair.source, source.origin), math::sub(pair.target, target.origin)];
            let (Some(i), Some(j)) = (source.nearest(p), target.nearest(q)) else { continue };
            found.source.push(p.map(|x| x as f32));
            found.target.push(q.map(|x| x as f32));
            found.weights.push(pair.weight);
            found.pairs.push((i.index, j.index));
            if found.pairs.len() == MAX_CORRESPONDENCES {
                break;
            }
        }
        found
    }

    fn len(&self) -> usize {
        self.source.len()
    }

    /// Returns the largest residual of an inlier.
    pub(super) fn inlier_distance(&self) -> f64 {
        MAX_LENGTH_DIFFERENCE * self.voxel_size
    }

    fn compatibility_graph(&self) -> CompatibilityGraph {
        let (near, reach) =
            (MIN_PAIR_LENGTH * self.voxel_size as f32, self.inlier_distance() as f32);
        CompatibilityGraph::new(self.len(), |i, j| {
            let a = math::norm(math::sub(self.source[i], self.source[j]));
            let b = math::norm(math::sub(self.target[i], self.target[j]));
            a > near && b > near && (a - b).abs() < reach
        })
    }

    fn squared_residual(&self, pose: &Transform, k: usize) -> f64 {
        let place = |p: [f32; 3]| p.map(f64::from);
        let off = math::sub(pose.apply(place(self.source[k])), place(self.target[k]));
        math::dot(off, off)
    }

    /// Returns the inlier score of `pose` ([`Hypothesis::inlier_score`]).
    pub(super) fn inlier_score(&self, pose: &Transform) -> f64 {
        self.inlier_weights(pose).sum()
    }

    /// Returns 1 − r²/τ² of each correspondence, or 0 if its residual r is above τ.
    pub(super) fn inlier_weights(&self, pose: &Transform) -> impl Iterator<Item = f64> {
        let square = self.inlier_distance().powi(2);
        (0..self.len()).map(move |k| (1.0 - self.squared_residual(pose, k) / square).max(0.0))
    }

    fn solve(
        &self,
        weighted: impl Iterator<Item = (usize, f64)>,
        prior: &Prior,
    ) -> Option<Transform> {
        let mut moments = Moments::about([0.0; 3], [0.0; 3]);
        let place = |p: [f32; 3]| -> Vec3 { p.map(f64::from) };
        for (k, weight) in weighted {
            let weight = weight * self.weights[k];
            moments.add_pair(weight, place(self.source[k]), place(self.target[k]));
        }
        let solved = pose::solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, prior);
        solved.ok().map(|solution| solution.transform)
    }

    /// Refines a pose on its inliers, within shrinking distances.
    fn refine(&self, mut pose: Transform, prior: &Prior) -> Transform {
        for bound in INLIER_SCHEDULE {
            let square = (bound * self.inlier_distance()).powi(2);
            let near = (0..self.len()).filter_map(|k| {
                let rest = 1.0 - self.squared_residual(&pose, k) / square;
                (rest > 0.0).then_some((k, rest * rest))
            });
            match self.solve(near, prior) {
                Some(next) => pose = next,
                None => break,
            }
        }
        pose
    }

    /// Returns the poses of at most `seeds` correspondences that `prior` allows, highest inlier
    /// score first.
    pub(super) fn generate_hypotheses(&self, seeds: usize, prior: &Prior) -> Vec<Hypothesis> {
        let graph = self.compatibility_graph();
        let common = |i: usize, j: usize| -> usize {
            graph
                .adjacency_row(i)
                .iter()
                .zip(graph.adjacency_row(j))
                .map(|(a, b)| (a & b).count_ones() as usize)
                .sum()
        };
        let strength = par::map(
            self.len(),
            || (),
            |_, i| set_bits(graph.adjacency_row(i)).map(|j| common(i, j)).sum::<usize>(),
        );
        let mut order: Vec<usize> = (0..self.len()).filter(|&i| strength[i] > 0).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse(strength[i]), i));
        let mut explained = vec![false; self.len()];
        let mut found = Vec::new();
        let square = self.inlier_distance().powi(2);
        let solve = |seed: usize| -> Option<Hypothesis> {
            let mut mates: Vec<(usize, usize)> =
                set_bits(graph.adjacency_row(seed)).map(|j| (common(seed, j), j)).collect();
            mates.sort_by_key(|&(common, j)| (std::cmp::Reverse(common), j));
            mates.truncate(SEED_NEIGHBORS);
            let own = mates.first().map_or(1, |&(most, _)| most);
            let weighted = mates.iter().map(|&(common, j)| (j, common as f64));
            let pose = self.refine(self.solve(weighted.chain([(seed, own as f64)]), prior)?, prior);
            Some(Hypothesis { pose, inlier_score: self.inlier_score(&pose) })
        };
        let (mut tried, mut next) = (0, order.into_iter());
        while tried < seeds {
            // Seeds in batches of fixed size: the number of threads changes no bit.
            let some = next.by_ref().filter(|&seed| !explained[seed]);
            let some: Vec<usize> = some.take(SEED_BATCH.min(seeds - tried)).collect();
            if some.is_empty() {
                break;
            }
            tried += some.len();
            let solved = par::map(some.len(), || (), |_, k| solve(some[k]));
            // Any two correspondences have some pose with both as inliers.
            for hypothesis in solved.into_iter().flatten().filter(|found| found.inlier_score >= 2.0)
            {
                for (k, explained) in explained.iter_mut().enumerate() {
                    *explained |= self.squared_residual(&hypothesis.pose, k) < square;
                }
                found.push(hypothesis);
            }
        }
        if found.is_empty() {
            // No two are compatible: their common pose is a candidate all the same, to be verified.
            let all = self.solve((0..self.len()).map(|k| (k, 1.0)), prior);
            found.extend(
                all.map(|pose| Hypothesis { pose, inlier_score: self.inlier_score(&pose) }),
            );
        }
        found.sort_by(|a, b| b.inlier_score.total_cmp(&a.inlier_score));
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Returns `right` correspondences under `pose`, off by up to a third of the voxel size, among
    /// wrong ones.
    fn matches(right: usize, wrong: usize, pose: &Transform) -> Correspondences {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut place = |size: f64| [(); 3].map(|()| size * (2.0 * rng.random::<f64>() - 1.0));
        let (mut source, mut target) = (Vec::new(), Vec::new());
        for k in 0..right + wrong {
            let (from, off, elsewhere) = (place(50.0), place(0.2), place(50.0));
            let onto = if k < right { math::add(pose.apply(from), off) } else { elsewhere };
            source.push(from.map(|x| x as f32));
            target.push(onto.map(|x| x as f32));
        }
        let pairs = (0..source.len() as u32).map(|k| (k, k)).collect();
        Correspondences { weights: vec![1.0; source.len()], source, target, pairs, voxel_size: 1.0 }
    }

    #[test]
    fn a_few_right_matches_among_many_wrong_are_found() {
        let turn = Transform::from_rotation_vector([0.4, 2.0, -1.0]);
        let truth = Transform { translation: [3.0, -8.0, 5.0], ..turn };
        let found = matches(25, 475, &truth).generate_hypotheses(200, &Prior::default());
        let off = truth.after(&found[0].pose.inverse());
        assert!(off.angle().to_degrees() < 0.5, "{}", off.angle().to_degrees());
        // All correct correspondences are inliers, and hardly a wrong one.
        assert!((20.0..29.0).contains(&found[0].inlier_score), "{}", found[0].inlier_score);
        // Other seeds may lead to the same pose; other poses have hardly an inlier.
        let same = |other: &Hypothesis| other.pose.after(&truth.inverse()).angle() < 0.02;
        assert!(found.iter().all(|other| other.inlier_score < 12.0 || same(other)));
    }

    #[test]
    fn few_matches_have_a_pose_that_nothing_supports() {
        let truth = Transform::IDENTITY;
        for few in 0..3 {
            assert!(matches(few, 0, &truth).generate_hypotheses(200, &Prior::default()).is_empty());
        }
        let found = matches(0, 5, &truth).generate_hypotheses(200, &Prior::default());
        assert!(found.len() == 1 && found[0].inlier_score < 2.0, "{found:?}");
    }
}
