//! One side of the connection, reordered into blocks that are compact in descriptor space.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::super::reduce::Targets;
use super::super::tile::DescriptorRows;
use super::ConnectionSide;
use crate::par;

/// Rows a block, which share a box and the list of columns that are weighted against them.
pub(super) const BLOCK: usize = 64;
/// Columns that are weighted or left out together: copying them as a piece costs little.
pub(super) const GROUP: usize = 8;

/// Principal axes that blocks are cut along and bounded on: 8 carry 92 % of the variance of
/// FPFH (30,000 points of the Stanford dragon), and 16 leave out no more.
const AXES: usize = 8;
/// Rows for estimating the axes, and rounds of the iteration: any orthonormal axes keep the error
/// bound, better ones only skip more.
const SAMPLE: usize = 1024;
const ROUNDS: usize = 6;
/// Rows whose bounds are computed together, to stay in the first-level cache.
const CHUNK: usize = 1024;

/// Up to [`AXES`] orthonormal axes, in descending order of variance: for each dimension, its
/// component on every axis, 0 where there are fewer.
pub(super) struct PrincipalAxes(Vec<[f64; AXES]>);

/// A side in kd-order: every [`BLOCK`] rows, and every [`GROUP`], are near one another.
pub(super) struct BoundedSide {
    pub(super) rows: DescriptorRows,
    pub(super) points: Vec<[f32; 3]>,
    /// The same positions, in streaming layout.
    pub(super) streamed: Targets,
    /// The rows group by group; within a group, one dimension after the other.
    pub(super) groups: Vec<f32>,
    /// The projections of the rows, one axis after the other.
    projected: Vec<f32>,
    /// The bounds of every block.
    boxes: Vec<BlockBounds>,
}

/// Bounds of a block of rows: the least and the largest value on each axis, and the largest squared
/// norm.
struct BlockBounds {
    low: [f32; AXES],
    high: [f32; AXES],
    norm: f32,
}

impl PrincipalAxes {
    /// Computes the axes of the rows of both sides, by orthogonal iteration (Golub & Van Loan,
    /// 8.2.4) from the dimensions of most variance.
    pub(super) fn compute(a: &DescriptorRows, b: &DescriptorRows) -> PrincipalAxes {
        let stride = (a.len() + b.len()).div_ceil(SAMPLE);
        let all = (0..a.len()).map(|i| a.row(i)).chain((0..b.len()).map(|i| b.row(i)));
        let sample: Vec<&[f32]> = all.step_by(stride).collect();
        let dim = a.dim();
        let variance = |d: usize| sample.iter().map(|row| f64::from(row[d]).powi(2)).sum::<f64>();
        let mut widest: Vec<(usize, f64)> = (0..dim).map(|d| (d, variance(d))).collect();
        widest.sort_by(|a, b| b.1.total_cmp(&a.1));
        let start = widest.iter().take(AXES).enumerate();
        let mut axes = PrincipalAxes(vec![[0.0; AXES]; dim]);
        start.for_each(|(k, &(d, _))| axes.0[d][k] = 1.0);
        for _ in 0..ROUNDS {
            axes = axes.apply_scatter(&sample).orthonormalize();
        }
        axes
    }

    /// Projects the row on every axis.
    #[inline(always)]
    fn project(&self, row: &[f32]) -> [f64; AXES] {
        let mut lengths = [0.0; AXES];
        for (&x, parts) in row.iter().zip(&self.0) {
            lengths.iter_mut().zip(parts).for_each(|(sum, part)| *sum += f64::from(x) * part);
        }
        lengths
    }

    /// Returns Σ x (xᵀ A) over the sample: the scatter matrix times the axes.
    fn apply_scatter(&self, sample: &[&[f32]]) -> PrincipalAxes {
        let mut sums = vec![[0.0; AXES]; self.0.len()];
        for row in sample {
            let lengths = self.project(row);
            for (&x, sums) in row.iter().zip(&mut sums) {
                sums.iter_mut().zip(&lengths).for_each(|(sum, l)| *sum += f64::from(x) * l);
            }
        }
        PrincipalAxes(sums)
    }

    /// Orthonormalises by Gram-Schmidt, each axis twice ("twice is enough"); an axis in the span of
    /// the previous ones becomes 0.
    fn orthonormalize(mut self) -> PrincipalAxes {
        let rows = &mut self.0;
        let product = |rows: &[[f64; AXES]], k: usize, l: usize| -> f64 {
            rows.iter().map(|parts| parts[k] * parts[l]).sum()
        };
        for k in 0..AXES {
            let whole = product(rows, k, k).sqrt();
            for l in (0..k).chain(0..k) {
                let shared = product(rows, k, l);
                rows.iter_mut().for_each(|parts| parts[k] -= shared * parts[l]);
            }
            let rest = product(rows, k, k).sqrt();
            let factor = if rest > 1e-6 * whole { 1.0 / rest } else { 0.0 };
            rows.iter_mut().for_each(|parts| parts[k] *= factor);
        }
        self
    }
}

impl BoundedSide {
    pub(super) fn new(side: &ConnectionSide, axes: &PrincipalAxes) -> BoundedSide {
        let (rows, n) = (&side.rows, side.rows.len());
        let arch = pulp::Arch::new();
        let project = |_: &mut (), range| arch.dispatch(ProjectRows { rows, range, axes });
        let projected = par::map_blocks(n, CHUNK, || (), project).concat();
        let mut order: Vec<u32> = (0..n as u32).collect();
        split_kd_order(&mut order, &projected);
        let block = |order: &[u32]| {
            let mut extent = BlockBounds {
                low: [f32::INFINITY; AXES],
                high: [f32::NEG_INFINITY; AXES],
                norm: 0.0,
            };
            for &i in order {
                let BlockBounds { low, high, norm } = &mut extent;
                *norm = norm.max(rows.norms()[i as usize]);
                for ((low, high), &x) in low.iter_mut().zip(high).zip(&projected[i as usize]) {
                    (*low, *high) = (low.min(x), high.max(x));
                }
            }
            extent
        };
        let on = |axis: usize| order.iter().map(move |&i| (i as usize, axis));
        let points: Vec<[f32; 3]> = order.iter().map(|&i| side.points[i as usize]).collect();
        let rows = rows.select(&order);
        BoundedSide {
            boxes: order.chunks(BLOCK).map(block).collect(),
            projected: (0..AXES).flat_map(on).map(|(i, axis)| projected[i][axis]).collect(),
            streamed: Targets::new(&points),
            groups: rows.transposed(GROUP),
            points,
            rows,
        }
    }

    /// Writes, for every row of `self`, a lower bound of its squared distance from all rows of a
    /// block of `other`. The bound includes the rounding of the distance that tiles compute.
    ///
    /// Proof. Projection on orthonormal axes shortens distances, and a point of the box is
    /// at least the gap away on each axis: Σ gap² ≤ d². The rest is rounding. With u = 2⁻²⁴
    /// and s = |a|² + |b|² ≥ d²/2: the computed d² is off by at most (D + 4) u s for its
    /// product of D terms and the norms, in any order of summation, and 4 u s for centring;
    /// a gap by 2 u (|a| + |b|) for the projections, hence Σ gap² by
    /// 4 √8 u (|a| + |b|)² ≤ 23 u s; and by 11 u · 2 s for its own 8 terms. Together below
    /// (D + 64) u s.
    pub(super) fn distance_bounds(&self, other: &BoundedSide, block: usize, bounds: &mut Vec<f32>) {
        bounds.clear();
        bounds.resize(self.rows.len(), 0.0);
        pulp::Arch::new().dispatch(BoundDistances {
            side: self,
            from: &other.boxes[block],
            bounds,
        });
    }
}

struct ProjectRows<'a> {
    rows: &'a DescriptorRows,
    range: Range<usize>,
    axes: &'a PrincipalAxes,
}

impl WithSimd for ProjectRows<'_> {
    type Output = Vec<[f32; AXES]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let project = |i| self.axes.project(self.rows.row(i)).map(|x| x as f32);
        self.range.map(project).collect()
    }
}

struct BoundDistances<'a> {
    side: &'a BoundedSide,
    from: &'a BlockBounds,
    bounds: &'a mut [f32],
}

impl WithSimd for BoundDistances<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let BoundDistances { side: of, from, bounds } = self;
        let n = bounds.len();
        let margin = (of.rows.dim() + 64) as f32 * (f32::EPSILON / 2.0);
        for (chunk, bounds) in bounds.chunks_mut(CHUNK).enumerate() {
            let chunk = chunk * CHUNK..chunk * CHUNK + bounds.len();
            for axis in 0..AXES {
                let (low, high) = (from.low[axis], from.high[axis]);
                let values = &of.projected[axis * n..][chunk.clone()];
                for (sum, &x) in bounds.iter_mut().zip(values) {
                    let gap = (low - x).max(x - high).max(0.0);
                    *sum = gap.mul_add(gap, *sum);
                }
            }
            for (sum, &norm) in bounds.iter_mut().zip(&of.rows.norms()[chunk]) {
                *sum = (*sum - margin * (from.norm + norm)).max(0.0);
            }
        }
    }
}

/// Splits at the median of the axis of most variance until at most one group is left; the first
/// half holds whole blocks, or whole groups within a block. Equal values are ordered by index, and
/// so are the rows of a group.
fn split_kd_order(order: &mut [u32], projected: &[[f32; AXES]]) {
    if order.len() <= GROUP {
        order.sort_unstable();
        return;
    }
    let (mut sums, mut squares) = ([0.0; AXES], [0.0; AXES]);
    for &i in order.iter() {
        for (k, &x) in projected[i as usize].iter().enumerate() {
            sums[k] += f64::from(x);
            squares[k] += f64::from(x).powi(2);
        }
    }
    let variance = |k: usize| squares[k] - sums[k] * sums[k] / order.len() as f64;
    let widest = (1..AXES).fold(0, |a, b| if variance(b) > variance(a) { b } else { a });
    let whole = if order.len() > BLOCK { BLOCK } else { GROUP };
    let half = order.len().div_ceil(whole) / 2 * whole;
    let value = |&i: &u32| projected[i as usize][widest];
    order.select_nth_unstable_by(half, |i, j| value(i).total_cmp(&value(j)).then(i.cmp(j)));
    let (near, far) = order.split_at_mut(half);
    split_kd_order(near, projected);
    split_kd_order(far, projected);
}
