//! Rows at the same position: marks of measurements without a return, and repeated points.

use rustc_hash::{FxHashMap, FxHashSet};
use serde::Serialize;

use crate::cloud::{Attributes, PointCloud};
use crate::error::Result;
use crate::math::{self, Vec3};

/// A position at which a file marks measurements without a return.
///
/// Drivers of depth cameras and LiDARs write a row for every pixel or pulse, and one fixed
/// position, mostly (0, 0, 0), for those without a return.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NoReturns {
    /// The position, in the cloud's own frame.
    pub place: Vec3,
    /// Number of rows at exactly this position.
    pub rows: usize,
}

/// Minimum number of rows at one position to count as missing returns. Chosen by hand: a position
/// with fewer rows is one point to every later step anyway.
const MIN_ROWS: usize = 20;
/// Minimum ratio of a position's rows to the usual number of rows. Chosen by hand: vertices that
/// faces do not share are written 6 times, the tip of a fan of triangles up to 64 times, and
/// coordinates of few decimals repeat up to 30 times where 5 is usual.
const MIN_NO_RETURN_RATIO: usize = 20;
/// Share of rows that repeat another from which on positions are counted instead of rows. Chosen by
/// hand: below it no median over the points of a cloud moves by more than a tenth of its rank.
const MIN_DUPLICATE_SHARE: f64 = 0.1;
/// Number of buckets of positions, by hash; positions are counted exactly in some buckets.
const BUCKETS: usize = 1 << 16;
/// Number of buckets in which rows per position are counted, if so many have rows. Chosen by hand.
const SAMPLE: usize = 1024;

/// The bits of a position; both zeros are equal.
type PointBits = [u32; 3];

fn point_bits(point: &[f32; 3]) -> PointBits {
    point.map(|x| (x + 0.0).to_bits())
}

/// Returns the bucket of a position: all rows of a position are in one bucket.
fn bucket([x, y, z]: PointBits) -> usize {
    let mixed = [x, y, z].into_iter().fold(1u64, |hash, bits| {
        (hash.rotate_left(23) ^ u64::from(bits)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
    });
    (mixed >> 48) as usize
}

/// Counts the rows of each bucket.
fn rows_per_bucket(points: &[[f32; 3]]) -> Vec<u32> {
    let mut rows = vec![0; BUCKETS];
    points.iter().for_each(|point| rows[bucket(point_bits(point))] += 1);
    rows
}

/// Counts the rows of each of a thousand positions or more, or of all positions. The order of the
/// rows in the file does not change the selection.
fn sample_row_counts(points: &[[f32; 3]], rows: &[u32]) -> Vec<usize> {
    let mut left = SAMPLE;
    let take = |&rows: &u32| {
        let taken = left > 0;
        left -= usize::from(taken && rows > 0);
        taken
    };
    let taken: Vec<bool> = rows.iter().map(take).collect();
    let mut places: FxHashMap<PointBits, usize> = FxHashMap::default();
    let sampled = points.iter().map(point_bits).filter(|&key| taken[bucket(key)]);
    sampled.for_each(|key| *places.entry(key).or_default() += 1);
    places.into_values().collect()
}

/// Counts the distinct positions of points.
pub(super) fn count_distinct<'a>(points: impl Iterator<Item = &'a [f32; 3]>) -> usize {
    points.map(point_bits).collect::<FxHashSet<PointBits>>().len()
}

/// Finds the positions at which rows of `cloud` mark measurements without a return, in the order of
/// their first rows. Each of them has at least 20 rows, and 20 times as many as is usual for a
/// position of this cloud (in a cloud of millions, one more for every 30,000 points). Empty if
/// fewer than three other rows would remain.
pub fn find_no_returns(cloud: &PointCloud) -> Vec<NoReturns> {
    let points = cloud.points();
    let rows = rows_per_bucket(points);
    let suspected = MIN_ROWS + 2 * (points.len() / BUCKETS);
    if rows.iter().all(|&rows| (rows as usize) < suspected) {
        return Vec::new();
    }
    let mut usual = sample_row_counts(points, &rows);
    let middle = usual.len() / 2;
    let (_, &mut usual, _) = usual.select_nth_unstable(middle);
    let mut places: FxHashMap<PointBits, (usize, usize)> = FxHashMap::default();
    for (i, point) in points.iter().enumerate() {
        let key = point_bits(point);
        if rows[bucket(key)] as usize >= suspected {
            places.entry(key).or_insert((i, 0)).1 += 1;
        }
    }
    let needed = MIN_ROWS.max(MIN_NO_RETURN_RATIO * usual);
    let mut found: Vec<(usize, usize)> =
        places.into_values().filter(|&(_, rows)| rows >= needed).collect();
    found.sort_unstable();
    let marked: usize = found.iter().map(|&(_, rows)| rows).sum();
    if points.len() - marked < 3 {
        return Vec::new();
    }
    let place = |(first, rows)| NoReturns { place: cloud.position(first), rows };
    found.into_iter().map(place).collect()
}

/// Removes the rows that mark [missing returns](find_no_returns), and counts them
/// ([`PointCloud::no_returns`]); unchanged if there are none.
pub fn remove_no_returns(cloud: PointCloud) -> PointCloud {
    match select_returns(&cloud) {
        Some(rest) => rest,
        None => cloud,
    }
}

/// Removes the rows that mark missing returns; `None` if there are none.
pub(crate) fn select_returns(cloud: &PointCloud) -> Option<PointCloud> {
    let found = find_no_returns(cloud);
    if found.is_empty() {
        return None;
    }
    // The position of a detected row, to the last bit.
    let marks: Vec<Vec3> = found.iter().map(|mark| mark.place).collect();
    let rest: Vec<usize> =
        (0..cloud.len()).filter(|&i| !marks.contains(&cloud.position(i))).collect();
    Some(cloud.select(&rest).with_no_returns(cloud.len() - rest.len()))
}

/// Keeps one point a position, in the order of the first rows: normals, channels and
/// descriptors are means, weights add up. `None` if fewer than a tenth of the rows repeat a position, because no change is
/// needed.
///
/// Meshes whose faces do not share vertices and clouds of few decimals contain every position
/// several times; neighbourhoods of a fixed number of points would then contain few positions.
pub(crate) fn merge_duplicate_points(cloud: &PointCloud) -> Result<Option<PointCloud>> {
    let points = cloud.points();
    let sampled = sample_row_counts(points, &rows_per_bucket(points));
    let rows: usize = sampled.iter().sum();
    if ((rows - sampled.len()) as f64) < MIN_DUPLICATE_SHARE * rows as f64 || rows == sampled.len()
    {
        return Ok(None);
    }
    let mut numbers: FxHashMap<PointBits, usize> = FxHashMap::default();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let number = *numbers.entry(point_bits(point)).or_insert(members.len());
        match members.get_mut(number) {
            Some(rows) => rows.push(i),
            None => members.push(vec![i]),
        }
    }
    merge_rows(cloud, &members).map(Some)
}

/// Merges the rows of each of `members` into one point, at the position of the first.
fn merge_rows(cloud: &PointCloud, members: &[Vec<usize>]) -> Result<PointCloud> {
    let places: Vec<Vec3> = members.iter().map(|rows| cloud.position(rows[0])).collect();
    let normals = cloud.normals().map(|normals| {
        let sum = |rows: &Vec<usize>| {
            rows.iter().fold([0.0; 3], |sum, &i| math::add(sum, normals[i].map(f64::from)))
        };
        members.iter().map(sum).collect::<Vec<Vec3>>()
    });
    let total = |values: &[f32], rows: &[usize]| -> f64 {
        rows.iter().map(|&i| f64::from(values[i])).sum()
    };
    let weights = cloud
        .weights()
        .map(|weights| members.iter().map(|rows| total(weights, rows)).collect::<Vec<f64>>());
    let channels = cloud.channels().map(|values| {
        let mean = |rows: &Vec<usize>| (total(values, rows) / rows.len() as f64) as f32;
        members.iter().map(mean).collect()
    });
    let shares = |rows: &Vec<usize>| {
        let share = 1.0 / rows.len() as f64;
        rows.clone().into_iter().map(move |i| (i, share))
    };
    let descriptors = cloud.descriptors().map(|rows| rows.means(members.iter().map(shares)));
    let has = Attributes {
        normals: normals.as_deref(),
        weights: weights.as_deref(),
        channels: Some(&channels),
        descriptors: descriptors.as_ref(),
    };
    cloud.with_points(&places, has)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `n` positions of a bumpy sheet, each written `times`.
    fn sheet(n: usize, times: usize) -> Vec<Vec3> {
        let at = |i: usize| {
            let (x, y) = ((i % 50) as f64 / 50.0, (i / 50) as f64 / 50.0);
            [x, y, 0.2 * (5.0 * x).sin() + 0.1 * (7.0 * y).cos() + 2.0]
        };
        (0..n * times).map(|i| at(i % n)).collect()
    }

    fn cloud(points: &[Vec3]) -> PointCloud {
        PointCloud::new(points).unwrap()
    }

    #[test]
    fn rows_at_one_place_are_missing_returns() {
        let points = [sheet(1000, 1), vec![[0.0; 3]; 300], vec![[9.0, 0.0, 1.0]; 50]].concat();
        let found = find_no_returns(&cloud(&points));
        let told: Vec<_> = found.iter().map(|mark| (mark.place, mark.rows)).collect();
        assert_eq!(told, [([0.0; 3], 300), ([9.0, 0.0, 1.0], 50)]);
        let rest = remove_no_returns(cloud(&points));
        assert_eq!((rest.len(), rest.no_returns(), rest.dropped()), (1000, 350, 0));
        assert_eq!(find_no_returns(&rest), []);
        // Far more marks than points.
        let most = [sheet(1000, 1), vec![[0.0; 3]; 60_000]].concat();
        assert_eq!(remove_no_returns(cloud(&most)).len(), 1000);
        // Negative zero is zero.
        let signed = [sheet(1000, 1), vec![[0.0, -0.0, 0.0]; 15], vec![[0.0; 3]; 15]].concat();
        assert_eq!(remove_no_returns(cloud(&signed)).len(), 1000);
    }

    #[test]
    fn places_that_are_written_often_are_no_missing_returns() {
        for points in [
            sheet(1000, 1),
            // Like faces that share no vertex, with one position the tip of many.
            [sheet(1000, 6), vec![[0.5, 0.5, 3.0]; 100]].concat(),
            sheet(500, 40),
            [sheet(1000, 1), vec![[0.0; 3]; 19]].concat(),
            // Nothing would remain.
            vec![[1.0, 2.0, 3.0]; 500],
            [sheet(2, 1), vec![[0.0; 3]; 100]].concat(),
            Vec::new(),
        ] {
            assert_eq!(find_no_returns(&cloud(&points)), [], "{} points", points.len());
        }
    }

    #[test]
    fn the_voxel_size_goes_by_places() {
        let once = super::super::voxel_size_for(&cloud(&sheet(1000, 1)), 2000).unwrap();
        let often = super::super::voxel_size_for(&cloud(&sheet(1000, 6)), 2000).unwrap();
        assert_eq!(once, often);
    }

    #[test]
    fn repeated_rows_are_one_point_whose_weights_add_up() {
        assert_eq!(merge_duplicate_points(&cloud(&sheet(1000, 1))).unwrap(), None);
        let few = [sheet(1000, 1), sheet(50, 1)].concat();
        assert_eq!(merge_duplicate_points(&cloud(&few)).unwrap(), None);
        let points = sheet(1000, 3);
        let weights = (0..3000).map(|i| if i < 1000 { 2.0 } else { 0.5 }).collect();
        let channels = crate::cloud::Channels::default();
        let channels = channels.with("row", (0..3000).map(|i| i as f32).collect()).unwrap();
        let cloud = cloud(&points).with_weights(weights).unwrap().with_channels(channels).unwrap();
        let found = merge_duplicate_points(&cloud).unwrap().unwrap();
        assert_eq!(count_distinct(cloud.points().iter()), 1000);
        assert_eq!(found.points(), &cloud.points()[..1000]);
        assert_eq!(found.weights().unwrap()[7], 3.0);
        assert_eq!(found.channels().get("row").unwrap()[7], 1007.0);
        assert_eq!(merge_duplicate_points(&found).unwrap(), None);
        assert_eq!(merge_duplicate_points(&PointCloud::default()).unwrap(), None);
    }

    proptest! {
        /// The order of the rows, the unit and the position of the cloud do not matter.
        #[test]
        fn missing_returns_are_found_wherever_they_stand(
            marks in 20..400usize, seed in 0..1000usize, unit in -20..20i32,
        ) {
            let unit = f64::from(unit).exp2();
            let mut points = [sheet(700, 1), vec![[0.25, -3.0, 0.5]; marks]].concat();
            let n = points.len();
            (0..n).for_each(|i| points.swap(i, (i * 7919 + seed) % n));
            let points: Vec<Vec3> = points.into_iter().map(|p| math::scaled(p, unit)).collect();
            let found = find_no_returns(&cloud(&points));
            prop_assert_eq!(found.len(), 1);
            prop_assert_eq!(found[0].rows, marks);
        }
    }
}
