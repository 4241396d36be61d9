//! Evidence for a pose on the surfaces, for a pose from any source.

use serde::{Deserialize, Serialize};

use super::surface_conflict::ConflictCounts;
use super::surface_patches::SurfacePatches;
use crate::cloud::Transform;
use crate::math;
use crate::surface::{INLIER_DISTANCE, MIN_NORMAL_COSINE, Surface};

/// Distance in front of a seen surface from which on a point violates free space, in voxels. Chosen
/// by hand.
const MIN_CLEARANCE: f64 = 3.0;
/// Number of points of the other surface that a descriptor is compared with. Chosen by hand.
const DISTINCTIVENESS_PROBES: usize = 48;

/// Measurements for and against a pose, on both clouds thinned to one point a voxel.
///
/// The verdict's model ([`VerdictModel`](super::VerdictModel)) makes a probability of them. They
/// stand in every verdict by these names, so that other models can be fitted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Evidence {
    /// Share of one surface's points that overlap the other and face the same way, each weighted by
    /// how well; the larger of the two directions, in [0, 1].
    pub overlap: f64,
    /// Share of near misses among the points that agree with the other surface or miss it, in
    /// (0, 1): points inside the extent of the other surface that face the same way and are several
    /// voxels off along the normal. Correct poses have 0.00 to 0.15, most wrong poses more than
    /// 0.2. Three misses in twenty points are added: without overlap it is 0.15.
    pub surface_conflict: f64,
    /// Standard deviation of the offset along the normal where the surfaces agree, in voxels, 0 to
    /// 1.5. Correct poses of low noise have 0.15 to 0.35, wrong poses about 0.6.
    pub residual_std: f64,
    /// Effective number of different patches that agree: by direction of the normal, and by offset
    /// along it. At least 0; a wall has 1, the walls of a room 6, a sculpture 20 or more.
    pub surface_patches: f64,
    /// How much more similar than by chance the descriptors are where the surfaces overlap, in nats
    /// a point, summed over both directions; -2 to about 6.
    pub descriptor_distinctiveness: f64,
    /// Sum of the inlier weights of the correspondences, at least 0.
    pub inlier_score: f64,
    /// Share of the points that are in space that the other sensor saw to be empty, summed over
    /// both directions, in [0, 2]; `None` if a viewpoint is unknown.
    pub free_space_violation: Option<f64>,
}

/// How thoroughly a pose is measured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measurement {
    /// Number of points of each surface, spread evenly.
    pub(crate) max_points: usize,
    /// Error that the pose may have, in voxels: nearer misses do not count.
    pub(crate) pose_error: f64,
}

/// Scores of one direction.
#[derive(Clone, Default)]
struct DirectionScore {
    points: usize,
    overlap_sum: f64,
    distinctiveness_sum: f64,
    observed_points: usize,
    violating_points: usize,
    conflict: ConflictCounts,
    patches: SurfacePatches,
}

impl DirectionScore {
    fn overlap(&self) -> f64 {
        self.overlap_sum / self.points.max(1) as f64
    }

    fn distinctiveness(&self) -> f64 {
        self.distinctiveness_sum / self.points.max(1) as f64
    }

    fn violation(&self) -> f64 {
        self.violating_points as f64 / self.observed_points.max(1) as f64
    }
}

impl Evidence {
    /// Measures `pose`, which moves the source, local frame to local frame; `inlier_score` is the
    /// score of the correspondences.
    pub(crate) fn compute(
        [source, target]: [&Surface; 2],
        pose: &Transform,
        inlier_score: f64,
        voxel_size: f64,
        measurement: Measurement,
    ) -> Evidence {
        let max_points = measurement.max_points;
        let forward = score_direction(source, target, pose, voxel_size, max_points);
        let backward = score_direction(target, source, &pose.inverse(), voxel_size, max_points);
        let is_known = source.depth_image.is_some() && target.depth_image.is_some();
        let patches = [&forward, &backward].map(|sums| sums.patches.effective_number());
        let (overlap, distinctiveness, violation) = (
            forward.overlap().max(backward.overlap()),
            forward.distinctiveness() + backward.distinctiveness(),
            forward.violation() + backward.violation(),
        );
        let conflict = forward.conflict.merged(backward.conflict);
        Evidence {
            // Unit vectors have length 1 to rounding alone.
            overlap: overlap.min(1.0),
            surface_conflict: conflict.share(measurement.pose_error),
            residual_std: conflict.offset_std(),
            surface_patches: patches[0].max(patches[1]),
            descriptor_distinctiveness: distinctiveness,
            inlier_score,
            free_space_violation: is_known.then_some(violation),
        }
    }
}

/// Scores the points of `from` under `pose` against the surface `onto`.
fn score_direction(
    from: &Surface,
    onto: &Surface,
    pose: &Transform,
    voxel_size: f64,
    max_points: usize,
) -> DirectionScore {
    let step = from.len().div_ceil(max_points).max(1);
    let max_distance = INLIER_DISTANCE * voxel_size;
    let mut sums = DirectionScore::default();
    for i in (0..from.len()).step_by(step) {
        sums.points += 1;
        let (point, own) = (pose.apply(from.point(i)), pose.rotate(from.normal(i)));
        if let Some(clearance) = onto.depth_image.as_ref().and_then(|image| image.clearance(point))
        {
            sums.observed_points += 1;
            sums.violating_points += usize::from(clearance > MIN_CLEARANCE * voxel_size);
        }
        let Some(near) = onto.nearest_within(point, max_distance) else {
            sums.conflict.add_missing(onto, point, own, voxel_size);
            continue;
        };
        let j = near.index as usize;
        let normal = onto.normal(j);
        let cosine = math::dot(own, normal);
        let offset = math::dot(normal, math::sub(point, onto.point(j)));
        sums.conflict.add_agreeing(cosine, offset / voxel_size);
        if cosine <= MIN_NORMAL_COSINE {
            continue;
        }
        let off = offset / (0.75 * max_distance);
        let overlap =
            (1.0 - off * off).max(0.0) * (cosine - MIN_NORMAL_COSINE) / (1.0 - MIN_NORMAL_COSINE);
        sums.overlap_sum += overlap;
        sums.distinctiveness_sum += overlap * descriptor_distinctiveness(from, onto, i, j);
        // In the frame of `from`: patches do not depend on the pose.
        sums.patches.add(from.point(i), from.normal(i), overlap, voxel_size);
    }
    sums
}

/// Returns how much more similar the descriptors of two points are than the first descriptor and
/// others of the second's surface: minus the logarithm of the share that is as similar, less 1, its
/// mean for unrelated points. Flat patches, similar to any other, score about 0.
fn descriptor_distinctiveness(from: &Surface, onto: &Surface, i: usize, j: usize) -> f64 {
    let row = from.descriptors.row(i);
    let distance = |j: usize| squared_descriptor_distance(row, onto.descriptors.row(j));
    let own = distance(j);
    let probe = |k: usize| (k * onto.len() + onto.len() / 2) / DISTINCTIVENESS_PROBES;
    let as_good = (0..DISTINCTIVENESS_PROBES).filter(|&k| distance(probe(k)) <= own).count();
    let share = (as_good as f64 + 0.5) / (DISTINCTIVENESS_PROBES as f64 + 1.0);
    -share.ln() - 1.0
}

/// Squared distance of two descriptors.
pub(crate) fn squared_descriptor_distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::cloud::PointCloud;

    /// That of a plausible pose.
    pub(crate) const EVIDENCE: Evidence = Evidence {
        overlap: 0.3,
        surface_conflict: 0.02,
        residual_std: 0.3,
        surface_patches: 20.0,
        descriptor_distinctiveness: 0.7,
        inlier_score: 9.0,
        free_space_violation: None,
    };
    const ALL: Measurement = Measurement { max_points: usize::MAX, pose_error: 0.0 };

    #[test]
    fn overlap_falls_with_the_distance_along_the_normal() {
        let flat: Vec<_> = (0..900).map(|i| [(i % 30) as f64, (i / 30) as f64, 0.0]).collect();
        let surface = Surface::of_cloud(&PointCloud::new(&flat).unwrap(), 3.0);
        let overlap = |shift: f64| {
            let pose = Transform { translation: [0.0, 0.0, shift], ..Transform::IDENTITY };
            Evidence::compute([&surface; 2], &pose, 0.0, 1.0, ALL).overlap
        };
        assert!(overlap(0.0) > 0.99 && overlap(0.5) < 0.9 && overlap(1.2) == 0.0);
        // Free space is unknown without the viewpoints.
        let evidence = Evidence::compute([&surface; 2], &Transform::IDENTITY, 2.0, 1.0, ALL);
        assert_eq!((evidence.free_space_violation, evidence.inlier_score), (None, 2.0));
    }
}
