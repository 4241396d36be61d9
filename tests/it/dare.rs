//! DARE: the EM of the paper step by step, what it finds, how the answer follows the
//! clouds, where it fails.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::math::{Mat3, Vec3};
use cfreg::method::{Dare, Refine, Register, Registration, StopReason};
use cfreg::pose::{Prior, RotationBound};
use cfreg::verify::Warning;
use cfreg::{Error, PointCloud, Transform, math, verify};
use common::compare::pose_difference;
use common::golden;
use common::scans::real_pairs;
use proptest::prelude::*;
use serde::Deserialize;

#[derive(Deserialize)]
struct Given {
    source: Vec<Vec3>,
    target: Vec<Vec3>,
    iterations: u32,
    runs: Vec<Dare>,
}

#[derive(Deserialize)]
struct Expected {
    runs: Vec<Vec<ExpectedStep>>,
}

#[derive(Deserialize)]
struct ExpectedStep {
    rotation: Mat3,
    translation: Vec3,
    log_likelihood: f64,
    weight: f64,
    sigma: f64,
}

#[test]
fn every_step_is_the_references() {
    let given: Given = golden::read("dare", "input");
    let expected: Expected = golden::read("dare", "expected");
    let [source, target] = [given.source, given.target].map(|p| PointCloud::new(&p).unwrap());
    assert_eq!(given.runs.len(), expected.runs.len());
    for (settings, steps) in given.runs.into_iter().zip(expected.runs) {
        let max_iterations = given.iterations;
        let dare = Dare { max_iterations, tolerance: 0.0, trace: true, ..settings };
        let found = dare.register(&source, &target).unwrap();
        assert_eq!(found.trace.len(), steps.len(), "{:?}", found.method);
        for (step, expected) in found.trace.iter().zip(steps) {
            let ExpectedStep { rotation, translation, .. } = expected;
            let pose = pose_difference(&step.transform, &Transform::rigid(rotation, translation));
            let likelihood = (step.objective - expected.log_likelihood).abs();
            let weight = (step.weight - expected.weight).abs();
            let sigma = (step.bandwidth.unwrap() - expected.sigma).abs();
            // The crate's kernel is f32, and a step hands its error to the next.
            let worst = pose.max(likelihood).max(weight).max(sigma);
            assert!(worst < 2e-5, "{}: {pose} {likelihood} {weight} {sigma}", step.iteration);
        }
    }
}

/// Two independent samples of one shape, `vector` apart.
fn pair(vector: Vec3, seed: u64) -> (PointCloud, PointCloud, Transform) {
    let rotation = Transform::from_rotation_vector(vector);
    let truth = Transform { translation: [0.3, -0.2, 0.1], ..rotation };
    let source = boulder().sample(600, 2 * seed + 1).unwrap();
    let target = boulder().sample(500, 2 * seed).unwrap().transformed(&truth).unwrap();
    (source, target, truth)
}

fn dare() -> Dare {
    Dare { components: Some(60), ..Dare::default() }
}

fn register(dare: &Dare, source: &PointCloud, target: &PointCloud) -> Registration {
    dare.register(source, target).unwrap()
}

/// Degrees, and the unit of the clouds.
fn apart(a: &Transform, b: &Transform, source: &PointCloud) -> (f64, f64) {
    let error = verify::pose_error(a, b, source.centroid());
    (error.rotation_deg, error.translation)
}

#[test]
fn moderate_rotations_are_found_with_every_setting() {
    let (source, target, truth) = pair([0.2, 0.3, -0.1], 1);
    for settings in [
        Dare::default(),
        Dare { components: Some(30), ..Dare::default() },
        Dare { density_neighbors: 0, ..dare() },
        Dare { density_neighbors: 30, ..dare() },
        Dare { outlier_ratio: 0.2, ..dare() },
        Dare { initial_sigma: 1.0, ..dare() },
        Dare { min_sigma: 0.02, ..dare() },
    ] {
        let found = register(&settings, &source, &target);
        let (angle, shift) = apart(&found.transform, &truth, &source);
        // From 21 degrees, nearly round, sampled afresh: the samples' noise is left.
        assert!(angle < 10.0 && shift < 0.05, "{settings:?}: {angle} {shift} {:?}", found.stop);
    }
}

#[test]
fn identical_clouds_give_the_identity() {
    let (source, ..) = pair([0.0; 3], 1);
    let found = register(&dare(), &source, &source);
    let (angle, shift) = apart(&found.transform, &Transform::IDENTITY, &source);
    assert!(angle < 1e-3 && shift < 1e-5, "{angle} {shift}");
    assert!(found.trusted && found.stop == StopReason::ObjectiveSettled, "{:?}", found.doubts);
}

/// The first pair of these data sets, 10 degrees off about the target's centroid.
#[test]
fn real_scans_are_refined() {
    let Some(data) = common::shared_data() else { return };
    let pairs = real_pairs(&data, 1000, 2000);
    // What one bunny scan shows and the other does not pulls: some degrees are left.
    for (set, most) in [("stanford_bunny", 5.0), ("kitti00", 1.5)] {
        let pair = pairs.iter().find(|pair| pair.name.starts_with(set)).unwrap();
        let center = pair.target.centroid();
        let turn = Transform::from_rotation_vector([0.1, 0.1, 0.1]);
        let to_center = Transform::rigid(math::IDENTITY, center);
        let off = to_center.after(&turn).after(&to_center.inverse());
        let initial = off.after(&pair.truth);
        let found = Dare::default().refine(&pair.source, &pair.target, &initial).unwrap();
        let (angle, shift) = apart(&found.transform, &pair.truth, &pair.source);
        let shift = shift / pair.source.diagonal();
        println!("{}: {angle:.2} deg, {shift:.4} of the size, {:?}", pair.name, found.doubts);
        assert!(angle < most && shift < 0.02, "{}: {angle} {shift}", pair.name);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    // Up to rounding: the sums are f32 over 32 points.
    #[test]
    fn the_likelihood_never_falls(
        vector in proptest::array::uniform3(-2.0..2.0f64), seed in 0..100u64,
        density_neighbors in prop_oneof![Just(0), 3..30usize], outlier_ratio in 1e-4..0.5f64,
        known in 0..4,
    ) {
        let (source, target, _) = pair(vector, seed);
        let near = RotationBound { vector: [0.3, -0.2, 0.1], within_deg: 30.0 };
        let prior = Prior {
            direction: Some([[0.0, 0.0, 1.0]; 2]).filter(|_| known & 1 > 0),
            rotation: Some(near).filter(|_| known & 2 > 0),
            ..Prior::default()
        };
        let settings = Dare { trace: true, density_neighbors, outlier_ratio, prior, ..dare() };
        let found = register(&settings, &source, &target);
        prop_assert_eq!(found.trace.len(), found.iterations as usize);
        for step in found.trace.windows(2) {
            prop_assert!(step[1].objective >= step[0].objective - 1e-5, "{:?}", step);
        }
    }

    // f32 coordinates of a moved cloud differ in their last bits, and EM amplifies.
    #[test]
    fn the_pose_follows_motions_of_either_cloud(
        first in proptest::array::uniform3(-3.0..3.0f64), shift in proptest::array::uniform3(-9.0..9.0f64),
        seed in 0..100u64,
    ) {
        let (source, target, _) = pair([0.2, 0.3, -0.1], seed);
        let motion = Transform { translation: shift, ..Transform::from_rotation_vector(first) };
        let still = register(&dare(), &source, &target).transform;
        let moved = target.transformed(&motion).unwrap();
        let found = dare().refine(&source, &moved, &motion).unwrap().transform;
        let (angle, shift) = apart(&found, &motion.after(&still), &source);
        prop_assert!(angle < TURN && shift < SHIFT, "target: {angle} {shift}");
        let moved = source.transformed(&motion).unwrap();
        let found = dare().refine(&moved, &target, &motion.inverse()).unwrap().transform;
        let (angle, shift) = apart(&found.after(&motion), &still, &source);
        prop_assert!(angle < TURN && shift < SHIFT, "source: {angle} {shift}");
    }
}

/// What rounding of the input leaves after some hundred steps: degrees, and the unit of
/// clouds that are two units wide.
const TURN: f64 = 0.05;
const SHIFT: f64 = 1e-3;

#[test]
fn the_order_of_the_points_does_not_matter() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1);
    let still = register(&dare(), &source, &target).transform;
    let shuffled = |cloud: &PointCloud, step: usize| {
        let n = cloud.len();
        let points: Vec<Vec3> = (0..n).map(|i| cloud.position((i * step + 5) % n)).collect();
        PointCloud::new(&points).unwrap()
    };
    // Steps prime to 600 and 500: every point once.
    let found = register(&dare(), &shuffled(&source, 7), &shuffled(&target, 9)).transform;
    let (angle, shift) = apart(&found, &still, &source);
    assert!(angle < TURN && shift < SHIFT, "{angle} {shift}");
}

#[test]
fn the_pose_follows_the_unit_and_a_map_offset() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1);
    let still = register(&dare(), &source, &target).transform;
    let after = |change: Transform| {
        let clouds = [&source, &target].map(|cloud| cloud.transformed(&change).unwrap());
        register(&dare(), &clouds[0], &clouds[1]).transform
    };
    for unit in [1e-3, 1e4] {
        let found = after(Transform { scale: unit, ..Transform::IDENTITY });
        let translation = math::scaled(found.translation, 1.0 / unit);
        let (angle, shift) = apart(&Transform { translation, ..found }, &still, &source);
        assert!(angle < TURN && shift < SHIFT, "{unit}: {angle} {shift}");
    }
    // UTM coordinates, metres.
    let far = Transform::rigid(math::IDENTITY, [5e5, 5.6e6, 100.0]);
    let found = far.inverse().after(&after(far)).after(&far);
    let (angle, shift) = apart(&found, &still, &source);
    assert!(angle < TURN && shift < SHIFT, "{angle} {shift}");
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_again() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1);
    let run = |threads| {
        let found = register(&Dare { threads, trace: true, ..dare() }, &source, &target);
        (found.transform, found.moments, found.trace, found.doubts)
    };
    let first = run(1);
    assert!([1, 2, 3, 7].into_iter().all(|threads| run(threads) == first));
}

/// A shift under which no points meet tells nothing: every such start is the one with
/// centroid on centroid, however far.
#[test]
fn a_source_far_away_is_found_all_the_same() {
    let (source, target, truth) = pair([0.2, 0.3, -0.1], 1);
    let from = |shift: Vec3| {
        let away = Transform::rigid(math::IDENTITY, shift);
        dare().refine(&source, &target, &away).unwrap().transform
    };
    let laid = from(math::sub(target.centroid(), source.centroid()));
    let (angle, shift) = apart(&laid, &truth, &source);
    assert!(angle < 10.0 && shift < 0.05, "{angle} {shift}");
    for sizes in [10.0, 1e3, 1e4, 1e6] {
        let found = from([2.0 * sizes, -sizes, 0.5 * sizes]);
        let (angle, shift) = apart(&found, &laid, &source);
        assert!(angle < TURN && shift < SHIFT, "{sizes}: {angle} {shift}");
    }
}

/// 120 rotations of 60 to 180 degrees, evenly about all axes: most end in a wrong optimum.
#[test]
fn wrong_optima_are_doubted() {
    let (mut wrong, mut right) = (Vec::new(), Vec::new());
    for i in 0..120u32 {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 120.0;
        let (sin, cos) = (2.4 * f64::from(i)).sin_cos();
        let axis = [(1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z];
        let degrees = 60.0 + f64::from(37 * i % 120);
        let (source, target, truth) = pair(math::scaled(axis, degrees.to_radians()), u64::from(i));
        let found = register(&dare(), &source, &target);
        let (angle, _) = apart(&found.transform, &truth, &source);
        let list = if angle > 20.0 { &mut wrong } else { &mut right };
        list.push((found.evaluation.chance_corrected_fitness(), found.trusted, angle));
    }
    wrong.sort_by(|a, b| b.0.total_cmp(&a.0));
    right.sort_by(|a, b| a.0.total_cmp(&b.0));
    println!("{} wrong, best {:.2?}", wrong.len(), &wrong[..5]);
    println!("{} right, worst {:.2?}", right.len(), &right[..5]);
    assert!(wrong.len() > 30 && right.len() > 10, "{} {}", wrong.len(), right.len());
    assert!(wrong.iter().all(|x| !x.1), "{:?}", &wrong[..5]);
    assert!(2 * right.iter().filter(|x| x.1).count() > right.len(), "{right:?}");
}

#[test]
fn running_out_of_iterations_is_doubted() {
    let (source, target, _) = pair([0.2, 0.3, -0.1], 1);
    let found = register(&Dare { max_iterations: 5, ..dare() }, &source, &target);
    assert_eq!((found.stop, found.iterations), (StopReason::IterationLimit, 5));
    assert!(found.doubts.contains(&Warning::NotConverged { iterations: 5 }) && !found.trusted);
}

#[test]
fn odd_clouds_are_refused_or_doubted() {
    let (source, ..) = pair([0.0; 3], 1);
    let cloud = |points: &[Vec3]| PointCloud::new(points).unwrap();
    let few = cloud(&[[0.0; 3], [1.0; 3]]);
    for (a, b) in [(&few, &source), (&source, &few)] {
        assert!(matches!(dare().register(a, b), Err(Error::TooFewPoints { .. })));
    }
    let lump = cloud(&[[1.0, 2.0, 3.0]; 40]);
    assert!(matches!(dare().register(&source, &lump), Err(Error::Degenerate { .. })));
    let line: Vec<Vec3> = (0..50).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    for (a, b) in [(&lump, &source), (&cloud(&line), &source), (&source, &cloud(&line))] {
        assert!(!dare().register(a, b).is_ok_and(|found| found.trusted));
    }
}
