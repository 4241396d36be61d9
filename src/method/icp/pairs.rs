//! Pairs of source and target points: the sparse W of ICP.

use super::Icp;
use crate::error::Result;
use crate::method::position_problem::PositionProblem;
use crate::moments::WeightedPair;
use crate::par;
use crate::search::{Neighbor, SearchTree};
use crate::weight::{KernelVisitor, WeightKernel};

/// Returns the pairs of the moved source, in the order of its points, and the mean of their squared
/// distances (weighted, in the target's unit; NaN without weight).
pub(super) fn find_pairs(
    icp: &Icp,
    positions: &PositionProblem<'_>,
    moved: &[[f32; 3]],
) -> Result<(Vec<WeightedPair>, f64)> {
    let nearest = positions.nearest_targets(moved);
    let limit = icp.max_distance.map_or(f64::INFINITY, |d| d * d);
    let near = |i: &usize| f64::from(nearest[*i].squared_distance) <= limit;
    let mut chosen: Vec<usize> = (0..moved.len()).filter(near).collect();
    if icp.reciprocal {
        chosen = keep_reciprocal(positions, moved, &nearest, chosen)?;
    }
    if icp.trim_ratio < 1.0 {
        let count = (icp.trim_ratio * chosen.len() as f64).ceil() as usize;
        let distance = |i: usize| nearest[i].squared_distance;
        chosen.sort_by(|&i, &j| distance(i).total_cmp(&distance(j)).then(i.cmp(&j)));
        chosen.truncate(count);
        chosen.sort_unstable();
    }
    // Distances in bandwidths: the kernel's own bandwidth is then 1.
    let bandwidth = icp.bandwidth.unwrap_or(1.0);
    let squares: Vec<f64> =
        chosen.iter().map(|&i| f64::from(nearest[i].squared_distance)).collect();
    let scaled: Vec<f32> = squares.iter().map(|d| (d / (bandwidth * bandwidth)) as f32).collect();
    let mut weights = icp.weights.visit(1.0, KernelWeights(&scaled))?;
    for (weight, &i) in weights.iter_mut().zip(&chosen) {
        *weight *= positions.pair_weight(i, nearest[i].index as usize);
    }
    let pair = |(&i, &weight): (&usize, &f64)| WeightedPair {
        source: i as u32,
        target: nearest[i].index,
        weight,
    };
    let pairs = chosen.iter().zip(&weights).map(pair).collect();
    let error = squares.iter().zip(&weights).map(|(d, w)| d * w).sum::<f64>();
    Ok((pairs, error / weights.iter().sum::<f64>()))
}

/// Keeps the pairs of `chosen` whose target point has no nearer source point. Equal distances
/// (duplicates) count as mutual.
fn keep_reciprocal(
    positions: &PositionProblem<'_>,
    moved: &[[f32; 3]],
    nearest: &[Neighbor],
    chosen: Vec<usize>,
) -> Result<Vec<usize>> {
    let tree = SearchTree::new(moved)?;
    let targets = positions.target().points();
    let is_mutual = par::map(
        chosen.len(),
        || (),
        |_, k| {
            let there = nearest[chosen[k]];
            tree.nearest(&targets[there.index as usize]).squared_distance >= there.squared_distance
        },
    );
    Ok(chosen.into_iter().zip(is_mutual).filter(|(_, mutual)| *mutual).map(|(i, _)| i).collect())
}

struct KernelWeights<'a>(&'a [f32]);

impl KernelVisitor for KernelWeights<'_> {
    type Output = Vec<f64>;
    fn visit<K: WeightKernel>(self, kernel: K) -> Vec<f64> {
        self.0.iter().map(|&d2| f64::from(kernel.weight(d2))).collect()
    }
}
