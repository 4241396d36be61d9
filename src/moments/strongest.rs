//! The strongest connections of a full connection: a sparse one.

use std::cmp::Ordering;

use super::connection::FullConnection;
use super::pairs::WeightedPair;
use super::tile::{Reducer, SOURCES, weigh_block};
use crate::error::{Error, Result};
use crate::par;
use crate::weight::{KernelVisitor, Normalization, WeightKernel, WeightScheme};

/// Weight, source point, target point.
type Candidate = (f32, u32, u32);

/// Heaviest first; equal weights by source, then by target.
fn heavier(a: &Candidate, b: &Candidate) -> Ordering {
    b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2)))
}

/// Keeps the heaviest `count` candidates, in any order.
fn keep_heaviest(candidates: &mut Vec<Candidate>, count: usize) {
    if candidates.len() > count {
        candidates.select_nth_unstable_by(count - 1, heavier);
        candidates.truncate(count);
    }
}

/// The heaviest connections of a block of sources.
struct HeaviestPairs {
    count: usize,
    first_source: u32,
    /// Weight of the lightest candidate that can be among the heaviest.
    floor: f32,
    found: Vec<Candidate>,
}

impl Reducer for HeaviestPairs {
    #[inline(always)]
    fn row(&mut self, row: usize, first: usize, weights: &[f32]) {
        for (at, &weight) in (first as u32..).zip(weights) {
            if weight >= self.floor && weight > 0.0 {
                self.found.push((weight, self.first_source + row as u32, at));
            }
        }
        if self.found.len() >= 2 * self.count {
            keep_heaviest(&mut self.found, self.count);
            self.floor = self.found.iter().fold(f32::INFINITY, |least, pair| least.min(pair.0));
        }
    }
}

impl FullConnection {
    /// Finds the `count` connections with the largest weights by a kernel of the catalogue at
    /// bandwidth `beta`, normalised and multiplied by the weights of their points: heaviest first,
    /// equal weights by source and target point. Fewer, if fewer have a weight above 0.
    ///
    /// One pass over the pairs in addition to those of the normalisation. Memory is `count` for
    /// every 64 points of the source.
    ///
    /// # Errors
    /// [`Error::Config`] for a `count` of 0 and for a `beta` or ν out of range.
    pub fn strongest(
        &self,
        scheme: WeightScheme,
        beta: f64,
        normalization: Normalization,
        count: usize,
    ) -> Result<Vec<WeightedPair>> {
        struct StrongestVisitor<'a>(&'a FullConnection, Normalization, usize);
        impl KernelVisitor for StrongestVisitor<'_> {
            type Output = Vec<WeightedPair>;
            fn visit<K: WeightKernel>(self, kernel: K) -> Vec<WeightedPair> {
                self.0.strongest_by(&kernel, self.1, self.2)
            }
        }
        if count == 0 {
            return Err(Error::config("connections", count, "must be at least 1"));
        }
        scheme.visit(beta, StrongestVisitor(self, normalization, count))
    }

    fn strongest_by<K: WeightKernel>(
        &self,
        kernel: &K,
        normalization: Normalization,
        count: usize,
    ) -> Vec<WeightedPair> {
        let factors = self.factors(kernel, normalization);
        let (rows, panels) = (&self.source.rows, &self.target.panels);
        let blocks = par::map_blocks(rows.len(), SOURCES, Vec::new, |tile, block| {
            let first_source = block.start as u32;
            let mut reducer = HeaviestPairs { count, first_source, floor: 0.0, found: Vec::new() };
            weigh_block(rows, block, panels, kernel, factors.scaling(), &mut reducer, tile);
            keep_heaviest(&mut reducer.found, count);
            reducer.found
        });
        let mut found = blocks.concat();
        keep_heaviest(&mut found, count);
        found.sort_unstable_by(heavier);
        let pair =
            |(weight, source, target)| WeightedPair { source, target, weight: f64::from(weight) };
        found.into_iter().map(pair).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::side::FeatureView;
    use super::*;
    use crate::cloud::Descriptors;

    #[test]
    fn the_strongest_are_the_first_of_all_entries() {
        let table = |n: usize, shift: usize| {
            let row = |k: usize| [((k + shift) * 7 % 31) as f32, ((k + shift) % 13) as f32];
            Descriptors::new(2, (0..n).flat_map(row).collect()).unwrap()
        };
        let (n, m) = (150, 130);
        let tables = [table(n, 0), table(m, 5)];
        let points = [vec![[0.0; 3]; n], vec![[0.0; 3]; m]];
        let side = |k: usize| FeatureView {
            points: &points[k],
            origin: [0.0; 3],
            descriptors: &tables[k],
        };
        let weights: Vec<f32> = (0..m).map(|k| (k % 4) as f32).collect();
        let connection = FullConnection::new(side(0), side(1)).unwrap();
        let connection = connection.with_point_weights(None, Some(&weights)).unwrap();
        let all: [Vec<u32>; 2] = [(0..n as u32).collect(), (0..m as u32).collect()];
        for normalization in [Normalization::None, Normalization::Both] {
            let entries = connection
                .entries(WeightScheme::Gaussian, 9.0, normalization, &all[0], &all[1])
                .unwrap();
            let mut want: Vec<Candidate> = (0..n * m)
                .map(|at| (entries.block[at], (at / m) as u32, (at % m) as u32))
                .filter(|pair| pair.0 > 0.0)
                .collect();
            want.sort_by(heavier);
            for count in [1, 40, 333, n * m] {
                let found = connection
                    .strongest(WeightScheme::Gaussian, 9.0, normalization, count)
                    .unwrap();
                assert_eq!(found.len(), count.min(want.len()));
                // Equal weights may differ by rounding between the two ways: compare the weights.
                for (pair, want) in found.iter().zip(&want) {
                    assert!(
                        (pair.weight - f64::from(want.0)).abs() <= 1e-4 * pair.weight.max(1e-30)
                    );
                    let own = entries.block[pair.source as usize * m + pair.target as usize];
                    assert!((pair.weight - f64::from(own)).abs() <= 1e-4 * pair.weight.max(1e-30));
                }
                assert!(found.windows(2).all(|two| {
                    (two[0].weight, two[1].source, two[1].target)
                        >= (two[1].weight, two[0].source, two[0].target)
                }));
            }
        }
        let none = connection.strongest(WeightScheme::Gaussian, 9.0, Normalization::None, 0);
        assert!(matches!(none, Err(Error::Config { field: "connections", .. })));
    }
}
