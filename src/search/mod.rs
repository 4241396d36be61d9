//! Nearest neighbours in 3-D.
//!
//! Distances are Euclidean, squared where the name says so, between f32 positions that share an
//! origin. Equal distances are ordered by index. [`SearchTree`] takes queries at any position.
//! [`Neighbors`] finds the neighbourhoods of all points of a cloud at once, which is faster.
//! [`NearestDistances`] computes distances alone, [`OccupancyGrid`] rejects positions that are too
//! far to search, and [`CellGrid`] looks up the points along a line.

mod cell_grid;
mod leaves;
mod nearest;
mod nearest_distances;
mod occupancy_grid;
mod tree;

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::par;
use leaves::Leaves;

pub(crate) use leaves::squared_distance;

pub use cell_grid::CellGrid;
pub use nearest_distances::NearestDistances;
pub use occupancy_grid::OccupancyGrid;
pub use tree::SearchTree;

/// Definition of the neighbourhood of a point. It includes the point itself, as in PCL and Open3D.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Neighborhood {
    /// The k nearest points; all of them when the cloud has fewer. Independent of the unit, which
    /// makes descriptors scale-invariant (the paper's choice, k = 150).
    Nearest(usize),
    /// All points within a radius, in the unit of the coordinates.
    Radius(f64),
    /// At most `max` points within `radius`.
    Hybrid {
        /// Radius in the unit of the coordinates.
        radius: f64,
        /// Maximum number of points, nearest first.
        max: usize,
    },
}

impl Neighborhood {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] unless counts are at least 3 and radii positive and finite.
    pub fn validate(&self) -> Result<()> {
        let (radius, count) = match *self {
            Neighborhood::Nearest(k) => (None, Some(k)),
            Neighborhood::Radius(radius) => (Some(radius), None),
            Neighborhood::Hybrid { radius, max } => (Some(radius), Some(max)),
        };
        if let Some(k) = count.filter(|&k| k < 3) {
            let rule = "must be at least 3: fewer points have no plane";
            return Err(Error::config("neighbors", k, rule));
        }
        match radius.filter(|&radius| !(radius > 0.0 && radius <= 1e15)) {
            Some(radius) => {
                Err(Error::config("radius", radius, "must be above 0 and at most 1e15"))
            }
            None => Ok(()),
        }
    }
}

impl fmt::Display for Neighborhood {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Neighborhood::Nearest(k) => write!(f, "{k} nearest"),
            Neighborhood::Radius(radius) => write!(f, "within {radius}"),
            Neighborhood::Hybrid { radius, max } => write!(f, "{max} nearest within {radius}"),
        }
    }
}

/// A neighbour: its index and its squared distance.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Neighbor {
    /// Index into the searched points.
    pub index: u32,
    /// Squared distance to the query.
    pub squared_distance: f32,
}

/// The neighbourhood of every point of a cloud.
pub struct Neighbors {
    /// The point of each row: points that are near each other follow each other.
    order: Vec<u32>,
    /// The row of each point.
    rows: Vec<u32>,
    /// Start of each row; one more entry than points.
    starts: Vec<usize>,
    all: Vec<u32>,
}

impl Neighbors {
    /// Finds the neighbourhoods. They take 4 bytes a neighbour, and 16 a point.
    ///
    /// # Errors
    /// The errors of [`Neighborhood::validate`] and [`SearchTree::new`].
    pub fn find(points: &[[f32; 3]], neighborhood: Neighborhood) -> Result<Self> {
        neighborhood.validate()?;
        let n = points.len();
        if let Neighborhood::Nearest(k) = neighborhood {
            tree::check(points)?;
            let (leaves, k) = (Leaves::new(points), k.min(n));
            let all = nearest::k_nearest_of_all(&leaves, k);
            let mut rows = vec![0; n];
            leaves.order.iter().zip(0..).for_each(|(&i, row)| rows[i as usize] = row);
            let starts = (0..=n).map(|row| row * k).collect();
            return Ok(Neighbors { order: leaves.order, rows, starts, all });
        }
        let tree = SearchTree::new(points)?;
        if let Neighborhood::Radius(radius) = neighborhood {
            check_neighbor_memory(&tree, points, radius)?;
        }
        let around = |_: &mut (), i: usize| {
            let found = tree.neighborhood(&points[i], neighborhood);
            let mut row: Vec<u32> = found.iter().map(|neighbor| neighbor.index).collect();
            row.sort_unstable();
            row
        };
        let found = par::map(n, || (), around);
        let ends = found.iter().scan(0, |end, row| {
            *end += row.len();
            Some(*end)
        });
        let order: Vec<u32> = (0..n as u32).collect();
        let starts = std::iter::once(0).chain(ends).collect();
        Ok(Neighbors { rows: order.clone(), order, starts, all: found.concat() })
    }

    /// Returns the number of points that have a neighbourhood.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Returns whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the neighbourhood of point `i`, including itself, by index, in an order that is the
    /// same for all points: sums over the same neighbours then have the same bits.
    ///
    /// # Panics
    /// When `i` is not below [`len`](Self::len).
    pub fn indices(&self, i: usize) -> &[u32] {
        let row = self.row(i);
        &self.all[self.starts[row]..self.starts[row + 1]]
    }

    /// Returns the position of point `i` in [`order`](Self::order).
    ///
    /// # Panics
    /// When `i` is not below [`len`](Self::len).
    pub fn row(&self, i: usize) -> usize {
        self.rows[i] as usize
    }

    /// Returns the points in an order in which neighbours follow each other: work in this order
    /// finds the neighbours in the cache.
    pub fn order(&self) -> &[u32] {
        &self.order
    }
}

/// Maximum number of neighbours of a cloud by radius: they take 2 GB.
const MAX_NEIGHBORS: usize = 500_000_000;

/// Refuses a radius whose neighbourhoods approach the cloud squared, estimated from a hundred of
/// its points.
pub(crate) fn check_neighbor_memory(
    tree: &SearchTree,
    points: &[[f32; 3]],
    radius: f64,
) -> Result<()> {
    let step = points.len().div_ceil(100);
    let judged: Vec<usize> =
        points.iter().step_by(step).map(|point| tree.within(point, radius).len()).collect();
    let mean = judged.iter().sum::<usize>() / judged.len();
    if mean.saturating_mul(points.len()) <= MAX_NEIGHBORS {
        return Ok(());
    }
    let rule = format!(
        "holds about {mean} neighbours for each of {} points, more than memory is taken for: use a \
         smaller radius, a voxel grid, or a number of neighbours",
        points.len()
    );
    Err(Error::config("radius", radius, rule))
}

/// Computes the resolution of a cloud: the median distance from a position to the nearest other
/// position with a point. Points at the same position count once. 0 for fewer than two positions.
///
/// # Errors
/// The errors of [`SearchTree::new`], but none for an empty cloud.
pub fn resolution(points: &[[f32; 3]]) -> Result<f64> {
    let mut places = points.to_vec();
    // Adding zero turns -0 into 0.
    places.iter_mut().flatten().for_each(|x| *x += 0.0);
    places.sort_unstable_by_key(|place| place.map(f32::to_bits));
    places.dedup();
    if places.len() < 2 {
        return Ok(0.0);
    }
    let mut distances = NearestDistances::new(&places)?.squared_distances_to_others();
    let middle = distances.len() / 2;
    let (_, median, _) = distances.select_nth_unstable_by(middle, f32::total_cmp);
    Ok(f64::from(*median).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    use super::tree::sort_by_distance;

    fn brute(points: &[[f32; 3]], query: &[f32; 3]) -> Vec<Neighbor> {
        let distance = |p: &[f32; 3]| (0..3).map(|a| (p[a] - query[a]) * (p[a] - query[a])).sum();
        sort_by_distance(points.iter().enumerate().map(|(i, p)| (i as u32, distance(p))))
    }

    proptest! {
        // Coordinates on a coarse grid: many ties, duplicates and shared planes.
        #[test]
        fn agrees_with_brute_force(
            points in proptest::collection::vec(proptest::array::uniform3(0..6i32), 1..300),
            query in proptest::array::uniform3(-1.0..7.0f32),
            k in 3..40usize,
            radius in 0.1..5.0f64,
        ) {
            let points: Vec<[f32; 3]> = points.iter().map(|p| p.map(|x| x as f32)).collect();
            let tree = SearchTree::new(&points).unwrap();
            let want = brute(&points, &query);
            let distances = |n: &[Neighbor]| n.iter().map(|n| n.squared_distance).collect::<Vec<_>>();
            let found = tree.k_nearest(&query, k);
            prop_assert_eq!(found.len(), k.min(points.len()));
            for (a, b) in distances(&found).iter().zip(distances(&want)) {
                prop_assert!((a - b).abs() <= 1e-5 * b.max(1.0));
            }
            // All at once, and to the bit: among equal distances the lowest indices.
            let all = Neighbors::find(&points, Neighborhood::Nearest(k)).unwrap();
            for (i, point) in points.iter().enumerate() {
                let found = sort_by_distance(all.indices(i).iter().map(|&j| (j, squared_distance(*point, points[j as usize]))));
                prop_assert_eq!(&found, &brute(&points, point)[..k.min(points.len())]);
            }
            let least = want[0].squared_distance;
            let closest = NearestDistances::new(&points).unwrap();
            prop_assert_eq!(closest.squared_distances(&[query], least), [least]);
            prop_assert_eq!(closest.squared_distances(&[query], 0.99 * least), [f32::INFINITY]);
            prop_assert!((tree.nearest(&query).squared_distance - want[0].squared_distance).abs() < 1e-4);
            let mut inside: Vec<u32> = tree.within(&query, radius).iter().map(|n| n.index).collect();
            let mut expected: Vec<u32> = want
                .iter()
                .filter(|n| f64::from(n.squared_distance) <= radius * radius)
                .map(|n| n.index)
                .collect();
            inside.sort_unstable();
            expected.sort_unstable();
            prop_assert_eq!(inside, expected);
        }
    }

    #[test]
    fn many_points_may_share_a_coordinate() {
        // More than a leaf of the tree can have: some trees cannot split these.
        let line: Vec<[f32; 3]> = (0..500).map(|i| [1.0, 2.0, i as f32]).collect();
        let same = vec![[1.0, 2.0, 3.0]; 500];
        for points in [line, same] {
            let neighbors = Neighbors::find(&points, Neighborhood::Nearest(40)).unwrap();
            assert!((0..500).all(|i| neighbors.indices(i).len() == 40));
            // The point itself, or another one at its position.
            assert!(neighbors.indices(7).iter().any(|&j| points[j as usize] == points[7]));
        }
    }

    #[test]
    fn neighbourhoods_have_defined_sizes() {
        let points = [[0.0; 3], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [9.0, 0.0, 0.0]];
        let count = |neighborhood| {
            let neighbors = Neighbors::find(&points, neighborhood).unwrap();
            (0..4).map(|i| neighbors.indices(i).len()).collect::<Vec<_>>()
        };
        assert_eq!(count(Neighborhood::Nearest(100)), [4, 4, 4, 4]);
        assert_eq!(count(Neighborhood::Radius(2.5)), [2, 3, 2, 1]);
        assert_eq!(count(Neighborhood::Hybrid { radius: 9.5, max: 3 }), [3, 3, 3, 3]);
        assert_eq!(resolution(&points).unwrap(), 2.0);
        assert_eq!(resolution(&[points, points, points].concat()).unwrap(), 2.0);
    }

    #[test]
    fn a_radius_that_holds_the_cloud_squared_is_refused() {
        let points: Vec<[f32; 3]> =
            (0..30_000).map(|i| [(i % 173) as f32, (i / 173) as f32, 0.0]).collect();
        let found = Neighbors::find(&points, Neighborhood::Radius(1e4));
        assert!(matches!(found, Err(Error::Config { field: "radius", .. })));
    }

    #[test]
    fn bad_settings_are_refused() {
        for bad in [
            Neighborhood::Nearest(2),
            Neighborhood::Radius(0.0),
            Neighborhood::Radius(f64::NAN),
            Neighborhood::Hybrid { radius: -1.0, max: 10 },
        ] {
            assert!(matches!(Neighbors::find(&[[0.0; 3]], bad), Err(Error::Config { .. })));
        }
        assert!(matches!(SearchTree::new(&[]), Err(Error::TooFewPoints { .. })));
        let nan = SearchTree::new(&[[0.0; 3], [f32::NAN, 0.0, 0.0]]);
        assert!(matches!(nan, Err(Error::NonFinite { index: 1, .. })));
    }
}
