//! Moments within a stated tolerance: connections whose weights provably do not matter are left
//! out.
//!
//! # Error bound
//! With w the normalised weights of all N·M connections as the dense pass computes them, and w̃ the
//! weights of the result (0 where left out): Σ|w̃ − w| ≤ ε Σw. Hence the error of every moment Σw f
//! is at most ε Σw max|f|: of the weight ε Σw, of Σw p̃ ε Σw max|p̃|, of the cross moment ε Σw
//! max|p̃| max|q̃|, and so on. Rounding is not included, nor is the rounding of the dense pass.
//!
//! # Proof
//! Kernels of the catalogue never grow with d², so a lower bound of the distance of a target from a
//! block of sources ([`BoundedSide::distance_bounds`]) bounds all its weights in that block. In
//! each block the targets of the largest bounds are weighted first, then further targets until the
//! bounds of the rest sum to at most a share of the weight so far, which is at most that share of
//! the total weight ([`PruningBudget`]). The bounds of blocks add up.
//!
//! Row and column sums keep the bound row by row: a sum r̃ of the computed weights has (1 − η) r ≤
//! r̃ ≤ r. Factors computed from them have an error factor of at most κ = (1 − η)⁻ᵖ, p = 1 for
//! `source` and `target`, 2 for `both`. A half-round of Sinkhorn-Knopp passes on the relative error
//! of its input factors and adds one (1 − η): after n rounds either factor is within (1 − η)^±n, so
//! p = 2n. With η such that κ = 1 + ε/4, and ε/2 for the last pass, Σ|w̃ − w| ≤ (κ − 1) Σw + ε/2 ·
//! κ Σw ≤ (1/4 + 5/8) ε Σw.

mod bounded_side;
mod budget;
mod gathered_tile;
#[cfg(test)]
mod tests;

use std::ops::Range;

use super::dense::inverse_factors;
use super::reduce::{MomentSums, RowSums};
use super::side::ConnectionSide;
use super::sums::Moments;
use super::tile::{Reducer, Scaling, weigh_block};
use crate::par;
use crate::weight::{Normalization, WeightKernel};
use bounded_side::{BLOCK, BoundedSide, PrincipalAxes};
use budget::PruningBudget;
use gathered_tile::{GatheredTile, MAX_GROUPS_PER_TILE};

/// Minimum number of connections for pruning; with fewer, the dense pass is as fast. It depends on
/// the product of the sizes alone.
pub(super) const MIN_CONNECTIONS: u64 = 50_000_000;

/// Each block weights this part of the columns (one in so many) before it decides about the rest.
/// Chosen by hand.
const FIRST_FRACTION: usize = 16;

/// Covers f32 rounding between a bound and the weights under it: kernels increase by 1e-6 of their
/// value in places, factors and sums round.
const ROUNDING_FACTOR: f32 = 1.0 + 1.6e-5;

/// Computes moments within `tolerance` in (0, 1), and counts the computed weights, including the
/// weights for sums of rows and columns. `kernel` must never grow with d².
pub(super) fn moments<K: WeightKernel>(
    source: &ConnectionSide,
    target: &ConnectionSide,
    kernel: &K,
    normalization: Normalization,
    tolerance: f64,
) -> (Moments, u64) {
    let axes = PrincipalAxes::compute(&source.rows, &target.rows);
    let compact = |side| BoundedSide::new(side, &axes);
    let (rows, columns) = (compact(source), compact(target));
    let (there, back) = (
        PrunedPass { rows: &rows, columns: &columns, kernel },
        PrunedPass { rows: &columns, columns: &rows, kernel },
    );
    let start = Moments::about(source.origin, target.origin);
    let mut weighed = 0;
    let mut sums = |pass: &PrunedPass<'_, K>, scaling: Scaling<'_>, powers| {
        let (sums, count) = pass.sums(scaling, row_share(tolerance, powers));
        weighed += count;
        sums
    };
    let last = tolerance / 2.0;
    let (moments, count) = match normalization {
        Normalization::None => there.moments(Scaling::None, tolerance, start),
        Normalization::Source => {
            let u = inverse_factors(&sums(&there, Scaling::None, 1), 1.0);
            there.moments(Scaling::Source(&u), last, start)
        }
        Normalization::Target => {
            let v = inverse_factors(&sums(&back, Scaling::None, 1), 1.0);
            there.moments(Scaling::Target(&v), last, start)
        }
        Normalization::Both => {
            let u = inverse_factors(&sums(&there, Scaling::None, 2), 1.0);
            let v = inverse_factors(&sums(&back, Scaling::None, 2), 1.0);
            there.moments(Scaling::Dual(&u, &v), last, start)
        }
        Normalization::Sinkhorn(rounds) => {
            let (n, m) = (rows.rows.len() as f64, columns.rows.len() as f64);
            let (mut u, mut v) = (Vec::new(), vec![1.0f32; columns.rows.len()]);
            for _ in 0..rounds {
                u = inverse_factors(&sums(&there, Scaling::Target(&v), 2 * rounds), 1.0 / n);
                v = inverse_factors(&sums(&back, Scaling::Target(&u), 2 * rounds), 1.0 / m);
            }
            there.moments(Scaling::Product(&u, &v), last, start)
        }
    };
    (moments, weighed + count)
}

/// Returns η with (1 − η)^−`powers` = 1 + `tolerance`/4.
fn row_share(tolerance: f64, powers: u32) -> f64 {
    -(-(tolerance / 4.0).ln_1p() / f64::from(powers)).exp_m1()
}

/// A pass of every row of one side against the columns that matter to it.
struct PrunedPass<'a, K> {
    rows: &'a BoundedSide,
    columns: &'a BoundedSide,
    kernel: &'a K,
}

impl<K: WeightKernel> PrunedPass<'_, K> {
    /// Computes moments with all but `share` of the weight of every block.
    fn moments(&self, scaling: Scaling<'_>, share: f64, start: Moments) -> (Moments, u64) {
        let rows = &self.rows.rows;
        let blocks =
            par::map_blocks(rows.len(), BLOCK, PrunedScratch::default, |scratch, block| {
                let PrunedScratch { budget, gathered, tile } = scratch;
                let mut sums = vec![[0.0; 6]; block.len()];
                budget.bound_weights(
                    self.kernel,
                    self.rows,
                    block.start / BLOCK,
                    self.columns,
                    scaling,
                );
                let factors = scaling.rows(block.clone());
                let weighed = budget.weigh_within_share(share, |groups| {
                    for groups in groups.chunks(MAX_GROUPS_PER_TILE) {
                        gathered.gather_descriptors(self.columns, groups, scaling);
                        gathered.gather_positions(self.columns, groups);
                        let mut reducer = MomentSums {
                            targets: &gathered.targets,
                            sums: std::mem::take(&mut sums),
                        };
                        self.weigh(block.clone(), gathered, scaling, &mut reducer, tile);
                        sums = reducer.sums;
                    }
                    sums.iter().map(|sums| sums[0]).sum::<f64>() / factors
                });
                let targets = &gathered.targets;
                let moments =
                    MomentSums { targets, sums }.fold(&self.rows.points[block.clone()], start);
                (moments, weighed * block.len() as u64)
            });
        blocks.iter().fold((start, 0), |(mut sum, all), (block, weighed)| {
            sum.merge(block);
            (sum, all + weighed)
        })
    }

    /// Computes Σ_j w_ij of every row, too low by at most `share` of it.
    fn sums(&self, scaling: Scaling<'_>, share: f64) -> (Vec<f64>, u64) {
        let rows = &self.rows.rows;
        let blocks =
            par::map_blocks(rows.len(), BLOCK, PrunedScratch::default, |scratch, block| {
                let PrunedScratch { budget, gathered, tile } = scratch;
                let mut reducer = RowSums { sums: vec![0.0; block.len()] };
                budget.bound_weights(
                    self.kernel,
                    self.rows,
                    block.start / BLOCK,
                    self.columns,
                    scaling,
                );
                let weighed = budget.weigh_within_share(share, |groups| {
                    for groups in groups.chunks(MAX_GROUPS_PER_TILE) {
                        gathered.gather_descriptors(self.columns, groups, scaling);
                        self.weigh(block.clone(), gathered, scaling, &mut reducer, tile);
                    }
                    let least = reducer.sums.iter().fold(f64::INFINITY, |a, &b| a.min(b));
                    // Computed in full: a bound must not decide whether a row counts as one without
                    // weight.
                    if least < 2.0 * f64::from(f32::MIN_POSITIVE) { 0.0 } else { least }
                });
                (reducer.sums, weighed * block.len() as u64)
            });
        let weighed = blocks.iter().map(|(_, weighed)| weighed).sum();
        (blocks.into_iter().flat_map(|(sums, _)| sums).collect(), weighed)
    }

    /// Weights the rows of a block against the gathered columns.
    fn weigh(
        &self,
        block: Range<usize>,
        gathered: &GatheredTile,
        scaling: Scaling<'_>,
        reducer: &mut impl Reducer,
        tile: &mut Vec<f32>,
    ) {
        let scaling = gathered.scaling(scaling);
        weigh_block(&self.rows.rows, block, &gathered.panels, self.kernel, scaling, reducer, tile);
    }
}

impl Scaling<'_> {
    /// Returns the sum of the factors of a block's rows.
    fn rows(&self, block: Range<usize>) -> f64 {
        match self {
            Scaling::None | Scaling::Target(_) => block.len() as f64,
            Scaling::Source(u) | Scaling::Product(u, _) | Scaling::Dual(u, _) => {
                u[block].iter().map(|&u| f64::from(u)).sum()
            }
        }
    }

    /// Returns the factors of the columns.
    fn columns(&self) -> Option<&[f32]> {
        match self {
            Scaling::None | Scaling::Source(_) => None,
            Scaling::Target(v) | Scaling::Product(_, v) | Scaling::Dual(_, v) => Some(v),
        }
    }
}

/// Scratch that a thread reuses.
#[derive(Default)]
struct PrunedScratch {
    budget: PruningBudget,
    gathered: GatheredTile,
    tile: Vec<f32>,
}
