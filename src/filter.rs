//! Fewer points: voxel grid and random sample.

use std::collections::BTreeMap;

use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::math;

/// One point per occupied cube of side `size`: the mean of the points (and normals) in
/// it, cubes in the order of their first point.
///
/// The grid starts at the lowest corner of the cloud's bounding box, so that it moves
/// along with the cloud.
///
/// # Errors
/// [`Error::Config`] when `size` is not positive and finite, or so small that a side of
/// the box has more than 2⁶² cubes.
pub fn voxel_grid(cloud: &PointCloud, size: f64) -> Result<PointCloud> {
    if !(size > 0.0 && size.is_finite()) {
        return Err(Error::config(
            "voxel",
            size,
            "must be above 0, in the unit of the coordinates",
        ));
    }
    let Some((low, high)) = cloud.bounds() else { return Ok(cloud.clone()) };
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    if longest / size > 4.6e18 {
        let rule = format!("is too small for a cloud {longest:e} long");
        return Err(Error::config("voxel", size, rule));
    }
    let mut cells: BTreeMap<[i64; 3], usize> = BTreeMap::new();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (i, p) in cloud.positions().enumerate() {
        let cell = math::sub(p, low).map(|x| (x / size).floor() as i64);
        let cell = *cells.entry(cell).or_insert_with(|| {
            members.push(Vec::new());
            members.len() - 1
        });
        members[cell].push(i);
    }
    let mean = |cell: &Vec<usize>, value: &dyn Fn(usize) -> math::Vec3| {
        let sum = cell.iter().fold([0.0; 3], |sum, &i| math::add(sum, value(i)));
        math::scaled(sum, 1.0 / cell.len() as f64)
    };
    // Means of small local numbers, moved to the cloud's frame afterwards.
    let local = |i: usize| cloud.points()[i].map(f64::from);
    let points: Vec<_> =
        members.iter().map(|cell| math::add(cloud.origin(), mean(cell, &local))).collect();
    let normals = cloud.normals().map(|normals| {
        let value = |i: usize| normals[i].map(f64::from);
        members.iter().map(|cell| mean(cell, &value)).collect::<Vec<_>>()
    });
    cloud.replaced(&points, normals.as_deref())
}

/// `count` points drawn without replacement, in their original order; the whole cloud
/// when it has no more. The same `seed` draws the same indices on every machine.
pub fn sample(cloud: &PointCloud, count: usize, seed: u64) -> PointCloud {
    if count >= cloud.len() {
        return cloud.clone();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut chosen = index::sample(&mut rng, cloud.len(), count).into_vec();
    chosen.sort_unstable();
    cloud.select(&chosen)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(n: usize) -> PointCloud {
        let points: Vec<_> = (0..n).map(|i| [i as f64, 0.5, -1.0]).collect();
        PointCloud::with_normals(&points, &vec![[0.0, 0.0, 1.0]; n]).unwrap()
    }

    #[test]
    fn a_voxel_holds_its_mean() {
        let thin = voxel_grid(&line(10), 4.0).unwrap();
        let x: Vec<f64> = thin.positions().map(|p| p[0]).collect();
        assert_eq!(x, [1.5, 5.5, 8.5]);
        assert_eq!(thin.normals().unwrap(), [[0.0, 0.0, 1.0]; 3]);
        assert_eq!(voxel_grid(&line(10), 1e-3).unwrap().len(), 10);
        assert!(voxel_grid(&PointCloud::default(), 1.0).unwrap().is_empty());
    }

    #[test]
    fn voxels_must_have_a_size() {
        for size in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-300] {
            let found = voxel_grid(&line(10), size);
            assert!(matches!(found, Err(Error::Config { field: "voxel", .. })), "{size}");
        }
    }

    #[test]
    fn samples_are_seeded_and_without_replacement() {
        let cloud = line(1000);
        let (a, b, c) = (sample(&cloud, 100, 1), sample(&cloud, 100, 1), sample(&cloud, 100, 2));
        assert_eq!(a, b);
        assert_ne!(a, c);
        let x: Vec<f64> = a.positions().map(|p| p[0]).collect();
        assert!(x.len() == 100 && x.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(sample(&cloud, 5000, 1), cloud);
    }
}
