//! Distances from any positions to the nearest point of a cloud, up to a limit.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::leaves::{BoundingBox, LEAF, Leaves, squared_distance};
use super::tree;
use crate::error::Result;
use crate::par;

const LANES: usize = 16;

/// Computes the distance to the nearest point of a cloud.
pub struct NearestDistances(Leaves);

impl NearestDistances {
    /// Creates the index of `points`.
    ///
    /// # Errors
    /// The errors of [`SearchTree::new`](super::SearchTree::new).
    pub fn new(points: &[[f32; 3]]) -> Result<Self> {
        tree::check(points)?;
        Ok(NearestDistances(Leaves::new(points)))
    }

    /// Returns the points, in an order in which neighbours follow each other.
    pub fn points(&self) -> impl Iterator<Item = [f32; 3]> {
        (0..self.0.len()).map(|place| self.0.point(place))
    }

    /// Computes the squared distance from each of `places` to the nearest point; infinite if it
    /// exceeds the squared `limit`.
    ///
    /// Fast if consecutive positions are near each other, like [`points`](Self::points): points
    /// that are far from all of them are skipped together.
    pub fn squared_distances(&self, places: &[[f32; 3]], limit: f32) -> Vec<f32> {
        let arch = pulp::Arch::new();
        let task = |(listed, stack): &mut (Vec<u32>, Vec<u32>), block: Range<usize>| {
            let places = &places[block];
            self.0.leaves_within(
                &BoundingBox::from_points(places.iter().copied()),
                limit,
                LEAF,
                listed,
                stack,
            );
            arch.dispatch(DistancesToLeaves { leaves: &self.0, listed, places, limit })
        };
        par::map_blocks(places.len(), LEAF, Default::default, task).concat()
    }

    /// Computes the squared distance from each of [`points`](Self::points) to the nearest other
    /// one; infinite if there is none.
    pub(super) fn squared_distances_to_others(&self) -> Vec<f32> {
        let arch = pulp::Arch::new();
        let task = |(listed, stack): &mut (Vec<u32>, Vec<u32>), block: Range<usize>| {
            let leaf = (block.start / LEAF) as u32;
            let places: Vec<[f32; 3]> = block.map(|place| self.0.point(place)).collect();
            let mut nearest = arch.dispatch(DistancesWithinLeaf(&places));
            // Search for points nearer than those of the leaf itself.
            let limit = nearest.iter().fold(0.0f32, |a, &b| a.max(b));
            self.0.leaves_within(
                &BoundingBox::from_points(places.iter().copied()),
                limit,
                LEAF,
                listed,
                stack,
            );
            listed.retain(|&listed| listed != leaf);
            let outside = DistancesToLeaves { leaves: &self.0, listed, places: &places, limit };
            let outside = arch.dispatch(outside);
            nearest.iter_mut().zip(outside).for_each(|(near, other)| *near = near.min(other));
            nearest
        };
        par::map_blocks(self.0.len(), LEAF, Default::default, task).concat()
    }
}

/// Distance of each position to the nearest of the others.
struct DistancesWithinLeaf<'a>(&'a [[f32; 3]]);

impl WithSimd for DistancesWithinLeaf<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f32> {
        let places = self.0;
        // Missing positions have no finite distance.
        let [mut x, mut y, mut z] = [[f32::NAN; LEAF]; 3];
        for (k, &place) in places.iter().enumerate() {
            [x[k], y[k], z[k]] = place;
        }
        let nearest = |own: usize| {
            let mut distances = [0.0; LEAF];
            for k in 0..LEAF {
                distances[k] = squared_distance(places[own], [x[k], y[k], z[k]]);
            }
            distances[own] = f32::NAN;
            let mut lanes = [f32::INFINITY; LANES];
            for part in distances.as_chunks::<LANES>().0 {
                for k in 0..LANES {
                    lanes[k] = if part[k] < lanes[k] { part[k] } else { lanes[k] };
                }
            }
            lanes.into_iter().fold(f32::INFINITY, f32::min)
        };
        (0..places.len()).map(nearest).collect()
    }
}

/// Distance of each position to the points of the listed leaves.
struct DistancesToLeaves<'a> {
    leaves: &'a Leaves,
    listed: &'a [u32],
    places: &'a [[f32; 3]],
    limit: f32,
}

impl WithSimd for DistancesToLeaves<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f32> {
        let DistancesToLeaves { leaves, listed, places, limit } = self;
        let [x, y, z] = &leaves.axes;
        let lower = |a: f32, b: f32| if b < a { b } else { a };
        let least = |&place: &[f32; 3]| {
            let mut lanes = [f32::INFINITY; LANES];
            for &leaf in listed {
                let range = leaves.places(leaf as usize);
                let (x, y, z) = (&x[range.clone()], &y[range.clone()], &z[range]);
                let (x, y, z) = (x.as_chunks(), y.as_chunks(), z.as_chunks());
                for ((x, y), z) in x.0.iter().zip(y.0).zip(z.0) {
                    let (x, y, z): (&[f32; LANES], &[f32; LANES], &[f32; LANES]) = (x, y, z);
                    for k in 0..LANES {
                        lanes[k] = lower(lanes[k], squared_distance(place, [x[k], y[k], z[k]]));
                    }
                }
                for (lane, ((&x, &y), &z)) in lanes.iter_mut().zip(x.1.iter().zip(y.1).zip(z.1)) {
                    *lane = lower(*lane, squared_distance(place, [x, y, z]));
                }
            }
            let least = lanes.into_iter().fold(f32::INFINITY, lower);
            if least <= limit { least } else { f32::INFINITY }
        };
        places.iter().map(least).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        // On a coarse grid: ties, duplicates and shared planes.
        #[test]
        fn the_nearest_other_is_that_of_brute_force(
            points in proptest::collection::vec(proptest::array::uniform3(0..9i32), 1..200),
        ) {
            let points: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| x as f32)).collect();
            let closest = NearestDistances::new(&points).unwrap();
            let places: Vec<[f32; 3]> = closest.points().collect();
            let others = |i: usize| (0..places.len()).filter(move |&j| j != i);
            let brute = |i: usize| {
                others(i).map(|j| squared_distance(places[i], places[j])).fold(f32::INFINITY, f32::min)
            };
            let want: Vec<f32> = (0..places.len()).map(brute).collect();
            prop_assert_eq!(closest.squared_distances_to_others(), want);
        }
    }
}
