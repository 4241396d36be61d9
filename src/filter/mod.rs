//! Point reduction: voxel grid, random sample, and one point a position.

mod duplicates;

use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;
use rustc_hash::{FxHashMap, FxHashSet};
use serde::{Deserialize, Serialize};

use crate::cloud::{Attributes, PointCloud};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::search;

pub use self::duplicates::{NoReturns, find_no_returns, remove_no_returns};
pub(crate) use self::duplicates::{merge_duplicate_points, select_returns};

/// Downsampling of a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Downsampling {
    /// Side of the voxels of which one point (the mean) is kept, in the cloud's unit.
    pub voxel: Option<f64>,
    /// Number of points kept, drawn at random after that.
    pub sample: Option<usize>,
    /// Seed of the draw.
    pub seed: u64,
}

impl Downsampling {
    /// Refuses invalid settings.
    ///
    /// # Errors
    /// [`Error::Config`] for a voxel size that is not positive and finite, and for a sample of 0.
    pub fn validate(&self) -> Result<()> {
        self.voxel.map_or(Ok(()), check_voxel)?;
        match self.sample {
            Some(0) => Err(Error::config("sample", 0, "must be at least 1")),
            _ => Ok(()),
        }
    }

    /// Downsamples a cloud; `stream` keeps the draws of the two clouds of a pair independent (0 for
    /// the source, 1 for the target).
    ///
    /// # Errors
    /// The errors of [`validate`](Self::validate) and of [`voxel_grid`].
    pub fn apply(&self, mut cloud: PointCloud, stream: u64) -> Result<PointCloud> {
        self.validate()?;
        if let Some(size) = self.voxel {
            cloud = voxel_grid(&cloud, size)?;
        }
        if let Some(count) = self.sample {
            cloud = sample(&cloud, count, self.seed.wrapping_mul(2).wrapping_add(stream));
        }
        Ok(cloud)
    }
}

/// Keeps one point per occupied voxel of side `size`: the mean of the points (and normals,
/// channels and descriptors) in it, voxels in the order of their first point. For points with weights these are
/// weighted means, and the weights of a voxel add up; if all weights are 0, the means are
/// unweighted.
///
/// The grid starts at the lowest corner of the cloud's bounding box, so that it moves along with
/// the cloud.
///
/// # Errors
/// [`Error::Config`] when `size` is not positive and finite, or so small that a side of the box has
/// more than 2⁶² voxels.
pub fn voxel_grid(cloud: &PointCloud, size: f64) -> Result<PointCloud> {
    let members = voxels(cloud, size)?;
    if members.is_empty() {
        return Ok(cloud.clone());
    }
    let totals = cloud.weights().map(|weights| {
        let total = |cell: &Vec<usize>| cell.iter().map(|&i| f64::from(weights[i])).sum();
        members.iter().map(total).collect::<Vec<f64>>()
    });
    let mean = |cell: usize, value: &dyn Fn(usize) -> Vec3| {
        let within = &members[cell];
        let sum_of = |share: &dyn Fn(usize) -> f64| {
            within.iter().fold([0.0; 3], |sum, &i| math::add(sum, math::scaled(value(i), share(i))))
        };
        match (cloud.weights(), totals.as_ref().map(|totals| totals[cell])) {
            (Some(weights), Some(total)) if total > 0.0 => {
                sum_of(&|i| f64::from(weights[i]) / total)
            }
            _ => math::scaled(sum_of(&|_| 1.0), 1.0 / within.len() as f64),
        }
    };
    let means = |value: &dyn Fn(usize) -> Vec3| -> Vec<Vec3> {
        (0..members.len()).map(|cell| mean(cell, value)).collect()
    };
    // Means of small local numbers, moved to the cloud's frame afterwards.
    let local = means(&|i| cloud.points()[i].map(f64::from));
    let points: Vec<Vec3> = local.into_iter().map(|p| math::add(cloud.origin(), p)).collect();
    let normals = cloud.normals().map(|normals| means(&|i| normals[i].map(f64::from)));
    let channels = cloud.channels().map(|values| {
        let means = means(&|i| [f64::from(values[i]), 0.0, 0.0]);
        means.into_iter().map(|[value, ..]| value as f32).collect()
    });
    let shares = |cell: usize| {
        let within = &members[cell];
        let total = totals.as_ref().map_or(0.0, |totals| totals[cell]);
        let share = move |i: usize| match cloud.weights() {
            Some(weights) if total > 0.0 => f64::from(weights[i]) / total,
            _ => 1.0 / within.len() as f64,
        };
        within.iter().map(move |&i| (i, share(i)))
    };
    let descriptors = cloud.descriptors().map(|rows| rows.means((0..members.len()).map(shares)));
    let has = Attributes {
        normals: normals.as_deref(),
        weights: totals.as_deref(),
        channels: Some(&channels),
        descriptors: descriptors.as_ref(),
    };
    cloud.with_points(&points, has)
}

/// Refuses an invalid voxel size.
///
/// # Errors
/// [`Error::Config`] when `size` is not positive and finite.
pub(crate) fn check_voxel(size: f64) -> Result<()> {
    if size > 0.0 && size.is_finite() {
        return Ok(());
    }
    Err(Error::config("voxel", size, "must be above 0, in the unit of the coordinates"))
}

/// Returns the points of every occupied voxel of side `size`, voxels in the order of their first
/// point.
///
/// # Errors
/// The errors of [`voxel_grid`].
pub(crate) fn voxels(cloud: &PointCloud, size: f64) -> Result<Vec<Vec<usize>>> {
    check_voxel(size)?;
    let Some((low, high)) = cloud.bounds() else { return Ok(Vec::new()) };
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    if longest / size > 4.6e18 {
        let rule = format!("is too small for a cloud {longest:e} long");
        return Err(Error::config("voxel", size, rule));
    }
    let mut cells: FxHashMap<[i64; 3], usize> = FxHashMap::default();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (i, p) in cloud.positions().enumerate() {
        let cell = *cells.entry(voxel_index(p, low, size)).or_insert_with(|| {
            members.push(Vec::new());
            members.len() - 1
        });
        members[cell].push(i);
    }
    Ok(members)
}

/// Points a voxel in the sample that voxels are counted with. Chosen by hand.
const POINTS_PER_VOXEL: usize = 20;

fn voxel_index(p: Vec3, low: Vec3, size: f64) -> [i64; 3] {
    math::sub(p, low).map(|x| (x / size).floor() as i64)
}

/// Finds the voxel size for which about `count` (within a tenth) voxels contain points of `cloud`:
/// a [`voxel_grid`] of this size leaves about as many points. If the cloud has no more distinct
/// positions than that, the result is one and a half times its [`resolution`](search::resolution),
/// which leaves most of the points.
///
/// The result scales with the cloud. 0 for a cloud at one position, or without points.
///
/// # Errors
/// The errors of [`search::resolution`].
pub fn voxel_size_for(cloud: &PointCloud, count: usize) -> Result<f64> {
    if cloud.len() <= count {
        return Ok(1.5 * search::resolution(cloud.points())?);
    }
    let Some((low, high)) = cloud.bounds() else { return Ok(0.0) };
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    // In a dense cloud a part of the points fills nearly as many voxels.
    let step = (cloud.len() / count.saturating_mul(POINTS_PER_VOXEL).max(1)).max(1);
    let occupied = |size: f64| {
        let some = cloud.positions().step_by(step).map(|p| voxel_index(p, low, size));
        some.collect::<FxHashSet<[i64; 3]>>().len() as f64
    };
    // On surfaces the number of voxels changes with the square of their side; twelve steps cover
    // other clouds.
    let mut side = longest / 64.0;
    let mut ratio = f64::INFINITY;
    for _ in 0..12 {
        ratio = occupied(side) / count.max(1) as f64;
        if (0.9..=1.1).contains(&ratio) || side < 1e-6 * longest {
            break;
        }
        side *= ratio.sqrt().clamp(0.25, 4.0);
    }
    // If rows share positions, even the smallest voxels cannot reach that number.
    if ratio < 0.9
        && longest > 0.0
        && duplicates::count_distinct(cloud.points().iter().step_by(step)) <= count
    {
        return Ok(1.5 * search::resolution(cloud.points())?);
    }
    Ok(side)
}

/// Draws `count` points without replacement, in their original order; the whole cloud when it has
/// no more. The same `seed` draws the same indices on every machine.
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
    fn weights_of_a_voxel_add_up_and_weigh_its_mean() {
        let channels = crate::cloud::Channels::default();
        let channels = channels.with("red", (0..10).map(|i| i as f32).collect()).unwrap();
        let line = line(10).with_channels(channels).unwrap();
        let plain = voxel_grid(&line, 4.0).unwrap();
        assert_eq!(plain.channels().get("red"), Some(&[1.5, 5.5, 8.5][..]));
        let mut weights = vec![0.0, 0.0, 1.0, 3.0, 2.0, 2.0, 2.0, 2.0, 0.0, 0.0];
        let thin = |weights: &[f64]| {
            voxel_grid(&line.clone().with_weights(weights.to_vec()).unwrap(), 4.0).unwrap()
        };
        let weighed = thin(&weights);
        assert_eq!(weighed.weights(), Some(&[4.0, 8.0, 0.0][..]));
        let x: Vec<f64> = weighed.positions().map(|p| p[0]).collect();
        assert_eq!(x, [2.75, 5.5, 8.5]);
        assert_eq!(weighed.channels().get("red"), Some(&[2.75, 5.5, 8.5][..]));
        // One point of twice the weight is equivalent to two.
        weights[2] = 6.0;
        let twice = thin(&weights);
        let x: Vec<f64> = twice.positions().map(|p| p[0]).collect();
        assert!((x[0] - 21.0 / 9.0).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn a_side_leaves_about_as_many_in_any_unit() {
        let plane = |unit: f64| {
            let at = |i: usize| [unit * (i % 200) as f64, unit * (i / 200) as f64, 7.0 * unit];
            PointCloud::new(&(0..40_000).map(at).collect::<Vec<_>>()).unwrap()
        };
        let side = voxel_size_for(&plane(1.0), 1000).unwrap();
        let left = voxel_grid(&plane(1.0), side).unwrap().len();
        assert!((850..=1150).contains(&left), "{left}");
        assert_eq!(voxel_size_for(&plane(1024.0), 1000).unwrap(), 1024.0 * side);
        // No more points than that: downsampling changes nothing.
        assert_eq!(voxel_size_for(&plane(1.0), 40_000).unwrap(), 1.5);
        let same = PointCloud::new(&[[1.0, 2.0, 3.0]; 50]).unwrap();
        assert_eq!(voxel_size_for(&same, 10).unwrap(), 0.0);
        assert_eq!(voxel_size_for(&PointCloud::default(), 10).unwrap(), 0.0);
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
