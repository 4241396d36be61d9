//! Passes over all pairs of two sides, tile by tile.

use super::reduce::{MomentSums, RowMinima, RowSums, Targets};
use super::side::ConnectionSide;
use super::sums::Moments;
use super::tile::{SOURCES, Scaling, weigh_block};
use crate::par;
use crate::weight::WeightKernel;

/// Weights all pairs; the weights of their points become part of the factors.
pub(super) fn weigh<K: WeightKernel>(
    source: &ConnectionSide,
    target: &ConnectionSide,
    kernel: &K,
    scaling: Scaling<'_>,
) -> Moments {
    if source.weights.is_none() && target.weights.is_none() {
        return weigh_pairs(source, target, kernel, scaling);
    }
    let shares = |side: &ConnectionSide| match &side.weights {
        Some(weights) => weights.shares.clone(),
        None => vec![1.0; side.rows.len()],
    };
    let with = |factors: &[f32], mut shares: Vec<f32>| {
        shares.iter_mut().zip(factors).for_each(|(share, factor)| *share *= factor);
        shares
    };
    let (mut u, mut v) = (shares(source), shares(target));
    match scaling {
        Scaling::None => {}
        Scaling::Source(factors) => u = with(factors, u),
        Scaling::Target(factors) => v = with(factors, v),
        Scaling::Product(rows, columns) | Scaling::Dual(rows, columns) => {
            (u, v) = (with(rows, u), with(columns, v));
        }
    }
    let scaling = match scaling {
        Scaling::Dual(..) => Scaling::Dual(&u, &v),
        _ => Scaling::Product(&u, &v),
    };
    let scale = |side: &ConnectionSide| side.weights.as_ref().map_or(1.0, |weights| weights.scale);
    weigh_pairs(source, target, kernel, scaling).scaled(scale(source) * scale(target))
}

fn weigh_pairs<K: WeightKernel>(
    source: &ConnectionSide,
    target: &ConnectionSide,
    kernel: &K,
    scaling: Scaling<'_>,
) -> Moments {
    let (rows, panels) = (&source.rows, &target.panels);
    let targets = Targets::new(&target.points);
    let start = Moments::about(source.origin, target.origin);
    let blocks = par::map_blocks(rows.len(), SOURCES, Vec::new, |tile, block| {
        let sums = vec![[0.0; 6]; block.len()];
        let mut reducer = MomentSums { targets: &targets, sums };
        weigh_block(rows, block.clone(), panels, kernel, scaling, &mut reducer, tile);
        reducer.fold(&source.points[block], start)
    });
    blocks.iter().fold(start, |mut sum, block| {
        sum.merge(block);
        sum
    })
}

/// Sums the weights of every point of `from` against all points of `onto`.
pub(super) fn row_sums<K: WeightKernel>(
    from: &ConnectionSide,
    onto: &ConnectionSide,
    kernel: &K,
    scaling: Scaling<'_>,
) -> Vec<f64> {
    let blocks = par::map_blocks(from.rows.len(), SOURCES, Vec::new, |tile, block| {
        let mut reducer = RowSums { sums: vec![0.0; block.len()] };
        weigh_block(&from.rows, block, &onto.panels, kernel, scaling, &mut reducer, tile);
        reducer.sums
    });
    blocks.concat()
}

/// Finds for every point of `from` the most similar point of `onto`: squared distance and index.
pub(super) fn nearest_descriptors(from: &ConnectionSide, onto: &ConnectionSide) -> Vec<(f32, u32)> {
    let blocks = par::map_blocks(from.rows.len(), SOURCES, Vec::new, |tile, block| {
        let mut reducer = RowMinima { found: vec![(f32::INFINITY, 0); block.len()] };
        let distance = |d2: f32| d2;
        weigh_block(&from.rows, block, &onto.panels, &distance, Scaling::None, &mut reducer, tile);
        reducer.found
    });
    blocks.concat()
}

/// Returns `numerator / sum`, and 0 where a sum has underflowed: that point connects to nothing. A
/// NaN sum stays NaN, so that a bad kernel is reported and not hidden.
pub(super) fn inverse_factors(sums: &[f64], numerator: f64) -> Vec<f32> {
    let invert = |&sum: &f64| {
        if sum < f64::from(f32::MIN_POSITIVE) { 0.0 } else { (numerator / sum) as f32 }
    };
    sums.iter().map(invert).collect()
}
