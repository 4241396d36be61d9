//! Fast test for positions near a cloud: a bit a cube, instead of a traversal of the tree.

use std::ops::Range;

/// Maximum number of cubes, 2 MiB of bits; a cloud that needs more counts as near every position.
const MAX_CELLS: f64 = (1 << 24) as f64;

/// The cubes that contain a point of a cloud, and the cubes around them.
pub struct OccupancyGrid {
    low: [f64; 3],
    cell_size: f64,
    /// Cubes along each axis; 0 if there are too many.
    size: [usize; 3],
    bits: Vec<u64>,
}

impl OccupancyGrid {
    /// Returns the memory use in bytes.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.bits[..])
    }

    /// Builds the grid of `points` for the distance `reach` above 0, the side of the cubes.
    pub fn new(points: &[[f32; 3]], reach: f64) -> Self {
        let fold = |pick: fn(f32, f32) -> f32, from: f32| {
            points.iter().fold([from; 3], |sum, p| [0, 1, 2].map(|a| pick(sum[a], p[a])))
        };
        let (low, high) = (fold(f32::min, f32::INFINITY), fold(f32::max, f32::NEG_INFINITY));
        // The rounding of distances in f32 is smaller.
        let reach = 1.0001 * reach;
        let low = low.map(|x| f64::from(x) - 1.5 * reach);
        let cubes =
            [0, 1, 2].map(|a| ((f64::from(high[a]) - low[a]) / reach).ceil().max(0.0) + 3.0);
        let all: f64 = cubes.iter().product();
        if all > MAX_CELLS {
            return OccupancyGrid { low, cell_size: reach, size: [0; 3], bits: Vec::new() };
        }
        let size = cubes.map(|n| n as usize);
        let bits = vec![0; size.iter().product::<usize>().div_ceil(64)];
        let mut vicinity = OccupancyGrid { low, cell_size: reach, size, bits };
        for point in points {
            let Some(at) = vicinity.cell(point) else { continue };
            let around =
                |a: usize| -> Range<usize> { at[a].saturating_sub(1)..(at[a] + 2).min(size[a]) };
            for x in around(0) {
                for y in around(1) {
                    for z in around(2) {
                        let bit = vicinity.bit([x, y, z]);
                        vicinity.bits[bit / 64] |= 1 << (bit % 64);
                    }
                }
            }
        }
        vicinity
    }

    /// Returns false only if no point is within reach.
    pub fn may_contain(&self, place: &[f32; 3]) -> bool {
        if self.bits.is_empty() {
            return true;
        }
        self.cell(place).is_some_and(|at| {
            let bit = self.bit(at);
            self.bits[bit / 64] >> (bit % 64) & 1 == 1
        })
    }

    fn cell(&self, place: &[f32; 3]) -> Option<[usize; 3]> {
        let at = [0, 1, 2].map(|a| (f64::from(place[a]) - self.low[a]) / self.cell_size);
        let within = (0..3).all(|a| at[a] >= 0.0 && at[a] < self.size[a] as f64);
        within.then(|| at.map(|x| x as usize))
    }

    fn bit(&self, [x, y, z]: [usize; 3]) -> usize {
        (x * self.size[1] + y) * self.size[2] + z
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::SearchTree;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_within_reach_is_never_passed_over(
            points in prop::collection::vec(prop::array::uniform3(-5.0f32..5.0), 1..40),
            places in prop::collection::vec(prop::array::uniform3(-9.0f32..9.0), 1..200),
            reach in 0.01f64..4.0,
        ) {
            let (tree, vicinity) = (SearchTree::new(&points).unwrap(), OccupancyGrid::new(&points, reach));
            for place in &places {
                let far = f64::from(tree.nearest(place).squared_distance).sqrt();
                prop_assert!(vicinity.may_contain(place) || far > reach);
            }
        }
    }

    #[test]
    fn most_places_far_away_are_passed_over() {
        let line: Vec<[f32; 3]> = (0..100).map(|i| [i as f32, 0.0, 0.0]).collect();
        let vicinity = OccupancyGrid::new(&line, 1.0);
        for far in [3.0, 50.0, 1e9, -1e30, f32::NAN, f32::INFINITY] {
            assert!(
                !vicinity.may_contain(&[50.0, far, 0.0])
                    && !vicinity.may_contain(&[50.0, 0.0, far])
            );
        }
        // Few points in many cubes: every position counts as near.
        let sparse = OccupancyGrid::new(&[[0.0; 3], [1e9; 3]], 1.0);
        assert!(sparse.may_contain(&[50.0; 3]) && sparse.bits.is_empty());
    }
}
