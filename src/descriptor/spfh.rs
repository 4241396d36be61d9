//! Simple point feature histograms: the angles between a point and each neighbour, counted.

use pulp::{Simd, WithSimd};

use super::bin::{self, LANES, OrientedPoint, OrientedPointLanes};
use super::layout::{BINS, BLOCK, BLOCK_SUM};
use crate::search::Neighbors;

/// Number of partial histograms: consecutive pairs often fall into the same bin, and would wait for
/// each other.
const COUNTS: usize = 4;

/// Computes SPFH of one point after the other and reuses its scratch.
#[derive(Default)]
pub(super) struct SpfhBuilder {
    others: Vec<u32>,
    lanes: Vec<OrientedPointLanes>,
    /// Bins of θ, α and φ of every pair.
    bins: Vec<[[u32; LANES]; 3]>,
}

impl SpfhBuilder {
    /// Writes the histograms of the pairs (i, neighbour), each of which sums to [`BLOCK_SUM`], into
    /// the first [`BINS`] values of `row`; 0 without a neighbour.
    pub(super) fn histograms(
        &mut self,
        points: &[[f32; 3]],
        normals: &[[f32; 3]],
        neighbors: &Neighbors,
        i: usize,
        row: &mut [f32],
    ) {
        self.others.clear();
        self.others.extend_from_slice(neighbors.indices(i));
        if let Some(own) = self.others.iter().position(|&j| j as usize == i) {
            self.others.swap_remove(own);
        }
        let pairs = self.others.len();
        // Repeats the last one to fill whole vectors.
        if let Some(&last) = self.others.last() {
            self.others.resize(pairs.next_multiple_of(LANES), last);
        }
        // All are written before the first is read: values written one by one cannot be read as a
        // vector at once.
        let others = self.others.as_chunks().0;
        self.lanes.resize(others.len(), OrientedPointLanes::default());
        self.lanes.iter_mut().zip(others).for_each(|(lanes, of)| lanes.fill(points, normals, of));
        let point = OrientedPoint { place: points[i], normal: normals[i] };
        pulp::Arch::new().dispatch(Bin { point, pairs: self });
        // 16 bins each, whose index has exactly four bits: no index is out of bounds.
        let mut counts = [[[0u32; 16]; 3]; COUNTS];
        for (at, bins) in self.bins.iter().enumerate() {
            for k in 0..LANES.min(pairs - at * LANES) {
                let counts = &mut counts[k % COUNTS];
                for angle in 0..3 {
                    counts[angle][(bins[angle][k] & 0xf) as usize] += 1;
                }
            }
        }
        let increment = BLOCK_SUM / pairs.max(1) as f64;
        for (at, value) in row[..BINS].iter_mut().enumerate() {
            let count: u32 = counts.iter().map(|counts| counts[at / BLOCK][at % BLOCK]).sum();
            *value = (f64::from(count) * increment) as f32;
        }
    }
}

struct Bin<'a> {
    point: OrientedPoint,
    pairs: &'a mut SpfhBuilder,
}

impl WithSimd for Bin<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Bin { point, pairs: SpfhBuilder { lanes, bins, .. } } = self;
        bins.resize(lanes.len(), [[0; LANES]; 3]);
        for (bins, lanes) in bins.iter_mut().zip(lanes) {
            // A copy, so that the compiler knows that it does not overlap.
            let lanes = *lanes;
            *bins = bin::bins(point, &lanes);
        }
    }
}
