//! The four closed forms solve the same problem and find the same answer.

use crate::common;

use cfreg::math::{self, Vec3};
use cfreg::moments::Moments;
use cfreg::pose::{self, ScaleEstimate, Solver};
use cfreg::{Error, Transform};
use common::compare::pose_difference;
use proptest::prelude::*;

/// Weighted pairs: mostly a moved cloud, blurred so that it is no exact fit.
fn problem() -> impl Strategy<Value = Moments> {
    let pair = (
        0.01..1.0f64,
        proptest::array::uniform3(-1.0..1.0f64),
        proptest::array::uniform3(-0.3..0.3f64),
    );
    let pairs = proptest::collection::vec(pair, 8..40);
    let vector = proptest::array::uniform3(-3.0..3.0f64);
    let shift = proptest::array::uniform3(-50.0..50.0f64);
    (pairs, vector, shift).prop_map(|(pairs, vector, shift)| {
        let truth = Transform { translation: shift, ..Transform::from_rotation_vector(vector) };
        let mut moments = Moments::about([0.3, -0.1, 0.2], truth.apply([0.0; 3]));
        for (weight, p, blur) in pairs {
            let q = math::add(truth.apply(math::add(p, moments.source_origin)), blur);
            moments.add_pair(weight, p, math::sub(q, moments.target_origin));
        }
        moments
    })
}

proptest! {
    #[test]
    fn they_agree(moments in problem()) {
        for scale in [ScaleEstimate::Fixed, ScaleEstimate::Umeyama, ScaleEstimate::Symmetric] {
            let arun = pose::solve(&moments, Solver::Arun, scale).unwrap().transform;
            for solver in Solver::ALL {
                let other = pose::solve(&moments, solver, scale).unwrap().transform;
                prop_assert!(pose_difference(&arun, &other) < 1e-9, "{solver} {scale}: {arun:?} {other:?}");
            }
        }
    }

    #[test]
    fn the_answer_is_a_rotation_and_a_minimum(
        moments in problem(),
        step in proptest::array::uniform6(-0.1..0.1f64),
    ) {
        for solver in Solver::ALL {
            let best = pose::solve(&moments, solver, ScaleEstimate::Fixed).unwrap().transform;
            let gram = math::mat_mul(&best.rotation, &math::transpose(&best.rotation));
            prop_assert!(math::frobenius(&math::mat_sub(&gram, &math::IDENTITY)) < 1e-12);
            prop_assert!((math::determinant(&best.rotation) - 1.0).abs() < 1e-12);
            let mut nudge = Transform::from_rotation_vector([step[0], step[1], step[2]]);
            nudge.translation = [step[3], step[4], step[5]];
            // Nudged about the target's centre, so that no nudge is huge.
            let center = Transform::rigid(math::IDENTITY, moments.target_origin);
            let nudge = center.after(&nudge).after(&center.inverse());
            prop_assert!(moments.residual(&best) <= moments.residual(&nudge.after(&best)) + 1e-9);
        }
    }

    #[test]
    fn exact_pairs_give_the_exact_pose_and_scale(
        points in proptest::collection::vec(proptest::array::uniform3(-1.0..1.0f64), 4..20),
        vector in proptest::array::uniform3(-1.7..1.7f64),
        scale in 0.1..10.0f64,
    ) {
        let truth = Transform { scale, translation: [3.0, -4.0, 5.0], ..Transform::from_rotation_vector(vector) };
        let mut moments = Moments::about([0.0; 3], [0.0; 3]);
        for p in points {
            moments.add_pair(1.0, p, truth.apply(p));
        }
        let estimates = [ScaleEstimate::Umeyama, ScaleEstimate::Symmetric];
        for (solver, estimate) in Solver::ALL.into_iter().flat_map(|s| estimates.map(|e| (s, e))) {
            let Ok(found) = pose::solve(&moments, solver, estimate) else { continue };
            prop_assume!(found.singular_values[1] > 1e-3);
            prop_assert!(pose_difference(&found.transform, &truth) < 1e-9, "{solver} {estimate}");
        }
    }
}

fn moments_of(pairs: &[(Vec3, Vec3)]) -> Moments {
    let mut moments = Moments::about([0.0; 3], [0.0; 3]);
    pairs.iter().for_each(|&(p, q)| moments.add_pair(1.0, p, q));
    moments
}

#[test]
fn a_mirror_image_gets_a_rotation() {
    // The best orthogonal matrix is a reflection in x: the rule must turn it into the
    // nearest rotation, and all four must turn it the same way.
    let points = [[0.1, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [-0.1, -1.0, 0.5]];
    let moments = moments_of(&points.map(|p| (p, [-p[0], p[1], p[2]])));
    let arun = pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed).unwrap().transform;
    assert!((math::determinant(&arun.rotation) - 1.0).abs() < 1e-12);
    for solver in Solver::ALL {
        let other = pose::solve(&moments, solver, ScaleEstimate::Fixed).unwrap().transform;
        assert!(pose_difference(&arun, &other) < 1e-9, "{solver}");
    }
}

#[test]
fn a_plane_is_enough_and_a_line_is_not() {
    let turn = Transform::from_rotation_vector([0.4, -0.2, 1.0]);
    let plane = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, -2.0, 0.0], [0.5, 0.5, 0.0]];
    let flat = moments_of(&plane.map(|p| (p, turn.apply(p))));
    for solver in Solver::ALL {
        let found = pose::solve(&flat, solver, ScaleEstimate::Fixed).unwrap();
        assert!(pose_difference(&found.transform, &turn) < 1e-9, "{solver}");
        assert!(found.singular_values[2] < 1e-12);
    }
    let line = [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [-1.0, -2.0, -3.0]];
    let thin = moments_of(&line.map(|p| (p, turn.apply(p))));
    let lump = moments_of(&[([1.0; 3], [2.0; 3]); 5]);
    for (moments, want) in [(thin, 1), (lump, 0)] {
        for solver in Solver::ALL {
            match pose::solve(&moments, solver, ScaleEstimate::Fixed) {
                Err(Error::Degenerate { rank, .. }) => assert_eq!(rank, want, "{solver}"),
                other => panic!("{solver}: {other:?}"),
            }
        }
    }
}

#[test]
fn tiny_and_huge_units_change_nothing() {
    let turn = Transform::from_rotation_vector([0.4, -0.2, 1.0]);
    let points = [[1.0, 0.2, 0.0], [0.0, 1.0, 0.3], [-1.0, -2.0, 0.7], [0.5, 0.5, -2.0]];
    for unit in [1e-12, 1e12] {
        let pairs = points.map(|p| (math::scaled(p, unit), turn.apply(math::scaled(p, unit))));
        for solver in Solver::ALL {
            let found = pose::solve(&moments_of(&pairs), solver, ScaleEstimate::Fixed).unwrap();
            let mut rest = found.transform;
            rest.translation = math::scaled(rest.translation, 1.0 / unit);
            assert!(pose_difference(&rest, &turn) < 1e-9, "{solver} {unit}");
        }
    }
}
