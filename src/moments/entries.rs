//! Entries and sums of the weight matrix W, for inspection.

use super::connection::FullConnection;
use super::dense::{inverse_factors, row_sums};
use super::reduce::RowMaxima;
use super::side::ConnectionSide;
use super::tile::{SOURCES, Scaling, weigh_block};
use crate::error::Result;
use crate::par;
use crate::weight::{KernelVisitor, Normalization, WeightKernel, WeightScheme};

/// Parts of W, the weights of a full connection as used by its moments: normalised, then multiplied
/// by the weights of the points.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Entries {
    /// Σ_j w_ij of every source point.
    pub source_sums: Vec<f64>,
    /// Σ_i w_ij of every target point.
    pub target_sums: Vec<f64>,
    /// The heaviest connection of every source point: the weight, and the target point, the lower
    /// index where two are equal.
    pub heaviest: Vec<(f32, u32)>,
    /// w_ij of the requested source points and target points, row by row.
    pub block: Vec<f32>,
}

/// Factors of the weights, by source point and by target point.
pub(super) struct Factors {
    source: Vec<f32>,
    target: Vec<f32>,
    /// Whether the weight enters squared.
    squares_weight: bool,
}

impl Factors {
    pub(super) fn scaling(&self) -> Scaling<'_> {
        match self.squares_weight {
            true => Scaling::Dual(&self.source, &self.target),
            false => Scaling::Product(&self.source, &self.target),
        }
    }

    /// Returns the scaling with source and target exchanged.
    fn transposed_scaling(&self) -> Scaling<'_> {
        match self.squares_weight {
            true => Scaling::Dual(&self.target, &self.source),
            false => Scaling::Product(&self.target, &self.source),
        }
    }
}

impl FullConnection {
    /// Computes weights by a kernel of the catalogue at bandwidth `beta` for the `rows` of the
    /// source and the `columns` of the target, and the sums over all: four passes over the pairs in
    /// addition to the passes of the normalisation.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) for a `beta` or ν out of range.
    ///
    /// # Panics
    /// For a row or column that is no point of its side.
    pub fn entries(
        &self,
        scheme: WeightScheme,
        beta: f64,
        normalization: Normalization,
        rows: &[u32],
        columns: &[u32],
    ) -> Result<Entries> {
        struct EntriesVisitor<'a>(&'a FullConnection, Normalization, [&'a [u32]; 2]);
        impl KernelVisitor for EntriesVisitor<'_> {
            type Output = Entries;
            fn visit<K: WeightKernel>(self, kernel: K) -> Entries {
                self.0.entries_by(&kernel, self.1, self.2)
            }
        }
        scheme.visit(beta, EntriesVisitor(self, normalization, [rows, columns]))
    }

    fn entries_by<K: WeightKernel>(
        &self,
        kernel: &K,
        normalization: Normalization,
        [rows, columns]: [&[u32]; 2],
    ) -> Entries {
        let factors = self.factors(kernel, normalization);
        let FullConnection { source, target } = self;
        let part = |i: usize, j: usize| {
            let (a, b) = (source.rows.row(i), target.rows.row(j));
            let w = kernel.weight(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum());
            let scaled = (w * factors.source[i]) * factors.target[j];
            if factors.squares_weight { scaled * w } else { scaled }
        };
        let block = rows.iter().flat_map(|&i| {
            let row = columns.iter().map(move |&j| (i as usize, j as usize));
            row.map(|(i, j)| part(i, j)).collect::<Vec<f32>>()
        });
        Entries {
            block: block.collect(),
            source_sums: row_sums(source, target, kernel, factors.scaling()),
            target_sums: row_sums(target, source, kernel, factors.transposed_scaling()),
            heaviest: heaviest_targets(source, target, kernel, factors.scaling()),
        }
    }

    pub(super) fn factors<K: WeightKernel>(
        &self,
        kernel: &K,
        normalization: Normalization,
    ) -> Factors {
        let ones = |side: &ConnectionSide| vec![1.0; side.rows.len()];
        let by_source = || inverse_factors(&self.source_sums(kernel), 1.0);
        let by_target = || inverse_factors(&self.target_sums(kernel), 1.0);
        let (mut source, mut target) = match normalization {
            Normalization::None => (ones(&self.source), ones(&self.target)),
            Normalization::Source => (by_source(), ones(&self.target)),
            Normalization::Target => (ones(&self.source), by_target()),
            Normalization::Both => (by_source(), by_target()),
            Normalization::Sinkhorn(rounds) => self.sinkhorn(kernel, rounds),
        };
        for (factors, side) in [(&mut source, &self.source), (&mut target, &self.target)] {
            let Some(weights) = &side.weights else { continue };
            let own = weights.shares.iter().map(|share| share * weights.scale as f32);
            factors.iter_mut().zip(own).for_each(|(factor, own)| *factor *= own);
        }
        Factors { source, target, squares_weight: normalization == Normalization::Both }
    }
}

/// Finds the heaviest connection of every point of `from`.
fn heaviest_targets<K: WeightKernel>(
    from: &ConnectionSide,
    onto: &ConnectionSide,
    kernel: &K,
    scaling: Scaling<'_>,
) -> Vec<(f32, u32)> {
    let blocks = par::map_blocks(from.rows.len(), SOURCES, Vec::new, |tile, block| {
        let mut reducer = RowMaxima { found: vec![(f32::NEG_INFINITY, 0); block.len()] };
        weigh_block(&from.rows, block, &onto.panels, kernel, scaling, &mut reducer, tile);
        reducer.found
    });
    blocks.concat()
}

#[cfg(test)]
mod tests {
    use super::super::side::FeatureView;
    use super::*;
    use crate::cloud::Descriptors;

    /// Descriptors of few columns, so that both distance computations are plain differences.
    fn sides() -> ([Vec<[f32; 3]>; 2], [Descriptors; 2]) {
        let row = |k: usize| [(k % 7) as f32 * 0.3, (k % 5) as f32 * 0.4];
        let table = |n: usize, first: usize| {
            Descriptors::new(2, (first..first + n).flat_map(row).collect()).unwrap()
        };
        let points = |n: usize| (0..n).map(|k| [k as f32, (k * k % 11) as f32, 1.0]).collect();
        ([points(90), points(70)], [table(90, 0), table(70, 3)])
    }

    #[test]
    fn sums_of_all_entries_are_the_sums_that_are_told() {
        let (points, tables) = sides();
        let side = |k: usize| FeatureView {
            points: &points[k],
            origin: [0.0; 3],
            descriptors: &tables[k],
        };
        let weights: Vec<f32> = (0..90).map(|k| 0.5 + (k % 3) as f32).collect();
        let connection = FullConnection::new(side(0), side(1)).unwrap();
        let connection = connection.with_point_weights(Some(&weights), None).unwrap();
        let all = [(0..90).collect::<Vec<u32>>(), (0..70).collect()];
        for normalization in [
            Normalization::None,
            Normalization::Source,
            Normalization::Target,
            Normalization::Both,
            Normalization::Sinkhorn(2),
        ] {
            let scheme = WeightScheme::Gaussian;
            let found = connection.entries(scheme, 0.5, normalization, &all[0], &all[1]).unwrap();
            let moments = connection.scheme_moments(scheme, 0.5, normalization).unwrap();
            let near = |a: f64, b: f64| assert!((a - b).abs() <= 1e-5 * b, "{a} {b}");
            near(found.source_sums.iter().sum(), moments.weight);
            near(found.target_sums.iter().sum(), moments.weight);
            for (i, row) in found.block.chunks(70).enumerate() {
                near(row.iter().map(|&w| f64::from(w)).sum(), found.source_sums[i]);
                let most = row.iter().copied().fold(0.0, f32::max);
                let (weight, at) = found.heaviest[i];
                near(weight.into(), most.into());
                near(row[at as usize].into(), most.into());
            }
        }
    }
}
