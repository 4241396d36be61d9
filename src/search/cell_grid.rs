//! Points by the cube that contains them, for lookups along a line.

use rustc_hash::FxHashMap;

/// The points of a cloud, by cubes of one side.
pub struct CellGrid {
    cell_size: f64,
    /// Range in `order` of each occupied cube.
    ranges: FxHashMap<[i64; 3], [u32; 2]>,
    /// Point numbers, cube by cube, ascending within a cube.
    order: Vec<u32>,
}

impl CellGrid {
    /// Sorts `points` into cubes of side `cell_size` above 0.
    pub fn new(points: &[[f32; 3]], cell_size: f64) -> Self {
        let cell = |i: u32| cell_of(points[i as usize].map(f64::from), cell_size);
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_by_key(|&i| (cell(i), i));
        let mut ranges: FxHashMap<[i64; 3], [u32; 2]> = FxHashMap::default();
        for (at, &i) in (0u32..).zip(&order) {
            ranges.entry(cell(i)).or_insert([at; 2])[1] = at + 1;
        }
        CellGrid { cell_size, ranges, order }
    }

    /// Returns the approximate memory use in bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.ranges.capacity() * (size_of::<([i64; 3], [u32; 2])>() + 1) + 4 * self.order.len()
    }

    /// Returns the numbers of the points in the cube that contains `place`.
    pub fn points_near(&self, place: [f64; 3]) -> &[u32] {
        match self.ranges.get(&cell_of(place, self.cell_size)) {
            Some(&[from, to]) => &self.order[from as usize..to as usize],
            None => &[],
        }
    }
}

/// The cube of a position; positions beyond the integers share the outermost cubes.
fn cell_of(place: [f64; 3], cell_size: f64) -> [i64; 3] {
    place.map(|x| (x / cell_size).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_point_is_in_its_cube_once(
            points in prop::collection::vec(prop::array::uniform3(-5.0f32..5.0), 0..60),
            size in 0.1f64..4.0,
        ) {
            let grid = CellGrid::new(&points, size);
            for (i, point) in points.iter().enumerate() {
                let place = point.map(f64::from);
                let near = grid.points_near(place);
                prop_assert_eq!(near.iter().filter(|&&j| j as usize == i).count(), 1);
                for &j in near {
                    let other = points[j as usize].map(f64::from);
                    prop_assert!((0..3).all(|a| (other[a] - place[a]).abs() <= size));
                }
            }
        }
    }

    #[test]
    fn places_far_away_have_no_points() {
        let grid = CellGrid::new(&[[1.0, 2.0, 3.0]], 0.5);
        assert!(grid.points_near([1e300, -1e300, 0.0]).is_empty());
        assert_eq!(grid.points_near([1.1, 2.1, 3.1]), [0]);
    }
}
