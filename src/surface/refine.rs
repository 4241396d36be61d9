//! Refinement of a pose on two surfaces: along the mean of both normals (Rusinkiewicz 2019),
//! weighted by distance and by the angle between the normals.

use super::{NormalEquations, Surface, surface_pairs, twist_row};
use crate::cloud::Transform;
use crate::math;
use crate::moments::Moments;
use crate::pose::Prior;

/// Weight of the tangential residual relative to the normal residual: keeps planes from sliding.
/// Chosen by hand.
const TANGENTIAL_WEIGHT: f64 = 0.05;
/// Fewest pairs for a solution. Chosen by hand.
const MIN_PAIRS: usize = 10;
/// First iterations, in which pairs may be twice as far apart. Chosen by hand.
const WIDE_ITERATIONS: usize = 3;

/// A refined pose, and the moments of its pairs.
#[derive(Clone, Copy)]
pub(crate) struct Refined {
    pub(crate) pose: Transform,
    pub(crate) moments: Moments,
    pub(crate) iterations: u32,
}

/// How many points are paired, and when the iterations end.
#[derive(Clone, Copy)]
pub(crate) struct RefineOptions {
    /// Number of source points that are paired, spread evenly.
    pub(crate) max_points: usize,
    pub(crate) max_iterations: u32,
    /// The iterations end at a translation below this share of the largest pair distance, with a
    /// rotation below a hundredth of this share, in radians.
    pub(crate) tolerance: f64,
}

/// Refines `start`, local frame to local frame, with pairs at most `max_distance` apart. After each
/// step the pose is projected to the nearest pose that `prior` allows.
pub(crate) fn refine(
    [source, target]: [&Surface; 2],
    start: &Transform,
    max_distance: f64,
    options: RefineOptions,
    prior: &Prior,
) -> Refined {
    let RefineOptions { max_points, max_iterations, tolerance } = options;
    let stride = source.len().div_ceil(max_points).max(1);
    let none = Moments::about(source.origin, target.origin);
    let mut refined = Refined { pose: *start, moments: none, iterations: 0 };
    for step in 0..max_iterations {
        let is_wide = (step as usize) < WIDE_ITERATIONS;
        let max_distance = if is_wide { 2.0 * max_distance } else { max_distance };
        let mut system = NormalEquations::<6>::ZERO;
        let (mut moments, mut pairs) = (none, 0);
        for (i, j, pair) in surface_pairs([source, target], &refined.pose, max_distance, stride) {
            let mut add = |weight, direction, residual| {
                system.add_row(weight, &twist_row(pair.point, direction, max_distance), residual);
            };
            let normal = pair.mean_normal();
            add(pair.weight, normal, math::dot(normal, pair.residual));
            for axis in 0..3 {
                let mut direction = [0.0; 3];
                direction[axis] = 1.0;
                add(TANGENTIAL_WEIGHT * pair.weight, direction, pair.residual[axis]);
            }
            moments.add_pair(pair.weight, source.point(i), target.point(j));
            pairs += 1;
        }
        if pairs < MIN_PAIRS {
            break;
        }
        let Some([a, b, c, x, y, z]) = system.solve(0.0) else { break };
        let shift = math::scaled([x, y, z], max_distance);
        let turn = Transform::from_rotation_vector([a, b, c]);
        let moved = Transform { translation: shift, ..turn };
        let center = math::scaled(moments.source_sum, 1.0 / moments.weight);
        let Ok(pose) = prior.project_pose(&moved.after(&refined.pose), center) else { break };
        refined = Refined { pose, moments, iterations: step + 1 };
        let is_settled = math::norm([a, b, c]) < 0.01 * tolerance
            && math::norm(shift) < tolerance * max_distance;
        if is_settled {
            break;
        }
    }
    refined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::PointCloud;

    const FULL: RefineOptions =
        RefineOptions { max_points: usize::MAX, max_iterations: 100, tolerance: 1e-4 };

    #[test]
    fn a_pose_near_the_surfaces_settles_on_them() {
        let bumps = |shift: f64| {
            let at = |i: usize| {
                let (x, y) = ((i % 60) as f64 + shift, (i / 60) as f64 + 0.7 * shift);
                [x, y, 4.0 * (0.2 * x).sin() + 3.0 * (0.15 * y + 0.1 * x).cos()]
            };
            Surface::of_cloud(
                &PointCloud::new(&(0..3600).map(at).collect::<Vec<_>>()).unwrap(),
                3.0,
            )
        };
        let surfaces = [bumps(0.0), bumps(0.4)];
        let surfaces = surfaces.each_ref();
        // The identity between the clouds' own frames, in local frames.
        let truth = Transform {
            translation: math::sub(surfaces[0].origin, surfaces[1].origin),
            ..Transform::IDENTITY
        };
        let turn = Transform::from_rotation_vector([0.02, -0.01, 0.02]);
        let start = Transform { translation: [0.5, -0.4, 0.6], ..turn }.after(&truth);
        let refined = refine(surfaces, &start, 1.5, FULL, &Prior::default());
        let off = truth.after(&refined.pose.inverse());
        // A fraction of the spacing of 1 at which both clouds sample the bumps.
        assert!(off.angle() < 2e-3 && math::norm(off.translation) < 0.2, "{off:?}");
        assert!(refined.moments.weight > 100.0 && refined.iterations > 2);
        // From far away nothing is paired: the pose is unchanged.
        let far = Transform { translation: [1e4, 0.0, 0.0], ..Transform::IDENTITY };
        let stays = refine(surfaces, &far, 1.5, FULL, &Prior::default());
        assert_eq!((stays.pose, stays.iterations), (far, 0));
    }
}
