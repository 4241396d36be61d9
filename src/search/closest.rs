//! How near the points of a cloud are to any places: distances alone, up to a limit.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::leaves::{Extent, Leaves, squared_distance};
use super::tree;
use crate::error::Result;
use crate::par;

/// Places a task of the parallel loop.
const TASK: usize = 64;

/// Tells the distance to the nearest point of a cloud.
pub struct Closest(Leaves);

impl Closest {
    /// To `points`.
    ///
    /// # Errors
    /// Those of [`SearchTree::new`](super::SearchTree::new).
    pub fn new(points: &[[f32; 3]]) -> Result<Self> {
        tree::check(points)?;
        Ok(Closest(Leaves::new(points)))
    }

    /// Squared distance from each of `places` to the nearest point; infinite where that is more
    /// than `limit`, squared too. Much faster than without a limit: most places of a wrong pose
    /// are far from everything, and that is told by the boxes around the points.
    pub fn within(&self, places: &[[f32; 3]], limit: f32) -> Vec<f32> {
        let arch = pulp::Arch::new();
        let task = |(listed, stack): &mut (Vec<u32>, Vec<u32>), block: Range<usize>| {
            arch.dispatch(Least { leaves: &self.0, places: &places[block], limit, listed, stack })
        };
        par::map_blocks(places.len(), TASK, Default::default, task).concat()
    }
}

struct Least<'a> {
    leaves: &'a Leaves,
    places: &'a [[f32; 3]],
    limit: f32,
    listed: &'a mut Vec<u32>,
    stack: &'a mut Vec<u32>,
}

impl WithSimd for Least<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Vec<f32> {
        let Least { leaves, places, limit, listed, stack } = self;
        let [x, y, z] = &leaves.axes;
        let least = |&place: &[f32; 3]| {
            leaves.near(&Extent::of_place(place), limit, 1, listed, stack);
            let mut least = f32::INFINITY;
            for &leaf in listed.iter() {
                let range = leaves.places(leaf as usize);
                let coordinates = x[range.clone()].iter().zip(&y[range.clone()]).zip(&z[range]);
                least = coordinates
                    .map(|((&x, &y), &z)| squared_distance(place, [x, y, z]))
                    .fold(least, |a, b| if b < a { b } else { a });
            }
            if least <= limit { least } else { f32::INFINITY }
        };
        places.iter().map(least).collect()
    }
}
