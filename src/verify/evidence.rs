//! Evidence for a pose on the surfaces, for a pose from any source.

use crate::cloud::Transform;
use crate::math;
use crate::surface::{INLIER_DISTANCE, Surface};

/// Smallest cosine of the angle between normals of surfaces that face the same way: 45 degrees.
/// Chosen by hand.
const MIN_NORMAL_COSINE: f64 = 0.7;
/// Distance in front of a seen surface from which on a point violates free space, in voxels. Chosen
/// by hand.
const MIN_CLEARANCE: f64 = 3.0;
/// Number of points of the other surface that a descriptor is compared with. Chosen by hand.
const DISTINCTIVENESS_PROBES: usize = 48;

/// Measurements for and against a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PoseEvidence {
    /// Share of one surface's points that overlap the other and face the same way, each weighted by
    /// how well; the larger of the two directions, in [0, 1].
    pub(crate) overlap: f64,
    /// How much more similar than by chance the descriptors are where the surfaces overlap, in nats
    /// a point, summed over both directions.
    pub(crate) descriptor_distinctiveness: f64,
    /// Sum of the inlier weights of the correspondences, at least 0.
    pub(crate) inlier_score: f64,
    /// Share of the points that are in space that the other sensor saw to be empty, summed over
    /// both directions, in [0, 2]; `None` if a viewpoint is unknown.
    pub(crate) free_space_violation: Option<f64>,
}

/// Scores of one direction.
#[derive(Clone, Copy, Default)]
struct DirectionScore {
    points: usize,
    overlap_sum: f64,
    distinctiveness_sum: f64,
    observed_points: usize,
    violating_points: usize,
}

impl PoseEvidence {
    /// Measures at most `max_points` of each surface, spread evenly, under `pose`, which moves the
    /// source, local frame to local frame; `inlier_score` is the score of the correspondences.
    pub(crate) fn compute(
        [source, target]: [&Surface; 2],
        pose: &Transform,
        inlier_score: f64,
        voxel_size: f64,
        max_points: usize,
    ) -> PoseEvidence {
        let forward = score_direction(source, target, pose, voxel_size, max_points);
        let backward = score_direction(target, source, &pose.inverse(), voxel_size, max_points);
        let share = |part: f64, whole: usize| part / whole.max(1) as f64;
        let violation =
            |sums: DirectionScore| share(sums.violating_points as f64, sums.observed_points);
        let is_known = source.depth_image.is_some() && target.depth_image.is_some();
        PoseEvidence {
            // Unit vectors have length 1 to rounding alone.
            overlap: share(forward.overlap_sum, forward.points)
                .max(share(backward.overlap_sum, backward.points))
                .min(1.0),
            descriptor_distinctiveness: share(forward.distinctiveness_sum, forward.points)
                + share(backward.distinctiveness_sum, backward.points),
            inlier_score,
            free_space_violation: is_known.then(|| violation(forward) + violation(backward)),
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
        let point = pose.apply(from.point(i));
        if let Some(clearance) = onto.depth_image.as_ref().and_then(|image| image.clearance(point))
        {
            sums.observed_points += 1;
            sums.violating_points += usize::from(clearance > MIN_CLEARANCE * voxel_size);
        }
        let Some(near) = onto.nearest(point) else { continue };
        if f64::from(near.squared_distance) >= max_distance * max_distance {
            continue;
        }
        let j = near.index as usize;
        let normal = onto.normal(j);
        let cosine = math::dot(pose.rotate(from.normal(i)), normal);
        if cosine <= MIN_NORMAL_COSINE {
            continue;
        }
        let off = math::dot(normal, math::sub(point, onto.point(j))) / (0.75 * max_distance);
        let overlap =
            (1.0 - off * off).max(0.0) * (cosine - MIN_NORMAL_COSINE) / (1.0 - MIN_NORMAL_COSINE);
        sums.overlap_sum += overlap;
        sums.distinctiveness_sum += overlap * descriptor_distinctiveness(from, onto, i, j);
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
mod tests {
    use super::*;
    use crate::cloud::PointCloud;

    #[test]
    fn overlap_falls_with_the_distance_along_the_normal() {
        let flat: Vec<_> = (0..900).map(|i| [(i % 30) as f64, (i / 30) as f64, 0.0]).collect();
        let surface = Surface::of_cloud(&PointCloud::new(&flat).unwrap(), 3.0);
        let overlap = |shift: f64| {
            let pose = Transform { translation: [0.0, 0.0, shift], ..Transform::IDENTITY };
            PoseEvidence::compute([&surface; 2], &pose, 0.0, 1.0, usize::MAX).overlap
        };
        assert!(overlap(0.0) > 0.99 && overlap(0.5) < 0.9 && overlap(1.2) == 0.0);
        // Free space is unknown without the viewpoints.
        let evidence =
            PoseEvidence::compute([&surface; 2], &Transform::IDENTITY, 2.0, 1.0, usize::MAX);
        assert_eq!((evidence.free_space_violation, evidence.inlier_score), (None, 2.0));
    }
}
