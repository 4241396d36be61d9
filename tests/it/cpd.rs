//! Coherent Point Drift: what it finds, how the answer follows the clouds, where it fails.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::math::{Mat3, Vec3};
use cfreg::method::{Cpd, Refine, Register, Registration, StopReason};
use cfreg::pose::ScaleEstimate;
use cfreg::{Error, PointCloud, Transform, math, verify};
use common::compare::pose_difference;
use common::golden::read;
use proptest::prelude::*;
use serde::Deserialize;

fn pair(vector: [f64; 3], scale: f64) -> (PointCloud, PointCloud, Transform) {
    let truth = Transform {
        translation: [0.3, -0.2, 0.1],
        scale,
        ..Transform::from_rotation_vector(vector)
    };
    let target = boulder().sample(500, 2).unwrap().transformed(&truth).unwrap();
    (boulder().sample(600, 1).unwrap(), target, truth)
}

fn register(cpd: &Cpd, source: &PointCloud, target: &PointCloud) -> Registration {
    cpd.register(source, target).unwrap()
}

fn apart(a: &Transform, b: &Transform, source: &PointCloud) -> (f64, f64) {
    let error = verify::pose_error(a, b, source.centroid());
    (error.rotation_deg, error.translation)
}

#[test]
fn moderate_rotations_are_found() {
    let (source, target, truth) = pair([0.2, 0.3, -0.1], 1.0);
    for outliers in [0.0, 0.1, 0.5] {
        let found = register(&Cpd { outliers, ..Cpd::default() }, &source, &target);
        let (angle, shift) = apart(&found.transform, &truth, &source);
        assert!(angle < 5.0 && shift < 0.05, "{outliers}: {angle} {shift} {:?}", found.stop);
    }
}

#[test]
fn scale_is_found_when_asked_for() {
    let (source, target, truth) = pair([0.2, 0.1, -0.1], 1.3);
    let cpd = Cpd { scale: ScaleEstimate::Umeyama, ..Cpd::default() };
    let found = register(&cpd, &source, &target);
    assert!((found.transform.scale / truth.scale - 1.0).abs() < 0.03, "{}", found.transform.scale);
}

#[test]
fn identical_clouds_give_the_identity() {
    let (source, ..) = pair([0.0; 3], 1.0);
    for truncation in [0.0, 1e-7] {
        for outliers in [0.0, 0.1] {
            let cpd = Cpd { truncation, outliers, ..Cpd::default() };
            let found = register(&cpd, &source, &source);
            let (angle, shift) = apart(&found.transform, &Transform::IDENTITY, &source);
            assert!(angle < 1e-2 && shift < 1e-4, "{truncation} {outliers}: {angle} {shift}");
            assert!(found.trusted, "{:?} {:?}", found.stop, found.doubts);
        }
    }
}

#[test]
fn the_likelihood_never_falls() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1.0);
    let found = register(&Cpd { trace: true, ..Cpd::default() }, &source, &target);
    assert_eq!(found.trace.len(), found.iterations as usize);
    for step in found.trace.windows(2) {
        assert!(step[1].objective <= step[0].objective + 1e-5, "{step:?}");
    }
}

#[test]
fn search_and_tiles_give_the_same_pose() {
    let (source, target, _) = pair([0.1, 0.3, -0.1], 1.0);
    let [fast, exact] = [1e-7, 0.0]
        .map(|truncation| register(&Cpd { truncation, ..Cpd::default() }, &source, &target));
    let (angle, shift) = apart(&fast.transform, &exact.transform, &source);
    assert!(angle < 0.05 && shift < 1e-3, "{angle} {shift}");
}

#[test]
fn the_pose_follows_the_unit_and_a_map_offset() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1.0);
    let still = register(&Cpd::default(), &source, &target).transform;
    for unit in [1e-3, 1e4] {
        let change = Transform { scale: unit, ..Transform::IDENTITY };
        let clouds = [&source, &target].map(|cloud| cloud.transformed(&change).unwrap());
        let found = register(&Cpd::default(), &clouds[0], &clouds[1]).transform;
        let turned = math::frobenius(&math::mat_sub(&found.rotation, &still.rotation));
        assert!(turned < 1e-3, "{unit}: {turned}");
    }
    let far = Transform::rigid(math::IDENTITY, [5e5, 5.6e6, 0.0]);
    let clouds = [&source, &target].map(|cloud| cloud.transformed(&far).unwrap());
    let found = register(&Cpd::default(), &clouds[0], &clouds[1]).transform;
    let turned = math::frobenius(&math::mat_sub(&found.rotation, &still.rotation));
    assert!(turned < 1e-3, "{turned}");
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1.0);
    let run = |threads| {
        let found = register(&Cpd { threads, ..Cpd::default() }, &source, &target);
        (found.transform, found.moments)
    };
    let first = run(1);
    assert!([2, 3, 7].into_iter().all(|threads| run(threads) == first));
}

#[test]
fn large_rotations_fail_and_are_doubted() {
    for k in 0..16 {
        let t = f64::from(k);
        let axis = [(1.7 * t).sin(), (2.9 * t + 1.0).cos(), (0.6 * t + 2.0).sin()];
        let vector = math::scaled(math::normalized(axis), 2.2 + 0.06 * t);
        let (source, target, truth) = pair(vector, 1.0);
        for outliers in [0.0, 0.1] {
            let found = register(&Cpd { outliers, ..Cpd::default() }, &source, &target);
            let (angle, _) = apart(&found.transform, &truth, &source);
            assert!(angle > 20.0 && !found.trusted, "{k}: {angle} {:?}", found.evaluation);
        }
    }
}

#[test]
fn a_narrow_start_keeps_a_good_guess() {
    let (source, target, truth) = pair([0.0, 0.0, 3.0], 1.0);
    let cpd = Cpd { sigma: Some(0.1), ..Cpd::default() };
    let found = cpd.refine(&source, &target, &truth).unwrap();
    let (angle, _) = apart(&found.transform, &truth, &source);
    assert!(angle < 5.0 && found.stop != StopReason::IterationLimit, "{angle}");
}

#[test]
fn odd_clouds_are_refused() {
    let (source, ..) = pair([0.0; 3], 1.0);
    let cloud = |points: &[[f64; 3]]| PointCloud::new(points).unwrap();
    let few = cloud(&[[0.0; 3], [1.0; 3]]);
    for (a, b) in [(&few, &source), (&source, &few)] {
        assert!(matches!(Cpd::default().register(a, b), Err(Error::TooFewPoints { .. })));
    }
    let line: Vec<_> = (0..50).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    assert!(matches!(
        Cpd::default().register(&cloud(&line), &source),
        Err(Error::Degenerate { .. })
    ));
}

// --- Beside the reference --------------------------------------------------------------

#[derive(Deserialize)]
struct Given {
    source: Vec<Vec3>,
    target: Vec<Vec3>,
    runs: Vec<Run>,
}

#[derive(Deserialize)]
struct Run {
    outliers: f64,
    scale: ScaleEstimate,
    max_iterations: u32,
}

#[derive(Deserialize)]
struct Expected {
    sigma: f64,
    objective: f64,
    weight: f64,
    pose: Pose,
}

#[derive(Deserialize)]
struct Pose {
    scale: f64,
    rotation: Mat3,
    translation: Vec3,
}

#[test]
fn it_follows_the_reference_step_by_step() {
    let given: Given = read("cpd", "input");
    let expected: Vec<Vec<Expected>> = read("cpd", "expected");
    let [source, target] = [&given.source, &given.target].map(|p| PointCloud::new(p).unwrap());
    assert_eq!(given.runs.len(), expected.len());
    for (run, expected) in given.runs.iter().zip(&expected) {
        for truncation in [0.0, Cpd::default().truncation] {
            let cpd = Cpd {
                outliers: run.outliers,
                scale: run.scale,
                max_iterations: run.max_iterations,
                tolerance: 0.0,
                truncation,
                trace: true,
                ..Cpd::default()
            };
            let found = register(&cpd, &source, &target);
            assert_eq!(found.trace.len(), expected.len());
            for (step, want) in found.trace.iter().zip(expected) {
                let at = format!("{} {} {truncation} {}", run.outliers, run.scale, step.iteration);
                let sigma = step.bandwidth.unwrap() / want.sigma - 1.0;
                assert!(sigma.abs() < 2e-6, "{at}: sigma off by {sigma:e}");
                let objective = step.objective - want.objective;
                assert!(objective.abs() < 2e-6, "{at}: objective off by {objective:e}");
                let weight = step.weight / want.weight - 1.0;
                assert!(weight.abs() < 2e-6, "{at}: weight off by {weight:e}");
                let Pose { scale, rotation, translation } = want.pose;
                let pose = Transform { rotation, translation, scale };
                let pose = pose_difference(&step.transform, &pose);
                assert!(pose < 5e-6, "{at}: pose off by {pose:e}");
            }
        }
    }
}

// --- Invariances -----------------------------------------------------------------------

/// So many steps that rounding decides nothing.
fn steps(scale: ScaleEstimate) -> Cpd {
    Cpd { tolerance: 0.0, max_iterations: 25, scale, ..Cpd::default() }
}

fn start() -> Transform {
    Transform { translation: [0.2, -0.1, 0.1], ..Transform::from_rotation_vector([0.1, 0.2, 0.0]) }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn the_pose_follows_a_rigid_motion_of_either_cloud(
        vector in proptest::array::uniform3(-3.0..3.0f64),
        translation in proptest::array::uniform3(-5.0..5.0f64),
        scaled in any::<bool>(),
    ) {
        let cpd = steps(if scaled { ScaleEstimate::Umeyama } else { ScaleEstimate::Fixed });
        let (source, target, _) = pair([0.2, 0.3, -0.1], 1.0);
        let refine = |a: &PointCloud, b: &PointCloud, initial: Transform| {
            cpd.refine(a, b, &initial).unwrap().transform
        };
        let still = refine(&source, &target, start());
        let change = Transform { translation, ..Transform::from_rotation_vector(vector) };
        let moved = target.transformed(&change).unwrap();
        let found = change.inverse().after(&refine(&source, &moved, change.after(&start())));
        let off = pose_difference(&found, &still);
        prop_assert!(off < 2e-5, "target moved: {off:e}");
        let moved = source.transformed(&change).unwrap();
        let found = refine(&moved, &target, start().after(&change.inverse())).after(&change);
        let off = pose_difference(&found, &still);
        prop_assert!(off < 2e-5, "source moved: {off:e}");
    }
}

#[test]
fn the_order_of_points_does_not_matter() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1.0);
    let order = |n: usize| (0..n).map(|i| (i * 77 + 13) % n).collect::<Vec<_>>();
    let shuffled = [&source, &target].map(|cloud| cloud.select(&order(cloud.len())));
    for scale in [ScaleEstimate::Fixed, ScaleEstimate::Umeyama] {
        let still = register(&steps(scale), &source, &target).transform;
        for (a, b) in [(&shuffled[0], &target), (&source, &shuffled[1])] {
            let off = pose_difference(&register(&steps(scale), a, b).transform, &still);
            assert!(off < 2e-6, "{scale}: {off:e}");
        }
    }
}

#[test]
fn a_unit_of_a_power_of_two_changes_no_bit() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1.0);
    let still = register(&Cpd::default(), &source, &target).transform;
    for unit in [1.0 / 1024.0, 4096.0] {
        let scaled = |cloud: &PointCloud| {
            let points: Vec<_> = cloud.positions().map(|p| math::scaled(p, unit)).collect();
            PointCloud::new(&points).unwrap()
        };
        let found = register(&Cpd::default(), &scaled(&source), &scaled(&target)).transform;
        assert_eq!(found.rotation, still.rotation, "{unit}");
        assert_eq!(found.translation, math::scaled(still.translation, unit), "{unit}");
    }
}
