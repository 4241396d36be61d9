//! ICP from a given pose: the largest pair distance follows from the expected error of that pose.

use super::{Cached, Icp, Refine, Registration};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::filter;
use crate::math;
use crate::par;
use crate::search::SearchTree;

/// Smallest limit on the pair distance of ICP, in voxel sizes of clouds downsampled to 5000 points:
/// where clouds overlap in part, longer pairs draw them together. Chosen by hand.
pub(super) const MAX_REFINE_DISTANCE: f64 = 2.0;
/// Smallest overlap that is assumed, as a share of the points. Chosen by hand.
const MIN_OVERLAP: f64 = 0.2;
/// Factor from the distance of that share to the largest pair distance: the surfaces may be farther
/// off than the nearest points are. Chosen by hand.
const DISTANCE_FACTOR: f64 = 4.0;
/// Rounds end when the limit shrinks by less than this factor. Chosen by hand.
const CONVERGENCE_RATIO: f64 = 0.7;
/// Most rounds. Chosen by hand.
const MAX_ROUNDS: usize = 6;
/// Largest pair distance that ICP accepts.
const MAX_DISTANCE: f64 = 1e15;
/// Number of points at which distances are measured. Chosen by hand.
const MAX_SAMPLES: usize = 1000;

/// Refines the pose `initial` with a largest pair distance that follows from the clouds and shrinks
/// as the pose improves.
///
/// # Errors
/// Those of [`Refine::refine`].
pub(super) fn refine_with_distance_limit(
    icp: &Icp,
    source: Cached<'_>,
    target: Cached<'_>,
    initial: &Transform,
) -> Result<Registration> {
    let [from, onto] = par::join_pair([source, target], |end| {
        filter::voxel_size_for(end.cloud, super::consensus::DOWNSAMPLED_POINTS)
    })?;
    let shortest = MAX_REFINE_DISTANCE * (from * initial.scale).max(onto);
    let few = [source, target].iter().any(|end| end.cloud.len() < 3);
    if few || !(shortest > 0.0 && shortest < MAX_DISTANCE) {
        // Clouds without extent: the method itself reports the error.
        return icp.refine_cached(source, target, initial);
    }
    let mut found: Option<Registration> = None;
    let mut before = f64::INFINITY;
    for _ in 0..MAX_ROUNDS {
        let pose = found.as_ref().map_or(*initial, |found| found.transform);
        let near = overlap_distance(source.cloud, target.cloud, &pose)?;
        let bound = shortest.max(DISTANCE_FACTOR * near).min(MAX_DISTANCE);
        if found.is_some() && bound > CONVERGENCE_RATIO * before {
            break;
        }
        before = bound;
        let bounded = Icp { max_distance: Some(bound), ..icp.clone() };
        let mut refined = bounded.refine_cached(source, target, &pose)?;
        if let Some(earlier) = &found {
            refined.iterations += earlier.iterations;
            for (stage, seconds) in &earlier.time_s.0 {
                refined.time_s.add(stage.clone(), *seconds);
            }
        }
        found = Some(refined);
    }
    found.ok_or(Error::NO_WEIGHT)
}

/// Returns the distance within which [`MIN_OVERLAP`] of the points of one cloud have a point of the
/// other, the smaller of both directions.
fn overlap_distance(source: &PointCloud, target: &PointCloud, pose: &Transform) -> Result<f64> {
    let moved = |p| math::sub(pose.apply(p), target.origin()).map(|x| x as f32);
    let moved: Vec<[f32; 3]> = source.positions().map(moved).collect();
    if moved.as_flattened().iter().any(|x| x.is_nan() || x.abs() > 1e18) {
        return Err(Error::Extent { extent: f64::INFINITY });
    }
    let share = |from: &[[f32; 3]], onto: &[[f32; 3]]| -> Result<f64> {
        let step = from.len().div_ceil(MAX_SAMPLES).max(1);
        let tree = SearchTree::new(onto)?;
        let distance = |point| tree.nearest(point).squared_distance;
        let mut squared: Vec<f32> = from.iter().step_by(step).map(distance).collect();
        let at = (MIN_OVERLAP * squared.len() as f64) as usize;
        let (_, squared, _) = squared.select_nth_unstable_by(at, f32::total_cmp);
        Ok(f64::from(*squared).sqrt())
    };
    Ok(share(&moved, target.points())?.min(share(target.points(), &moved)?))
}
