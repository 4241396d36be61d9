//! Results satisfy the prior, and no allowed pose is better.

use super::*;
use crate::moments::Moments;
use crate::pose::{Solver, solve, solve_with};
use proptest::prelude::*;

fn moments(pairs: &[[f64; 6]]) -> Moments {
    let mut moments = Moments::about([0.0; 3], [0.0; 3]);
    for &[a, b, c, x, y, z] in pairs {
        moments.add_pair(1.0, [a, b, c], [x, y, z]);
    }
    moments
}

fn turn(vector: Vec3) -> Mat3 {
    Transform::from_rotation_vector(vector).rotation
}

/// Residual of the best translation for a rotation.
fn residual(moments: &Moments, rotation: Mat3) -> f64 {
    let centered = moments.centered().unwrap();
    let turned = math::mat_vec(&rotation, centered.source_mean);
    let translation = math::sub(centered.target_mean, turned);
    moments.residual(&Transform::rigid(rotation, translation))
}

fn pairs() -> impl Strategy<Value = Vec<[f64; 6]>> {
    proptest::collection::vec(proptest::array::uniform6(-1.0..1.0f64), 4..12)
}

fn vector() -> impl Strategy<Value = Vec3> {
    proptest::array::uniform3(-1.7..1.7f64)
}

proptest! {
    #[test]
    fn a_known_direction_is_kept_and_no_other_turn_about_it_is_better(
        pairs in pairs(), from in vector(), to in vector(), other in 0.0..6.3f64,
    ) {
        prop_assume!(math::norm(from) > 0.1 && math::norm(to) > 0.1);
        let moments = moments(&pairs);
        let prior = Prior { direction: Some([from, to]), ..Prior::default() };
        let found = solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, &prior).unwrap();
        let rotation = found.transform.rotation;
        let (from, to) = (math::normalized(from), math::normalized(to));
        prop_assert!(math::norm(math::sub(math::mat_vec(&rotation, from), to)) < 1e-12);
        let turned = math::mat_mul(&turn(math::scaled(to, other)), &rotation);
        prop_assert!(moments.residual(&found.transform) <= residual(&moments, turned) + 1e-9);
    }

    #[test]
    fn no_rotation_within_the_angle_is_better(
        pairs in pairs(), center in vector(), degrees in 1.0..170.0f64,
        other in vector(), share in 0.0..1.0f64,
    ) {
        prop_assume!(math::norm(other) > 0.1);
        let moments = moments(&pairs);
        let near = RotationBound { vector: center, within_deg: degrees };
        let prior = Prior { rotation: Some(near), ..Prior::default() };
        let found = solve_with(&moments, Solver::Walker, ScaleEstimate::Fixed, &prior).unwrap();
        let rotation = found.transform.rotation;
        let angle = |rotation: &Mat3| {
            let off = math::mat_mul(rotation, &math::transpose(&turn(center)));
            Transform::rigid(off, [0.0; 3]).angle().to_degrees()
        };
        prop_assert!(angle(&rotation) <= degrees + 1e-6, "{} {degrees}", angle(&rotation));
        let moved = |by: f64, from: &Mat3| {
            math::mat_mul(&turn(math::scaled(math::normalized(other), by)), from)
        };
        // A random allowed rotation, and rotations near the result, the closest competitors.
        let allowed = moved(share * degrees.to_radians(), &turn(center));
        let beside = [-0.02, -0.002, 0.002, 0.02].map(|by| moved(by, &rotation));
        for other in beside.into_iter().filter(|other| angle(other) <= degrees).chain([allowed]) {
            prop_assert!(moments.residual(&found.transform) <= residual(&moments, other) + 1e-9);
        }
    }

    #[test]
    fn both_together_hold(
        pairs in pairs(), center in vector(), degrees in 1.0..170.0f64, axis in vector(),
        share in -1.0..1.0f64,
    ) {
        prop_assume!(math::norm(axis) > 0.1);
        let moments = moments(&pairs);
        // The known rotation maps the direction itself: rotations about it up to the angle.
        let image = math::mat_vec(&turn(center), axis);
        let near = RotationBound { vector: center, within_deg: degrees };
        let prior =
            Prior { direction: Some([axis, image]), rotation: Some(near), scale: None };
        let found = solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, &prior).unwrap();
        let rotation = found.transform.rotation;
        let off = math::mat_mul(&rotation, &math::transpose(&turn(center)));
        let angle = Transform::rigid(off, [0.0; 3]).angle().to_degrees();
        prop_assert!(angle <= degrees + 1e-6);
        prop_assert!(math::norm(math::sub(math::mat_vec(&rotation, axis), image)) < 1e-9);
        let step = math::scaled(math::normalized(image), share * degrees.to_radians());
        let allowed = math::mat_mul(&turn(step), &turn(center));
        prop_assert!(moments.residual(&found.transform) <= residual(&moments, allowed) + 1e-9);
    }

    #[test]
    fn a_scale_within_bounds_is_the_best_of_them(
        pairs in pairs(), low in 0.2..1.0f64, more in 0.0..2.0f64, share in 0.0..1.0f64,
    ) {
        let moments = moments(&pairs);
        let prior = Prior { scale: Some([low, low + more]), ..Prior::default() };
        let found = solve_with(&moments, Solver::Arun, ScaleEstimate::Umeyama, &prior).unwrap();
        let pose = found.transform;
        prop_assert!((low..=low + more).contains(&pose.scale));
        let scale = low + share * more;
        let centered = moments.centered().unwrap();
        let turned = math::scaled(pose.rotate(centered.source_mean), scale);
        let translation = math::sub(centered.target_mean, turned);
        let other = Transform { rotation: pose.rotation, translation, scale };
        prop_assert!(moments.residual(&pose) <= moments.residual(&other) + 1e-9);
    }
}

fn some() -> Moments {
    moments(&[
        [1.0, 0.0, 0.2, 0.9, 0.1, 0.2],
        [0.0, 2.0, 0.1, -0.2, 2.0, 0.1],
        [0.3, 0.1, 3.0, 0.3, 0.4, 2.9],
        [-1.0, -1.0, 0.5, -1.1, -0.9, 0.4],
    ])
}

#[test]
fn nothing_known_changes_no_bit() {
    let moments = some();
    for solver in Solver::ALL {
        let plain = solve(&moments, solver, ScaleEstimate::Umeyama).unwrap();
        let prior = Prior::default();
        let with = solve_with(&moments, solver, ScaleEstimate::Umeyama, &prior).unwrap();
        assert_eq!(plain, with);
        // An inactive bound changes nothing, either.
        let near = RotationBound { vector: [0.0; 3], within_deg: 180.0 };
        let wide = Prior { rotation: Some(near), ..prior };
        let with = solve_with(&moments, solver, ScaleEstimate::Umeyama, &wide).unwrap();
        assert_eq!(plain.transform.rotation, with.transform.rotation);
    }
}

#[test]
fn a_known_rotation_leaves_the_translation() {
    let near = RotationBound { vector: [0.1, -0.2, 0.3], within_deg: 0.0 };
    let prior = Prior { rotation: Some(near), ..Prior::default() };
    // The same position twice constrains no rotation.
    let mut moments = Moments::about([0.0; 3], [0.0; 3]);
    moments.add_pair(1.0, [1.0, 2.0, 3.0], [4.0, 4.0, 4.0]);
    let found = solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, &prior).unwrap();
    assert_eq!(found.transform.rotation, turn(near.vector));
    let off = math::sub(found.transform.apply([1.0, 2.0, 3.0]), [4.0; 3]);
    assert!(math::norm(off) < 1e-12);
}

#[test]
fn what_contradicts_or_is_out_of_range_says_so() {
    let solve = |prior: Prior| {
        solve_with(&some(), Solver::Arun, ScaleEstimate::Umeyama, &prior).unwrap_err()
    };
    let near = |degrees: f64| RotationBound { vector: [0.0; 3], within_deg: degrees };
    let across = Some([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
    for prior in [
        Prior { direction: across, rotation: Some(near(30.0)), scale: None },
        Prior { direction: Some([[0.0; 3], [1.0, 0.0, 0.0]]), ..Prior::default() },
        Prior { direction: Some([[f64::NAN, 0.0, 0.0], [1.0; 3]]), ..Prior::default() },
        Prior { rotation: Some(near(-1.0)), ..Prior::default() },
        Prior { rotation: Some(near(f64::NAN)), ..Prior::default() },
        Prior { scale: Some([2.0, 1.0]), ..Prior::default() },
        Prior { scale: Some([0.0, 1.0]), ..Prior::default() },
    ] {
        let error = solve(prior);
        assert!(matches!(error, Error::Config { field: "prior", .. }), "{error}");
    }
    // A scale can be bounded only if it is estimated.
    let bounded = Prior { scale: Some([0.5, 2.0]), ..Prior::default() };
    let fixed = solve_with(&some(), Solver::Arun, ScaleEstimate::Fixed, &bounded);
    assert!(matches!(fixed, Err(Error::Config { field: "prior", .. })));
    // Points along the axis alone leave the rotation about it unconstrained.
    let line = moments(&[[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, 0.0, 0.0, -1.0]]);
    let upright = Prior { direction: Some([[0.0, 0.0, 1.0]; 2]), ..Prior::default() };
    let open = solve_with(&line, Solver::Arun, ScaleEstimate::Fixed, &upright);
    assert!(matches!(open, Err(Error::Degenerate { .. })));
}

#[test]
fn opposite_directions_and_bounds_at_a_half_turn() {
    let opposite =
        Prior { direction: Some([[0.0, 0.0, 1.0], [0.0, 0.0, -2.0]]), ..Prior::default() };
    let found = solve_with(&some(), Solver::Arun, ScaleEstimate::Fixed, &opposite).unwrap();
    let down = math::mat_vec(&found.transform.rotation, [0.0, 0.0, 1.0]);
    assert!(math::norm(math::sub(down, [0.0, 0.0, -1.0])) < 1e-12);
    // The best rotation is half a turn away about an axis of symmetry: both directions are equal.
    let pairs = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];
    let half = pairs.map(|[x, y, z]| [x, y, z, -x, -y, z]);
    let near = RotationBound { vector: [0.0; 3], within_deg: 60.0 };
    let prior = Prior { rotation: Some(near), ..Prior::default() };
    let found = solve_with(&moments(&half), Solver::Arun, ScaleEstimate::Fixed, &prior).unwrap();
    assert!((found.transform.angle().to_degrees() - 60.0).abs() < 1e-6, "{found:?}");
}
