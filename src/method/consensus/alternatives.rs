//! Poses that could rival an answer: turned and shifted about what overlaps.
//!
//! A repeated or symmetric shape fits itself at several poses, and a search by correspondences need
//! not find them all: a corridor, stairs, racks, a gear, a box. Before a pose is accepted, the poses
//! that such shapes would have are tried on the surfaces.

use super::trial::{LocalScoredPose, ViewpointTrial, distinct_poses, sort_by_odds};
use super::{COARSE_REFINEMENT, Consensus, mean_displacement, probe_points};
use crate::cloud::Transform;
use crate::math::{self, Mat3, Vec3};
use crate::par;
use crate::surface::{INLIER_DISTANCE, MIN_NORMAL_COSINE, Surface, refine};

/// Number of points on which a proposed pose is first tried. Chosen by hand.
const QUICK_POINTS: usize = 120;
/// Number of source points that the frame of the overlap is made of. Chosen by hand.
const FRAME_POINTS: usize = 1000;
/// Share of the answer's overlap that a proposed pose needs to be refined. Chosen by hand.
const MIN_OVERLAP_SHARE: f64 = 0.4;
/// Number of proposed poses that are refined. Chosen by hand.
const REFINED_ALTERNATIVES: usize = 8;
/// Step of shifts along an axis, in voxels: a refinement bridges half of it. Chosen by hand.
const SHIFT_STEP: f64 = 2.0;
/// Fewest steps of a shift. Chosen by hand.
const MIN_SHIFTS: usize = 2;
/// Most steps of a shift. Chosen by hand.
const MAX_SHIFTS: usize = 40;
/// Angles of turns about an axis, in degrees: those of common symmetries. Chosen by hand.
const TURNS: [f64; 25] = [
    15.0, 30.0, 45.0, 60.0, 72.0, 75.0, 90.0, 105.0, 120.0, 135.0, 144.0, 150.0, 165.0, 180.0,
    195.0, 210.0, 216.0, 225.0, 240.0, 255.0, 270.0, 288.0, 300.0, 315.0, 330.0,
];
/// A shape is round about an axis if this share of the turns about it keeps this share of the
/// overlap. Chosen by hand.
const ROUND_SHARE: f64 = 0.75;
/// Number of turns about the axis of a round shape, among which the part that fixes it is looked for.
/// Chosen by hand.
const ROUND_TURNS: usize = 72;
/// Number of turned poses of a round shape that are refined. Chosen by hand.
const REFINED_ROUND: usize = 4;
/// Mean displacement from which on an alternative is a different pose, in voxel sizes: a refined pose
/// that stays so near has an optimum of its own. Chosen by hand.
const DISTINCT_ALTERNATIVE: f64 = 2.5;
/// Absolute cosine of the angle from which on two axes are one. Chosen by hand.
const SAME_AXIS: f64 = 0.98;

/// Axes and centres about which what overlaps may be symmetric.
struct OverlapFrame {
    /// Unit vectors in the target's frame.
    axes: Vec<Vec3>,
    /// Mean of the overlapping points.
    center: Vec3,
    /// For each axis a point on it, if the normals of the source have one: that to which the normals
    /// of a surface of revolution point.
    hubs: Vec<Option<Vec3>>,
    /// Extent of the source along each axis, in the unit of the coordinates.
    extents: Vec<f64>,
}

impl OverlapFrame {
    /// Returns `None` if fewer than three points overlap.
    fn new([source, target]: [&Surface; 2], pose: &Transform, voxel_size: f64) -> Option<Self> {
        let step = source.len().div_ceil(FRAME_POINTS).max(1);
        let all: Vec<(Vec3, Vec3)> = (0..source.len())
            .step_by(step)
            .map(|i| (pose.apply(source.point(i)), pose.rotate(source.normal(i))))
            .collect();
        let max_distance = INLIER_DISTANCE * voxel_size;
        let overlaps = |point: Vec3| target.nearest_within(point, max_distance).is_some();
        let on: Vec<&(Vec3, Vec3)> = all.iter().filter(|(point, _)| overlaps(*point)).collect();
        if on.len() < 3 {
            return None;
        }
        let sum = on.iter().fold([0.0; 3], |sum, (point, _)| math::add(sum, *point));
        let center = math::scaled(sum, 1.0 / on.len() as f64);
        let offsets = on.iter().map(|(point, _)| math::sub(*point, center));
        let by_normals = math::eigen::symmetric(&scatter(on.iter().map(|(_, normal)| *normal))).1;
        let by_points = math::eigen::symmetric(&scatter(offsets)).1;
        let mut axes: Vec<Vec3> = Vec::new();
        for axis in by_normals.into_iter().chain(by_points) {
            if axes.iter().all(|other| math::dot(*other, axis).abs() < SAME_AXIS) {
                axes.push(axis);
            }
        }
        let hubs = axes.iter().map(|&axis| hub(&all, axis, center)).collect();
        let extents = axes.iter().map(|&axis| {
            let along = || all.iter().map(|(point, _)| math::dot(*point, axis));
            along().fold(f64::MIN, f64::max) - along().fold(f64::MAX, f64::min)
        });
        Some(OverlapFrame { extents: extents.collect(), axes, center, hubs })
    }

    /// Axis and centre of each kind of turn.
    fn turns(&self) -> Vec<(Vec3, Vec3)> {
        let both = |(&axis, &hub): (&Vec3, &Option<Vec3>)| {
            [Some(self.center), hub].into_iter().flatten().map(move |center| (axis, center))
        };
        self.axes.iter().zip(&self.hubs).flat_map(both).collect()
    }

    /// Translations of the target's frame that may map what overlaps onto itself.
    fn translations(&self, voxel_size: f64) -> Vec<Transform> {
        let along = |(&axis, extent): (&Vec3, f64)| {
            let step = SHIFT_STEP * voxel_size;
            let last = ((extent / step) as usize).min(MAX_SHIFTS);
            (MIN_SHIFTS..=last).flat_map(move |n| [n as f64, -(n as f64)]).map(move |n| Transform {
                translation: math::scaled(axis, n * step),
                ..Transform::IDENTITY
            })
        };
        self.axes.iter().zip(self.extents.iter().copied()).flat_map(along).collect()
    }
}

/// Σ v vᵀ.
fn scatter(vectors: impl Iterator<Item = Vec3>) -> Mat3 {
    vectors.fold([[0.0; 3]; 3], |sum, v| {
        let product = math::outer(v, v);
        std::array::from_fn(|a| math::add(sum[a], product[a]))
    })
}

/// The point of a line along `axis` to which the normals of `all` points are nearest in the mean of
/// squares; `None` if they do not determine it.
fn hub(all: &[(Vec3, Vec3)], axis: Vec3, near: Vec3) -> Option<Vec3> {
    // (n × (p − c)) · axis = 0, that is (axis × n) · (p − c) = 0.
    let row = |normal: Vec3| math::cross(axis, normal);
    let (mut right, mut weight) = ([0.0; 3], 0.0);
    for (point, normal) in all {
        let row = row(*normal);
        let offset = math::dot(row, math::sub(*point, near));
        right = math::add(right, math::scaled(row, offset));
        weight += math::dot(row, row);
    }
    let (values, vectors) =
        math::eigen::symmetric(&scatter(all.iter().map(|(_, normal)| row(*normal))));
    // The axis itself is the direction of the smallest value.
    if values[1] < 0.1 * weight || weight < 0.05 * all.len() as f64 {
        return None;
    }
    let along = |k: usize| math::scaled(vectors[k], math::dot(vectors[k], right) / values[k]);
    Some(math::add(near, math::add(along(1), along(2))))
}

/// The turn about an axis through `center`.
fn turn(axis: Vec3, center: Vec3, degrees: f64) -> Transform {
    let turn = Transform::from_rotation_vector(math::scaled(axis, degrees.to_radians()));
    Transform { translation: math::sub(center, turn.rotate(center)), ..turn }
}

/// Share of some points of the source that are on the target and face the same way.
fn quick_overlap([source, target]: [&Surface; 2], pose: &Transform, voxel_size: f64) -> f64 {
    let step = source.len().div_ceil(QUICK_POINTS).max(1);
    let on = (0..source.len()).step_by(step).filter(|&i| {
        let near = target.nearest_within(pose.apply(source.point(i)), INLIER_DISTANCE * voxel_size);
        near.is_some_and(|near| {
            let normals = [pose.rotate(source.normal(i)), target.normal(near.index as usize)];
            math::dot(normals[0], normals[1]) > MIN_NORMAL_COSINE
        })
    });
    on.count() as f64 / source.len().div_ceil(step) as f64
}

impl Consensus {
    /// Returns poses that differ from `pose`, between local frames, and fit nearly as many points:
    /// `pose` turned and shifted about what overlaps, refined and scored, most probable first.
    pub(super) fn alternatives(
        &self,
        trial: &ViewpointTrial,
        pose: &Transform,
        voxel_size: f64,
    ) -> Vec<LocalScoredPose> {
        let surfaces = trial.surface_refs();
        let Some(frame) = OverlapFrame::new(surfaces, pose, voxel_size) else { return Vec::new() };
        let probes = probe_points(surfaces[0]);
        let moved = |motion: Transform| {
            let moved = motion.after(pose);
            self.prior.project_pose(&moved, probes[0]).unwrap_or(moved)
        };
        let overlap = |pose: &Transform| quick_overlap(surfaces, pose, voxel_size);
        let own = overlap(pose);
        let turns = frame.turns();
        let mut proposed: Vec<Transform> = turns
            .iter()
            .flat_map(|&(axis, center)| TURNS.map(|degrees| moved(turn(axis, center, degrees))))
            .chain(frame.translations(voxel_size).into_iter().map(moved))
            .collect();
        let overlaps = par::map(proposed.len(), || (), |_, i| overlap(&proposed[i]));
        let mut order: Vec<usize> =
            (0..proposed.len()).filter(|&i| overlaps[i] >= MIN_OVERLAP_SHARE * own).collect();
        order.sort_by(|&a, &b| overlaps[b].total_cmp(&overlaps[a]).then(a.cmp(&b)));
        let ranked = order.iter().map(|&i| proposed[i]);
        let mut distinct = distinct_poses(ranked, &probes, REFINED_ALTERNATIVES, voxel_size);
        for (k, &(axis, center)) in turns.iter().enumerate() {
            let kept = &overlaps[k * TURNS.len()..][..TURNS.len()];
            let keeping = kept.iter().filter(|&&kept| kept >= ROUND_SHARE * own).count();
            if own > 0.0 && keeping as f64 >= ROUND_SHARE * TURNS.len() as f64 {
                let degrees = |n: usize| 360.0 * n as f64 / ROUND_TURNS as f64;
                proposed =
                    (1..ROUND_TURNS).map(|n| moved(turn(axis, center, degrees(n)))).collect();
                let mut scored =
                    par::map(proposed.len(), || (), |_, i| trial.score(&proposed[i], self));
                sort_by_odds(&mut scored);
                let ranked = scored.iter().map(|scored| scored.pose);
                distinct.extend(distinct_poses(ranked, &probes, REFINED_ROUND, voxel_size));
            }
        }
        let max_distance = INLIER_DISTANCE * voxel_size;
        let refined = |pose: &Transform| {
            let pose = refine(surfaces, pose, max_distance, COARSE_REFINEMENT, &self.prior).pose;
            trial.score(&pose, self)
        };
        let mut found = par::map(distinct.len(), || (), |_, i| refined(&distinct[i]));
        found.retain(|other| {
            mean_displacement(&other.pose, pose, &probes) > DISTINCT_ALTERNATIVE * voxel_size
        });
        sort_by_odds(&mut found);
        found
    }
}
