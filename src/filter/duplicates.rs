//! Rows that share a place: marks of measurements that returned nothing, and repeated points.

use rustc_hash::{FxHashMap, FxHashSet};
use serde::Serialize;

use crate::cloud::{Attributes, PointCloud};
use crate::error::Result;
use crate::math::{self, Vec3};

/// A place at which a file marks measurements that returned nothing.
///
/// Drivers of depth cameras and LiDARs write a row for every pixel or pulse, and one fixed place,
/// mostly (0, 0, 0), for those without a return.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoReturns {
    /// The place, in the cloud's own frame.
    pub place: Vec3,
    /// How many rows are exactly there.
    pub rows: usize,
}

/// Fewest rows at one place that are taken for missing returns. Chosen by hand: a place that is
/// written fewer times is one point to every later step anyway.
const MIN_ROWS: usize = 20;
/// How many times the usual number of rows a place must have. Chosen by hand: vertices that
/// faces do not share are written 6 times, the tip of a fan of triangles up to 64 times, and
/// coordinates of few decimals repeat up to 30 times where 5 is usual.
const MIN_NO_RETURN_RATIO: usize = 20;
/// Share of rows that repeat another from which on places are counted instead of rows. Chosen by
/// hand: below it no median over the points of a cloud moves by more than a tenth of its rank.
const MIN_DUPLICATE_SHARE: f64 = 0.1;
/// Places are counted exactly in some of so many parts of the cloud, by a hash of the place.
const BUCKETS: usize = 1 << 16;
/// Parts in which it is told how often places are written, where so many have rows.
const SAMPLE: usize = 1024;

/// The bits of a place; both zeros are one.
type PointBits = [u32; 3];

fn point_bits(point: &[f32; 3]) -> PointBits {
    point.map(|x| (x + 0.0).to_bits())
}

/// The part that a place belongs to: all of its rows are in one.
fn bucket([x, y, z]: PointBits) -> usize {
    let mixed = [x, y, z].into_iter().fold(1u64, |hash, bits| {
        (hash.rotate_left(23) ^ u64::from(bits)).wrapping_mul(0x9e37_79b9_7f4a_7c15)
    });
    (mixed >> 48) as usize
}

/// How many rows each part has.
fn rows_per_bucket(points: &[[f32; 3]]) -> Vec<u32> {
    let mut rows = vec![0; BUCKETS];
    points.iter().for_each(|point| rows[bucket(point_bits(point))] += 1);
    rows
}

/// For each of a thousand places or more, or for all, how many rows it has: the same places
/// wherever their rows stand in the file.
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

/// How many places points have.
pub(super) fn count_distinct<'a>(points: impl Iterator<Item = &'a [f32; 3]>) -> usize {
    points.map(point_bits).collect::<FxHashSet<PointBits>>().len()
}

/// The places at which rows of `cloud` mark measurements that returned nothing, in the order of
/// their first rows: at least 20 rows are exactly there, and 20 times as many as are usual for a
/// place of this cloud (in a cloud of millions, one more for every 30,000 points). Empty where
/// fewer than three other rows would be left.
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

/// `cloud` without the rows that mark [missing returns](find_no_returns), which it counts
/// ([`PointCloud::no_returns`]); as it is where there are none.
pub fn remove_no_returns(cloud: PointCloud) -> PointCloud {
    match select_returns(&cloud) {
        Some(rest) => rest,
        None => cloud,
    }
}

/// The same; `None` where there is nothing to leave out.
pub(crate) fn select_returns(cloud: &PointCloud) -> Option<PointCloud> {
    let found = find_no_returns(cloud);
    if found.is_empty() {
        return None;
    }
    // The place of a row that was found, to the last bit.
    let marks: Vec<Vec3> = found.iter().map(|mark| mark.place).collect();
    let rest: Vec<usize> =
        (0..cloud.len()).filter(|&i| !marks.contains(&cloud.position(i))).collect();
    Some(cloud.select(&rest).with_no_returns(cloud.len() - rest.len()))
}

/// `cloud` with one point a place, in the order of the first rows: normals and channels are
/// means, weights add up. `None` where fewer than a tenth of the rows repeat a place: it is then
/// good as it is.
///
/// Meshes whose faces do not share vertices and clouds of few decimals say every place several
/// times; neighbourhoods of so many points would then hold a few places.
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

/// One point for each of `members`, at the place of the first.
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
    let has = Attributes {
        normals: normals.as_deref(),
        weights: weights.as_deref(),
        channels: Some(&channels),
    };
    cloud.with_points(&places, has)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `n` places of a bumpy sheet, each written `times`.
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
            // As faces that share no vertex, one place a tip of many.
            [sheet(1000, 6), vec![[0.5, 0.5, 3.0]; 100]].concat(),
            sheet(500, 40),
            [sheet(1000, 1), vec![[0.0; 3]; 19]].concat(),
            // Nothing would be left.
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
        /// The order of the rows, the unit and the place of the cloud do not matter.
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
