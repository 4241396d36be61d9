//! Reducers: the sums that a pass computes from the weights.

use super::sums::Moments;
use super::tile::Reducer;
use crate::math::Vec3;

/// Number of f32 lanes of partial sums, the same on every machine, so that the vector width does
/// not change the result.
const LANES: usize = 16;
/// Number of sums a source: Σw, Σw qx, Σw qy, Σw qz, Σw |q|², Σw².
const SUMS: usize = 6;

/// Factor on weights before they are squared; the sum of squares is divided by its square. f32 then
/// represents the squares of weights from 1e-28 to 1e9, while plain squares of weights below 1e-19
/// would vanish.
const SQUARE_SCALE: f32 = (1u32 << 30) as f32;

/// Target positions about their origin, one array a coordinate.
#[derive(Default)]
pub(super) struct Targets {
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) z: Vec<f32>,
    pub(super) squares: Vec<f32>,
}

impl Targets {
    pub(super) fn new(points: &[[f32; 3]]) -> Self {
        let axis = |a: usize| points.iter().map(|p| p[a]).collect();
        let square = |p: &[f32; 3]| p.iter().map(|x| x * x).sum();
        Targets { x: axis(0), y: axis(1), z: axis(2), squares: points.iter().map(square).collect() }
    }
}

/// Sums over targets for each source of a block: the rows of W Q̃.
pub(super) struct MomentSums<'a> {
    pub(super) targets: &'a Targets,
    pub(super) sums: Vec<[f64; SUMS]>,
}

impl MomentSums<'_> {
    /// Finishes the block: Σ_i p̃_i (W Q̃)_i with the positions of its sources.
    pub(super) fn fold(&self, sources: &[[f32; 3]], mut moments: Moments) -> Moments {
        for (&point, &[w, x, y, z, squares, w2]) in sources.iter().zip(&self.sums) {
            let point: Vec3 = point.map(f64::from);
            moments.weight += w;
            moments.weight_squared += w2;
            moments.target_squares += squares;
            moments.source_squares += w * crate::math::dot(point, point);
            for (b, sum) in [x, y, z].into_iter().enumerate() {
                moments.target_sum[b] += sum;
                moments.source_sum[b] += w * point[b];
                for a in 0..3 {
                    moments.cross[a][b] += point[a] * sum;
                }
            }
        }
        moments
    }
}

impl Reducer for MomentSums<'_> {
    #[inline(always)]
    fn row(&mut self, row: usize, first: usize, weights: &[f32]) {
        let columns = first..first + weights.len();
        let Targets { x, y, z, squares } = self.targets;
        let (x, y, z, squares) =
            (&x[columns.clone()], &y[columns.clone()], &z[columns.clone()], &squares[columns]);
        // Six named accumulators and no variable index into them: they stay in registers.
        let (mut s, mut sx, mut sy, mut sz, mut sq, mut sw) =
            ([0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES], [0.0; LANES]);
        let whole = weights.len() / LANES * LANES;
        for at in (0..whole).step_by(LANES) {
            let (w, x, y) = (lane(weights, at), lane(x, at), lane(y, at));
            let (z, q) = (lane(z, at), lane(squares, at));
            for k in 0..LANES {
                s[k] += w[k];
                sx[k] = w[k].mul_add(x[k], sx[k]);
                sy[k] = w[k].mul_add(y[k], sy[k]);
                sz[k] = w[k].mul_add(z[k], sz[k]);
                sq[k] = w[k].mul_add(q[k], sq[k]);
                let lifted = SQUARE_SCALE * w[k];
                sw[k] = lifted.mul_add(lifted, sw[k]);
            }
        }
        let mut sums = [s, sx, sy, sz, sq, sw].map(total);
        sums[5] /= f64::from(SQUARE_SCALE).powi(2);
        for at in whole..weights.len() {
            let w = f64::from(weights[at]);
            let factors = [x[at], y[at], z[at], squares[at], weights[at]];
            sums[0] += w;
            for (sum, factor) in sums[1..].iter_mut().zip(factors) {
                *sum += w * f64::from(factor);
            }
        }
        for (sum, part) in self.sums[row].iter_mut().zip(sums) {
            *sum += part;
        }
    }
}

/// Σ_j w_ij for each source of a block.
pub(super) struct RowSums {
    pub(super) sums: Vec<f64>,
}

impl Reducer for RowSums {
    #[inline(always)]
    fn row(&mut self, row: usize, _first: usize, weights: &[f32]) {
        let mut lanes = [0.0f32; LANES];
        let whole = weights.len() / LANES * LANES;
        for at in (0..whole).step_by(LANES) {
            let w: &[f32; LANES] = lane(weights, at);
            for k in 0..LANES {
                lanes[k] += w[k];
            }
        }
        let rest: f64 = weights[whole..].iter().map(|&w| f64::from(w)).sum();
        self.sums[row] += total(lanes) + rest;
    }
}

/// Least value of each row and its column, the lowest among equals.
pub(super) struct RowMinima {
    pub(super) found: Vec<(f32, u32)>,
}

impl Reducer for RowMinima {
    #[inline(always)]
    fn row(&mut self, row: usize, first: usize, weights: &[f32]) {
        // The first least value of each lane, so that no step waits for the previous one.
        let (mut values, mut columns) = ([f32::INFINITY; LANES], [0u32; LANES]);
        let whole = weights.len() / LANES * LANES;
        for at in (0..whole).step_by(LANES) {
            let w: &[f32; LANES] = lane(weights, at);
            for k in 0..LANES {
                let nearer = w[k] < values[k];
                values[k] = if nearer { w[k] } else { values[k] };
                columns[k] = if nearer { (at + k) as u32 } else { columns[k] };
            }
        }
        let rest = (whole..weights.len()).map(|at| (weights[at], at as u32));
        let (mut least, mut column) = self.found[row];
        for (value, at) in values.into_iter().zip(columns).chain(rest) {
            let at = first as u32 + at;
            if value < least || (value == least && at < column) {
                (least, column) = (value, at);
            }
        }
        self.found[row] = (least, column);
    }
}

/// Largest value of each row and its column, the lowest among equals.
pub(super) struct RowMaxima {
    pub(super) found: Vec<(f32, u32)>,
}

impl Reducer for RowMaxima {
    #[inline(always)]
    fn row(&mut self, row: usize, first: usize, weights: &[f32]) {
        let found = &mut self.found[row];
        for (at, &weight) in (first as u32..).zip(weights) {
            if weight > found.0 {
                *found = (weight, at);
            }
        }
    }
}

#[inline(always)]
fn lane(values: &[f32], at: usize) -> &[f32; LANES] {
    values[at..at + LANES].try_into().expect("the slice has LANES values")
}

/// Sums the lanes in f64, as a balanced tree.
#[inline(always)]
fn total(lanes: [f32; LANES]) -> f64 {
    let mut sums = lanes.map(f64::from);
    let mut width = LANES / 2;
    while width > 0 {
        for k in 0..width {
            sums[k] += sums[k + width];
        }
        width /= 2;
    }
    sums[0]
}
