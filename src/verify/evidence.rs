//! What speaks for a pose: the surfaces themselves, whoever proposed it.

use super::hypotheses::Correspondences;
use super::scan::{INLIER_DISTANCE, Surface, squared_descriptor_distance};
use crate::cloud::Transform;
use crate::math;

/// Cosine of the angle between normals from which on surfaces face alike.
const MIN_NORMAL_COSINE: f64 = 0.7;
/// How far in front of what was seen a point contradicts it, in lengths.
const MIN_CLEARANCE: f64 = 3.0;
/// Points of the other surface that a descriptor is compared with.
const DISTINCTIVENESS_PROBES: usize = 48;

/// What a pose has for and against it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PoseEvidence {
    /// Share of one surface's points that lie on the other and face alike, by how well they
    /// do; the larger of the two directions.
    pub(super) overlap: f64,
    /// How much more alike than chance the surfaces look where they lie on each other, in nats
    /// a point, both directions together.
    pub(super) descriptor_distinctiveness: f64,
    /// Matches that agree ([`Correspondences::inlier_score`]).
    pub(super) inlier_score: f64,
    /// Share of the points that stand where the other's sensor looked through, both directions
    /// together; `None` where no sensor's place is known.
    pub(super) free_space_violation: Option<f64>,
}

/// One direction.
#[derive(Clone, Copy, Default)]
struct DirectionScore {
    points: usize,
    overlap_sum: f64,
    distinctiveness_sum: f64,
    observed_points: usize,
    violating_points: usize,
}

impl PoseEvidence {
    /// Looks at `most` points of each surface, spread evenly; `pose` moves the source, local
    /// frame to local frame.
    pub(super) fn compute(
        [source, target]: [&Surface; 2],
        matches: &Correspondences,
        pose: &Transform,
        most: usize,
    ) -> PoseEvidence {
        let length = matches.voxel_size;
        let there = score_direction(source, target, pose, length, most);
        let back = score_direction(target, source, &pose.inverse(), length, most);
        let share = |part: f64, whole: usize| part / whole.max(1) as f64;
        let contradicted =
            |sums: DirectionScore| share(sums.violating_points as f64, sums.observed_points);
        let known = source.depth_image.is_some() && target.depth_image.is_some();
        PoseEvidence {
            // Unit vectors are so to rounding alone.
            overlap: share(there.overlap_sum, there.points)
                .max(share(back.overlap_sum, back.points))
                .min(1.0),
            descriptor_distinctiveness: share(there.distinctiveness_sum, there.points)
                + share(back.distinctiveness_sum, back.points),
            inlier_score: matches.inlier_score(pose),
            free_space_violation: known.then(|| contradicted(there) + contradicted(back)),
        }
    }

    /// The logarithm of the odds that the pose is right, by its evidence alone: what ranks the
    /// poses of a pair.
    ///
    /// Logistic in what speaks for a pose, fitted on poses that this method settled for real
    /// pairs. Constants fitted anew are no better at places that they have not seen
    /// (`python-ref/verdict.sh`). What is told of the answer is [`Confidence::log_odds`].
    ///
    /// [`Confidence::log_odds`]: super::confidence::Confidence::log_odds
    pub(super) fn log_odds(&self) -> f64 {
        let overlap = (self.overlap + 0.01).ln();
        let likeness = (self.descriptor_distinctiveness + 0.1).max(0.01).ln();
        let support = self.inlier_score.ln_1p();
        match self.free_space_violation {
            Some(share) => {
                8.0 + 2.08 * overlap + 3.97 * likeness + 0.48 * support - 27.7 * share.sqrt()
            }
            None => -5.95 - 1.41 * overlap + 4.29 * likeness + 2.33 * support,
        }
    }
}

/// `from` under `pose`, on and in front of `onto`.
fn score_direction(
    from: &Surface,
    onto: &Surface,
    pose: &Transform,
    length: f64,
    most: usize,
) -> DirectionScore {
    let step = from.len().div_ceil(most).max(1);
    let reach = INLIER_DISTANCE * length;
    let mut sums = DirectionScore::default();
    for i in (0..from.len()).step_by(step) {
        sums.points += 1;
        let place = pose.apply(from.point(i));
        if let Some(ahead) = onto.depth_image.as_ref().and_then(|seen| seen.clearance(place)) {
            sums.observed_points += 1;
            sums.violating_points += usize::from(ahead > MIN_CLEARANCE * length);
        }
        let Some(near) = onto.nearest(place) else { continue };
        if f64::from(near.squared_distance) >= reach * reach {
            continue;
        }
        let j = near.index as usize;
        let normal = onto.normal(j);
        let facing = math::dot(pose.rotate(from.normal(i)), normal);
        if facing <= MIN_NORMAL_COSINE {
            continue;
        }
        let off = math::dot(normal, math::sub(place, onto.point(j))) / (0.75 * reach);
        let lying =
            (1.0 - off * off).max(0.0) * (facing - MIN_NORMAL_COSINE) / (1.0 - MIN_NORMAL_COSINE);
        sums.overlap_sum += lying;
        sums.distinctiveness_sum += lying * descriptor_distinctiveness(from, onto, i, j);
    }
    sums
}

/// How much more alike two points look than the first and others of the second's surface: minus
/// the logarithm of the share that is as alike, less its mean, 1, for points that have nothing
/// to do with each other. Flat pieces, which look like any other, tell nothing by it.
fn descriptor_distinctiveness(from: &Surface, onto: &Surface, i: usize, j: usize) -> f64 {
    let row = from.descriptors.row(i);
    let distance = |j: usize| squared_descriptor_distance(row, onto.descriptors.row(j));
    let own = distance(j);
    let probe = |k: usize| (k * onto.len() + onto.len() / 2) / DISTINCTIVENESS_PROBES;
    let as_alike = (0..DISTINCTIVENESS_PROBES).filter(|&k| distance(probe(k)) <= own).count();
    let share = (as_alike as f64 + 0.5) / (DISTINCTIVENESS_PROBES as f64 + 1.0);
    -share.ln() - 1.0
}
