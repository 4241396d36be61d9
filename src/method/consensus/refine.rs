//! A pose made exact on the surfaces: along the mean of both normals (Rusinkiewicz 2019),
//! weighed by nearness and facing.

use super::scan::Surface;
use crate::cloud::Transform;
use crate::math::cholesky::{self, Mat6, Vec6};
use crate::math::{self, Vec3};
use crate::moments::Moments;
use crate::pose::Prior;
use crate::quality::{PoseCovariance, SurfacePair};

/// Cosine of the angle between normals above which points are paired, whichever way they face.
const MIN_NORMAL_COSINE: f64 = 0.7;
/// Weight of the distance along the surface beside that across it: keeps planes from sliding.
const TANGENTIAL_WEIGHT: f64 = 0.05;
/// Pairs below which nothing is solved.
const MIN_PAIRS: usize = 10;
/// Steps during which pairs may be twice as far apart.
const WIDE_ITERATIONS: usize = 3;

/// A pose at rest, and the moments of the pairs it rests on.
#[derive(Clone, Copy)]
pub(super) struct Refined {
    pub(super) pose: Transform,
    pub(super) moments: Moments,
    pub(super) iterations: u32,
}

/// How long to go on.
#[derive(Clone, Copy)]
pub(super) struct RefineOptions {
    /// Points of the source that are looked at, spread evenly.
    pub(super) max_points: usize,
    /// Most steps.
    pub(super) max_iterations: u32,
    /// Shift, as a share of the pairs' reach, below which a step is rest; a hundredth of it for
    /// the turn, in radians.
    pub(super) tolerance: f64,
}

/// Moves the pose `start`, local frame to local frame, until it rests; pairs are at most `reach`
/// apart. After each step the pose is the nearest that `prior` allows.
pub(super) fn refine(
    [source, target]: [&Surface; 2],
    start: &Transform,
    reach: f64,
    RefineOptions { max_points: most, max_iterations: steps, tolerance: rest }: RefineOptions,
    prior: &Prior,
) -> Refined {
    let stride = source.len().div_ceil(most).max(1);
    let none = Moments::about(source.origin, target.origin);
    let mut settled = Refined { pose: *start, moments: none, iterations: 0 };
    for step in 0..steps {
        let reach = if (step as usize) < WIDE_ITERATIONS { 2.0 * reach } else { reach };
        let mut system =
            RefinementSystem { hessian: [[0.0; 6]; 6], gradient: [0.0; 6], length_scale: reach };
        let (mut moments, mut pairs) = (none, 0);
        for (i, j, contact) in surface_pairs([source, target], &settled.pose, reach, stride) {
            let SurfacePair { weight, point: place, residual: offset, .. } = contact;
            system.add(weight, place, contact.mean_normal(), offset);
            moments.add_pair(weight, source.point(i), target.point(j));
            pairs += 1;
        }
        if pairs < MIN_PAIRS {
            break;
        }
        let Some(factor) = cholesky::factor(&system.hessian) else { break };
        let [a, b, c, x, y, z] = cholesky::solve(&factor, &system.gradient);
        let shift = math::scaled([x, y, z], reach);
        let turn = Transform::from_rotation_vector([a, b, c]);
        let moved = Transform { translation: shift, ..turn };
        let center = math::scaled(moments.source_sum, 1.0 / moments.weight);
        let Ok(pose) = prior.project_pose(&moved.after(&settled.pose), center) else { break };
        settled = Refined { pose, moments, iterations: step + 1 };
        if math::norm([a, b, c]) < 0.01 * rest && math::norm(shift) < rest * reach {
            break;
        }
    }
    settled
}

/// Points of the source that lie on the target under `pose`: their rows, and the contact.
pub(super) fn surface_pairs<'a>(
    [source, target]: [&'a Surface; 2],
    pose: &'a Transform,
    reach: f64,
    stride: usize,
) -> impl Iterator<Item = (usize, usize, SurfacePair)> + 'a {
    (0..source.len()).step_by(stride).filter_map(move |i| {
        let place = pose.apply(source.point(i));
        let near = target.nearest(place)?;
        let far = f64::from(near.squared_distance) / (reach * reach);
        let j = near.index as usize;
        let normals = [pose.rotate(source.normal(i)), target.normal(j)];
        let facing = math::dot(normals[0], normals[1]).abs();
        if far >= 1.0 || facing < MIN_NORMAL_COSINE {
            return None;
        }
        let weight = facing * (1.0 - far) * (1.0 - far) * source.weight(i) * target.weight(j);
        if weight <= 0.0 {
            return None;
        }
        let offset = math::sub(place, target.point(j));
        Some((i, j, SurfacePair { weight, point: place, residual: offset, normals }))
    })
}

/// How far a settled `pose` may be off, if it is the right one.
pub(super) fn estimate_covariance(
    ends: [&Surface; 2],
    pose: &Transform,
    reach: f64,
    length: f64,
) -> Option<PoseCovariance> {
    let under = |pose: &Transform, most: usize| -> Vec<SurfacePair> {
        let stride = ends[0].len().div_ceil(most).max(1);
        surface_pairs(ends, pose, reach, stride).map(|(.., contact)| contact).collect()
    };
    PoseCovariance::estimate(under, pose, ends[1].origin, length)
}

/// Normal equations of a motion: a rotation vector, and a translation in units.
struct RefinementSystem {
    hessian: Mat6,
    gradient: Vec6,
    length_scale: f64,
}

impl RefinementSystem {
    fn add(&mut self, weight: f64, place: Vec3, normal: Vec3, off: Vec3) {
        self.add_direction(weight, place, normal, math::dot(normal, off));
        for axis in 0..3 {
            let mut direction = [0.0; 3];
            direction[axis] = 1.0;
            self.add_direction(TANGENTIAL_WEIGHT * weight, place, direction, off[axis]);
        }
    }

    fn add_direction(&mut self, weight: f64, place: Vec3, direction: Vec3, off: f64) {
        let [a, b, c] = math::cross(place, direction);
        let [x, y, z] = math::scaled(direction, self.length_scale);
        let row = [a, b, c, x, y, z];
        for u in 0..6 {
            self.gradient[u] -= weight * row[u] * off;
            (0..6).for_each(|v| self.hessian[u][v] += weight * row[u] * row[v]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::filtered_cloud::FilteredCloud;
    use super::super::scan::{Scan, ViewpointHypothesis};
    use super::*;
    use crate::cloud::PointCloud;

    const FULL_REFINEMENT: RefineOptions =
        RefineOptions { max_points: usize::MAX, max_iterations: 100, tolerance: 1e-4 };

    #[test]
    fn a_pose_near_the_surfaces_settles_on_them() {
        let bumps = |shift: f64| {
            let at = |i: usize| {
                let (x, y) = ((i % 60) as f64 + shift, (i / 60) as f64 + 0.7 * shift);
                [x, y, 4.0 * (0.2 * x).sin() + 3.0 * (0.15 * y + 0.1 * x).cos()]
            };
            PointCloud::new(&(0..3600).map(at).collect::<Vec<_>>()).unwrap()
        };
        let (source, target) = (bumps(0.0), bumps(0.4));
        let surface = |cloud: &PointCloud| {
            let whole = FilteredCloud::new(cloud.into(), true, false).unwrap();
            Scan::new(whole, 1.0, &[], "it").unwrap().surface(ViewpointHypothesis::Outward).unwrap()
        };
        let (source, target) = (surface(&source), surface(&target));
        let ends = [&*source, &*target];
        // The identity between the clouds' own frames, in local ones.
        let truth = Transform {
            translation: math::sub(ends[0].origin, ends[1].origin),
            ..Transform::IDENTITY
        };
        let turn = Transform::from_rotation_vector([0.02, -0.01, 0.02]);
        let start = Transform { translation: [0.5, -0.4, 0.6], ..turn }.after(&truth);
        let settled = refine(ends, &start, 1.5, FULL_REFINEMENT, &Prior::default());
        let off = truth.after(&settled.pose.inverse());
        // A part of the spacing of 1, at which both sample the bumps.
        assert!(off.angle() < 2e-3 && math::norm(off.translation) < 0.2, "{off:?}");
        assert!(settled.moments.weight > 100.0 && settled.iterations > 2);
        // From far away nothing is paired: the pose stays.
        let far = Transform { translation: [1e4, 0.0, 0.0], ..Transform::IDENTITY };
        let stays = refine(ends, &far, 1.5, FULL_REFINEMENT, &Prior::default());
        assert_eq!((stays.pose, stays.iterations), (far, 0));
    }
}
