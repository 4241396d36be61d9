//! Refinement of a pose with a scale on two surfaces.

use super::{NormalEquations, Surface, SurfacePair, surface_pairs, twist_row};
use crate::cloud::Transform;
use crate::math;

/// Number of steps. Chosen by hand.
const ITERATIONS: usize = 30;
/// Number of source points that are paired, spread evenly. Chosen by hand.
const MAX_POINTS: usize = 2000;
/// Fewest pairs for a solution. Chosen by hand.
const MIN_PAIRS: usize = 30;
/// Weight of the tangential residual relative to the normal residual: keeps planes from sliding.
/// Chosen by hand.
const TANGENTIAL_WEIGHT: f64 = 0.05;
/// Largest change of the logarithm of the scale in a step. Chosen by hand.
const MAX_STEP: f64 = 0.1;

/// Refines scale, rotation and translation of `pose`, local frame to local frame, on pairs at most
/// `max_distance` apart; `None` if there are too few pairs, or if they leave a motion
/// unconstrained.
pub(crate) fn refine_with_scale(
    surfaces: [&Surface; 2],
    pose: &Transform,
    max_distance: f64,
) -> Option<Transform> {
    let stride = surfaces[0].len().div_ceil(MAX_POINTS).max(1);
    let mut pose = *pose;
    for _ in 0..ITERATIONS {
        let pairs: Vec<SurfacePair> =
            surface_pairs(surfaces, &pose, max_distance, stride).map(|(.., pair)| pair).collect();
        if pairs.len() < MIN_PAIRS {
            return None;
        }
        let sum = pairs.iter().fold([0.0; 3], |sum, pair| math::add(sum, pair.point));
        let center = math::scaled(sum, 1.0 / pairs.len() as f64);
        let mut system = NormalEquations::<7>::ZERO;
        for pair in pairs {
            let arm = math::sub(pair.point, center);
            let mut add = |weight: f64, direction, residual| {
                let [a, b, c, x, y, z] = twist_row(arm, direction, max_distance);
                let row = [a, b, c, x, y, z, math::dot(arm, direction)];
                system.add_row(weight, &row, residual);
            };
            let normal = pair.mean_normal();
            add(pair.weight, normal, math::dot(normal, pair.residual));
            for axis in 0..3 {
                let mut direction = [0.0; 3];
                direction[axis] = 1.0;
                add(TANGENTIAL_WEIGHT * pair.weight, direction, pair.residual[axis]);
            }
        }
        let [a, b, c, x, y, z, growth] = system.solve(0.0)?;
        let turn = Transform::from_rotation_vector([a, b, c]);
        let scaled = Transform { scale: growth.clamp(-MAX_STEP, MAX_STEP).exp(), ..turn };
        let shift = math::add(math::scaled([x, y, z], max_distance), center);
        let moved = Transform { translation: math::sub(shift, scaled.apply(center)), ..scaled };
        pose = moved.after(&pose);
    }
    pose.scale.is_finite().then_some(pose)
}
