//! Decides which columns a block of rows may leave out.

use pulp::{Simd, WithSimd};

use super::super::tile::Scaling;
use super::bounded_side::{BoundedSide, GROUP};
use super::gathered_tile;
use super::{FIRST_FRACTION, ROUNDING_FACTOR};
use crate::weight::WeightKernel;

/// Number of levels of positive f32 in order, four levels a power of two: their sign bit is 0, and
/// the ten bits after it increase with them.
const LEVELS: usize = 1 << 10;

fn level(bound: f32) -> usize {
    (bound.to_bits() >> 21) as usize
}

/// Upper bounds of the weights of groups of columns in any row of a block, without the row factors.
pub(super) struct PruningBudget {
    /// Bounds of single columns.
    bounds: Vec<f32>,
    /// Bound of every group, the sum over its columns.
    groups: Vec<f32>,
    /// Number and sum of the groups of each level.
    levels: Vec<(usize, f64)>,
    listed: Vec<u32>,
}

impl Default for PruningBudget {
    fn default() -> Self {
        let levels = vec![(0, 0.0); LEVELS];
        PruningBudget { bounds: Vec::new(), groups: Vec::new(), levels, listed: Vec::new() }
    }
}

impl PruningBudget {
    /// Bounds the weights of `columns` in a block of `rows`.
    pub(super) fn bound_weights<K: WeightKernel>(
        &mut self,
        kernel: &K,
        rows: &BoundedSide,
        block: usize,
        columns: &BoundedSide,
        scaling: Scaling<'_>,
    ) {
        let PruningBudget { bounds, groups, levels, .. } = self;
        columns.distance_bounds(rows, block, bounds);
        let factors = scaling.columns();
        let squared = matches!(scaling, Scaling::Dual(..));
        pulp::Arch::new().dispatch(BoundWeights { kernel, bounds, factors, squared });
        groups.clear();
        groups.extend(bounds.chunks(GROUP).map(|group| group.iter().sum::<f32>()));
        levels.fill((0, 0.0));
        for &bound in groups.iter() {
            let (count, sum) = &mut levels[level(bound)];
            *count += 1;
            *sum += f64::from(bound);
        }
    }

    /// Calls `weigh` with the groups of the largest bounds, then with further groups until the
    /// bounds left out sum to at most `share` of the weight that it reports, for a row of factor 1.
    /// Returns how many columns were weighted.
    ///
    /// The weight that `weigh` reports grows with the weighted columns, so the error bound is
    /// valid at the end, too.
    pub(super) fn weigh_within_share(
        &mut self,
        share: f64,
        mut weigh: impl FnMut(&[u32]) -> f64,
    ) -> u64 {
        let enough = self.groups.len().div_ceil(FIRST_FRACTION);
        let (mut first, mut count) = (LEVELS, 0);
        while count < enough {
            first -= 1;
            count += self.levels[first].0;
        }
        let mut columns = self.list(first, LEVELS);
        let allowed = share * weigh(&self.listed);
        let (mut last, mut left_out) = (0, 0.0);
        while last < first && left_out + self.levels[last].1 <= allowed {
            left_out += self.levels[last].1;
            last += 1;
        }
        if last < first {
            columns += self.list(last, first);
            weigh(&self.listed);
        }
        columns as u64
    }

    /// Lists the groups of the levels `from..to` in order; returns the number of their columns.
    fn list(&mut self, from: usize, to: usize) -> usize {
        let groups = self.groups.iter().enumerate();
        let within = groups.filter(|&(_, &bound)| (from..to).contains(&level(bound)));
        self.listed.clear();
        self.listed.extend(within.map(|(group, _)| group as u32));
        let columns = |&group: &u32| gathered_tile::columns(group, self.bounds.len()).len();
        self.listed.iter().map(columns).sum()
    }
}

struct BoundWeights<'a, K> {
    kernel: &'a K,
    bounds: &'a mut [f32],
    factors: Option<&'a [f32]>,
    squared: bool,
}

impl<K: WeightKernel> WithSimd for BoundWeights<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let BoundWeights { kernel, bounds, factors, squared } = self;
        kernel.fill(bounds);
        match factors {
            None => bounds.iter_mut().for_each(|w| *w *= ROUNDING_FACTOR),
            Some(factors) if squared => {
                bounds.iter_mut().zip(factors).for_each(|(w, v)| *w *= (*w * v) * ROUNDING_FACTOR);
            }
            Some(factors) => {
                bounds.iter_mut().zip(factors).for_each(|(w, v)| *w *= v * ROUNDING_FACTOR)
            }
        }
    }
}
