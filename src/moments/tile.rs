//! Tiles of the weight matrix: squared distances between descriptors, then weights.
//!
//! Two fillers, chosen by the dimension alone. From [`PRODUCT_FROM`] on, |a|² + |b|² − 2 a·b with
//! the product by faer. Its rounding can make the distance of near-equal rows negative, so the
//! distance is clamped at 0, and the rows are taken about the joint mean to keep |a|² small. Below,
//! plain differences: for positions the product's cancellation would cost up to a quarter of a
//! weight.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::{Simd, WithSimd};

use crate::cloud::Descriptors;
use crate::error::{Error, Result};
use crate::weight::WeightKernel;

/// Sources a block: one task of the parallel loop, one column of a tile each.
pub(super) const SOURCES: usize = 64;
/// Targets a tile. A tile of 64 × 512 f32 (128 KiB) fits a core's second-level cache.
const TARGETS: usize = 512;
/// Dimension from which distances are computed by matrix product.
const PRODUCT_FROM: usize = 8;

/// Descriptors about a common mean, row after row: the side that is cut into blocks.
pub(super) struct DescriptorRows {
    dim: usize,
    values: Vec<f32>,
    norms: Vec<f32>,
}

/// Descriptors about the same mean, in tiles of [`TARGETS`], each dimension after the
/// other: the side that is streamed.
#[derive(Default)]
pub(super) struct Panels {
    pub(super) values: Vec<f32>,
    pub(super) norms: Vec<f32>,
}

/// Returns the mean of the rows of both sides, in f64.
pub(super) fn joint_mean(a: &Descriptors, b: &Descriptors) -> Vec<f64> {
    let mut mean = vec![0.0; a.dim()];
    for row in a.rows().chain(b.rows()) {
        mean.iter_mut().zip(row).for_each(|(sum, &x)| *sum += f64::from(x));
    }
    let n = (a.len() + b.len()).max(1) as f64;
    mean.iter_mut().for_each(|sum| *sum /= n);
    mean
}

impl DescriptorRows {
    /// # Errors
    /// [`Error::NonFinite`] for a row whose squared norm leaves the range of f32.
    pub(super) fn new(descriptors: &Descriptors, mean: &[f64]) -> Result<Self> {
        let dim = descriptors.dim();
        let mut values = Vec::with_capacity(descriptors.len() * dim);
        for row in descriptors.rows() {
            values.extend(row.iter().zip(mean).map(|(&x, m)| (f64::from(x) - m) as f32));
        }
        let square = |row: &[f32]| row.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>() as f32;
        let norms: Vec<f32> = values.chunks_exact(dim).map(square).collect();
        match norms.iter().position(|&norm| norm > 1e37) {
            Some(index) => {
                Err(Error::NonFinite { what: "the squared norm of a descriptor".into(), index })
            }
            None => Ok(DescriptorRows { dim, values, norms }),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.norms.len()
    }

    pub(super) fn dim(&self) -> usize {
        self.dim
    }

    pub(super) fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.dim..][..self.dim]
    }

    /// Selects the rows at `indices`, in that order.
    pub(super) fn select(&self, indices: &[u32]) -> DescriptorRows {
        let mut values = Vec::with_capacity(indices.len() * self.dim);
        indices.iter().for_each(|&i| values.extend_from_slice(self.row(i as usize)));
        let norms = indices.iter().map(|&i| self.norms[i as usize]).collect();
        DescriptorRows { dim: self.dim, values, norms }
    }

    /// Returns the squared norm of each row about the mean of both sides.
    pub(super) fn norms(&self) -> &[f32] {
        &self.norms
    }

    pub(super) fn panels(&self) -> Panels {
        Panels { values: self.transposed(TARGETS), norms: self.norms.clone() }
    }

    /// Returns the values in pieces of `width` rows; within a piece, one dimension after the other.
    pub(super) fn transposed(&self, width: usize) -> Vec<f32> {
        let mut values = Vec::with_capacity(self.values.len());
        for piece in self.values.chunks(width * self.dim) {
            for d in 0..self.dim {
                values.extend(piece[d..].iter().step_by(self.dim));
            }
        }
        values
    }
}

/// Factors on the weights of a pass; source factors by row, target factors by column.
#[derive(Clone, Copy)]
pub(super) enum Scaling<'a> {
    /// w
    None,
    /// w uᵢ
    Source(&'a [f32]),
    /// w vⱼ
    Target(&'a [f32]),
    /// w uᵢ vⱼ
    Product(&'a [f32], &'a [f32]),
    /// (w uᵢ)(w vⱼ): each factor is in [0, 1], so w² cannot underflow on the way.
    Dual(&'a [f32], &'a [f32]),
}

/// Consumer of the weights of one source against one tile of targets.
pub(super) trait Reducer {
    /// `row` counts from the block's first source, `first` is the tile's first target. The call is
    /// inside a SIMD dispatch: mark it `#[inline(always)]`.
    fn row(&mut self, row: usize, first: usize, weights: &[f32]);
}

/// Computes the weights of the sources of `block` against every target, tile by tile, and passes
/// each row of weights to `reducer`. `tile` is scratch.
pub(super) fn weigh_block<K: WeightKernel, R: Reducer>(
    rows: &DescriptorRows,
    block: Range<usize>,
    panels: &Panels,
    kernel: &K,
    scaling: Scaling<'_>,
    reducer: &mut R,
    tile: &mut Vec<f32>,
) {
    let arch = pulp::Arch::new();
    let dim = rows.dim;
    let sources = &rows.values[block.start * dim..block.end * dim];
    for first in (0..panels.norms.len()).step_by(TARGETS) {
        let width = TARGETS.min(panels.norms.len() - first);
        let targets = &panels.values[first * dim..(first + width) * dim];
        tile.resize(width * block.len(), 0.0);
        if dim >= PRODUCT_FROM {
            matmul(
                MatMut::from_column_major_slice_mut(tile, width, block.len()),
                Accum::Replace,
                MatRef::from_column_major_slice(targets, width, dim),
                MatRef::from_column_major_slice(sources, dim, block.len()),
                -2.0f32,
                Par::Seq,
            );
        }
        let (block, norms) = (block.clone(), &panels.norms[first..first + width]);
        let pass = TilePass { rows, block, targets, norms, first, kernel, scaling };
        arch.dispatch(Dispatched { pass, reducer: &mut *reducer, tile: &mut tile[..] });
    }
}

struct TilePass<'a, K> {
    rows: &'a DescriptorRows,
    block: Range<usize>,
    targets: &'a [f32],
    norms: &'a [f32],
    first: usize,
    kernel: &'a K,
    scaling: Scaling<'a>,
}

struct Dispatched<'a, K, R> {
    pass: TilePass<'a, K>,
    reducer: &'a mut R,
    tile: &'a mut [f32],
}

impl<K: WeightKernel, R: Reducer> WithSimd for Dispatched<'_, K, R> {
    type Output = ();

    // Plain loops: compiled here once per instruction set, they become its vector code.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Dispatched { pass, reducer, tile } = self;
        let width = pass.norms.len();
        if pass.kernel.takes_tiles() {
            for (row, d2) in tile.chunks_exact_mut(width).enumerate() {
                pass.distances(pass.block.start + row, d2);
            }
            pass.kernel.fill_tile(tile, width);
        }
        for (row, weights) in tile.chunks_exact_mut(width).enumerate() {
            let i = pass.block.start + row;
            if !pass.kernel.takes_tiles() {
                pass.distances(i, weights);
                pass.kernel.fill(weights);
            }
            pass.scaling.apply(i, pass.first, weights);
            reducer.row(row, pass.first, weights);
        }
    }
}

impl<K> TilePass<'_, K> {
    /// Writes the squared distances of source `i` over the products, if there are any.
    #[inline(always)]
    fn distances(&self, i: usize, d2: &mut [f32]) {
        if self.rows.dim >= PRODUCT_FROM {
            let norm = self.rows.norms[i];
            for (d2, &other) in d2.iter_mut().zip(self.norms) {
                *d2 = (*d2 + (norm + other)).max(0.0);
            }
        } else {
            d2.fill(0.0);
            let source = &self.rows.values[i * self.rows.dim..][..self.rows.dim];
            for (&a, values) in source.iter().zip(self.targets.chunks_exact(d2.len())) {
                for (d2, &b) in d2.iter_mut().zip(values) {
                    *d2 = (a - b).mul_add(a - b, *d2);
                }
            }
        }
    }
}

impl Scaling<'_> {
    #[inline(always)]
    fn apply(self, i: usize, first: usize, weights: &mut [f32]) {
        let columns = first..first + weights.len();
        match self {
            Scaling::None => {}
            Scaling::Source(u) => weights.iter_mut().for_each(|w| *w *= u[i]),
            Scaling::Target(v) => {
                weights.iter_mut().zip(&v[columns]).for_each(|(w, v)| *w *= v);
            }
            Scaling::Product(u, v) => {
                weights.iter_mut().zip(&v[columns]).for_each(|(w, v)| *w = (*w * v) * u[i]);
            }
            Scaling::Dual(u, v) => {
                weights.iter_mut().zip(&v[columns]).for_each(|(w, v)| *w = (*w * u[i]) * (*w * v));
            }
        }
    }
}
