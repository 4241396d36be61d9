//! Non-adjacent groups of columns, gathered into a tile.

use std::ops::Range;

use super::super::reduce::Targets;
use super::super::tile::{Panels, Scaling};
use super::bounded_side::{BoundedSide, GROUP};

/// Maximum number of groups a tile: 480 columns, in whole lanes, and no power of two, which would
/// map all dimensions of a column to the same few lines of the first-level cache.
pub(super) const MAX_GROUPS_PER_TILE: usize = 60;

/// A tile of columns, laid out for [`weigh_block`](super::super::tile::weigh_block).
#[derive(Default)]
pub(super) struct GatheredTile {
    pub(super) panels: Panels,
    pub(super) targets: Targets,
    factors: Vec<f32>,
}

impl GatheredTile {
    /// Copies the descriptors and factors of ascending `groups`.
    pub(super) fn gather_descriptors(
        &mut self,
        from: &BoundedSide,
        groups: &[u32],
        scaling: Scaling<'_>,
    ) {
        let (dim, n) = (from.rows.dim(), from.rows.len());
        let Panels { values, norms } = &mut self.panels;
        collect(norms, from.rows.norms(), groups);
        match scaling.columns() {
            Some(factors) => collect(&mut self.factors, factors, groups),
            None => self.factors.clear(),
        }
        let width = norms.len();
        values.resize(dim * width, 0.0);
        for (k, &group) in groups.iter().enumerate() {
            let columns = columns(group, n);
            let piece = &from.groups[columns.start * dim..columns.end * dim];
            let places = values.chunks_exact_mut(width).map(|row| &mut row[k * GROUP..]);
            if columns.len() == GROUP {
                // The length is known to the compiler: a load and a store.
                for (place, part) in places.zip(piece.as_chunks::<GROUP>().0) {
                    place[..GROUP].copy_from_slice(part);
                }
            } else {
                for (place, part) in places.zip(piece.chunks_exact(columns.len())) {
                    place[..part.len()].copy_from_slice(part);
                }
            }
        }
    }

    /// Copies their positions.
    pub(super) fn gather_positions(&mut self, from: &BoundedSide, groups: &[u32]) {
        let (to, from) = (&mut self.targets, &from.streamed);
        collect(&mut to.x, &from.x, groups);
        collect(&mut to.y, &from.y, groups);
        collect(&mut to.z, &from.z, groups);
        collect(&mut to.squares, &from.squares, groups);
    }

    /// Returns `scaling` with the factors of these columns.
    pub(super) fn scaling<'a>(&'a self, scaling: Scaling<'a>) -> Scaling<'a> {
        let v = &self.factors;
        match scaling {
            Scaling::None | Scaling::Source(_) => scaling,
            Scaling::Target(_) => Scaling::Target(v),
            Scaling::Product(u, _) => Scaling::Product(u, v),
            Scaling::Dual(u, _) => Scaling::Dual(u, v),
        }
    }
}

/// Returns the columns of a group; the last of `n` may have fewer.
pub(super) fn columns(group: u32, n: usize) -> Range<usize> {
    let first = group as usize * GROUP;
    first..(first + GROUP).min(n)
}

fn collect(to: &mut Vec<f32>, from: &[f32], groups: &[u32]) {
    to.clear();
    for &group in groups {
        to.extend_from_slice(&from[columns(group, from.len())]);
    }
}
