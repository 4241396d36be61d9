//! The k nearest points of every point of a cloud, many at a time.
//!
//! The points of a leaf have nearly the same neighbours. So the tree is traversed once a leaf, for
//! all points within reach of its box, and each point of the leaf is compared with all of these:
//! plain loops over arrays, which become vector code. The k-th distance is found by counting, not
//! by sorting.

use pulp::{Simd, WithSimd};

use super::leaves::{LEAF, Leaves, squared_distance};
use crate::par;

/// Leaves a task of the parallel loop: the radius needed by one is the estimate for the next.
/// Chosen by hand.
const LEAVES_PER_TASK: usize = 16;
/// Factor of the search radius over the radius needed by the last leaf: a smaller factor repeats
/// too many searches, a larger one finds too many points. Chosen by hand.
const RADIUS_MARGIN: f32 = 1.25;

/// Finds the indices of the `k` nearest of every point, `k` from 1 to their number, row after row
/// in the order of `leaves`; within a row too. Among equal distances the lower indices are taken.
pub(super) fn k_nearest_of_all(leaves: &Leaves, k: usize) -> Vec<u32> {
    let mut rows = vec![0; leaves.len() * k];
    let arch = pulp::Arch::new();
    par::for_each_row(
        &mut rows,
        LEAVES_PER_TASK * LEAF * k,
        QueryScratch::default,
        |scratch, task, rows| {
            let mut reach = 0.0;
            for (at, rows) in rows.chunks_mut(LEAF * k).enumerate() {
                let leaf = task * LEAVES_PER_TASK + at;
                reach = arch.dispatch(LeafQuery { leaves, leaf, k, reach, scratch, rows });
            }
        },
    );
    rows
}

#[derive(Default)]
struct QueryScratch {
    /// Leaves within reach.
    listed: Vec<u32>,
    stack: Vec<u32>,
    /// Squared distances from one point to all points of these leaves.
    distances: Vec<f32>,
    ties: Vec<u32>,
    row: Vec<u32>,
}

/// Computes the rows of a leaf; the result is the squared radius that they need.
struct LeafQuery<'a> {
    leaves: &'a Leaves,
    leaf: usize,
    k: usize,
    /// Squared radius to try first.
    reach: f32,
    scratch: &'a mut QueryScratch,
    rows: &'a mut [u32],
}

impl WithSimd for LeafQuery<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f32 {
        let LeafQuery { leaves, leaf, k, reach, scratch, rows } = self;
        if let Some(used) = fill_rows_within(leaves, leaf, k, reach * RADIUS_MARGIN, scratch, rows)
        {
            return used;
        }
        // The ball around one point that contains k, widened by the leaf, contains k around each
        // point.
        let (extent, around) = leaves.enclosing_boxes(leaf, k);
        let (own, sure) = (extent.squared_diagonal(), around.squared_diagonal());
        let one = &mut rows[..k];
        let first = fill_rows_within(leaves, leaf, k, sure, scratch, one).unwrap_or(sure);
        let widened = (first.sqrt() + own.sqrt()).powi(2) * (1.0 + 1e-5);
        fill_rows_within(leaves, leaf, k, widened.min(sure), scratch, rows)
            .or_else(|| fill_rows_within(leaves, leaf, k, sure, scratch, rows))
            .unwrap_or(sure)
    }
}

/// Fills as many rows of a leaf as `rows` has room for, from the points within a squared `reach`;
/// `None` if there are too few. The result is the largest squared distance.
#[inline(always)]
fn fill_rows_within(
    leaves: &Leaves,
    leaf: usize,
    k: usize,
    reach: f32,
    scratch: &mut QueryScratch,
    rows: &mut [u32],
) -> Option<f32> {
    let QueryScratch { listed, stack, distances, ties, row } = scratch;
    leaves.leaves_within(&leaves.enclosing_boxes(leaf, 0).0, reach, k, listed, stack);
    row.resize(k + 1, 0);
    let mut used = 0.0f32;
    for (place, out) in leaves.places(leaf).zip(rows.chunks_exact_mut(k)) {
        let query = leaves.point(place);
        distances.clear();
        for &near in listed.iter() {
            let range = leaves.places(near as usize);
            let [x, y, z] = &leaves.axes;
            let (x, y, z) = (&x[range.clone()], &y[range.clone()], &z[range]);
            distances.extend(
                x.iter().zip(y).zip(z).map(|((&x, &y), &z)| squared_distance(query, [x, y, z])),
            );
        }
        let limit = kth_smallest(distances, k, reach)?;
        let last = match limit.ties {
            0 => key(limit.below, u32::MAX),
            _ => {
                let tied = |(at, &d): (usize, &f32)| (d == limit.above).then_some(at);
                let index = |at: usize| leaves.order[listed[at / LEAF] as usize * LEAF + at % LEAF];
                ties.clear();
                ties.extend(distances.iter().enumerate().filter_map(tied).map(index));
                key(limit.above, *ties.select_nth_unstable(limit.ties - 1).1)
            }
        };
        let furthest = f32::from_bits((last >> 32) as u32);
        let mut count = 0;
        for (&near, distances) in listed.iter().zip(distances.chunks(LEAF)) {
            // A sum of integers becomes vector code, a minimum of floats does not.
            if distances.iter().map(|&d| u32::from(d <= furthest)).sum::<u32>() == 0 {
                continue;
            }
            let range = leaves.places(near as usize);
            for (&index, &squared_distance) in leaves.order[range].iter().zip(distances) {
                // Written in any case, and kept or not: a branch here would be mispredicted often.
                row[count] = index;
                count += usize::from(key(squared_distance, index) <= last);
            }
        }
        out.copy_from_slice(&row[..k]);
        used = used.max(furthest);
    }
    Some(used)
}

/// Returns a key that orders points by distance, then by index: the bits of non-negative floats
/// grow with them.
#[inline(always)]
fn key(squared_distance: f32, index: u32) -> u64 {
    u64::from(squared_distance.to_bits()) << 32 | u64::from(index)
}

/// Threshold of the k nearest: all up to `below`, and `ties` many at `above`.
struct KthDistance {
    below: f32,
    above: f32,
    ties: usize,
}

/// Finds the limit of the `k` smallest of the non-negative `values`, if it is at most `reach`.
///
/// On a surface counts grow evenly with the squared distance, so linear interpolation between two
/// counts gives a close estimate; halving the bits between them ends the search in any case.
#[inline(always)]
fn kth_smallest(values: &[f32], k: usize, reach: f32) -> Option<KthDistance> {
    let count = |limit: f32| values.iter().map(|&d| u32::from(d <= limit)).sum::<u32>() as usize;
    let found = |below| Some(KthDistance { below, above: below, ties: 0 });
    let (mut high, mut at_high) = (reach, count(reach));
    if at_high <= k {
        return if at_high == k { found(reach) } else { None };
    }
    let (mut low, mut at_low) = (-1.0f32, 0);
    let zero = count(0.0);
    if zero > k {
        return Some(KthDistance { below: -1.0, above: 0.0, ties: k });
    }
    if zero > 0 {
        (low, at_low) = (0.0, zero);
        if zero == k {
            return found(0.0);
        }
    }
    for step in 0.. {
        let (bits_low, bits_high) = (low.max(0.0).to_bits(), high.to_bits());
        if bits_high - bits_low <= 1 && low >= 0.0 {
            return Some(KthDistance { below: low, above: high, ties: k - at_low });
        }
        let share = (k - at_low) as f32 / (at_high - at_low) as f32;
        let line = low.max(0.0) + (high - low.max(0.0)) * share;
        let middle = f32::from_bits(bits_low + (bits_high - bits_low) / 2);
        let inside = line > low && line < high && step < 10;
        let at = if inside { line } else { middle };
        match count(at) {
            n if n == k => return found(at),
            n if n < k => (low, at_low) = (at, n),
            n => (high, at_high) = (at, n),
        }
    }
    None
}
