//! TEASER: what it finds, how the answer follows the clouds, and where it says that it fails.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::method::{Register, Registration, Teaser};
use cfreg::search::Neighborhood;
use cfreg::verify::{Warning, pose_error};
use cfreg::{Error, PointCloud, Transform, math};
use common::compare::pose_difference;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Error of a right match along each axis at most, and the bound that goes with it: the
/// two-norm, for a shape of two units.
const NOISE: f64 = 0.01;
const BOUND: f64 = 0.02;

/// Two clouds and matches of which some are wrong.
struct Matched {
    source: PointCloud,
    target: PointCloud,
    pairs: Vec<(u32, u32)>,
    truth: Transform,
}

/// `count` points of one shape and the same points moved by `truth`, each a little off,
/// matched one to one; the first `wrong` matches are shuffled among themselves.
fn matched(count: usize, wrong: usize, scale: f64, seed: u64) -> Matched {
    let truth = Transform {
        translation: [0.3, -2.0, 1.0],
        scale,
        ..Transform::from_rotation_vector([0.4, 2.0, -1.1])
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let source = boulder().sample(count, seed).unwrap();
    let off = |rng: &mut ChaCha8Rng| [(); 3].map(|()| scale * rng.random_range(-NOISE..NOISE));
    let target: Vec<_> =
        source.positions().map(|p| math::add(truth.apply(p), off(&mut rng))).collect();
    let mut ends: Vec<u32> = (0..count as u32).collect();
    ends[..wrong].shuffle(&mut rng);
    let pairs = ends.iter().enumerate().map(|(i, &j)| (i as u32, j)).collect();
    Matched { source, target: PointCloud::new(&target).unwrap(), pairs, truth }
}

fn exact() -> Teaser {
    Teaser { noise_bound: Some(BOUND), ..Teaser::default() }
}

impl Matched {
    fn solve(&self, teaser: &Teaser) -> Registration {
        teaser.register_correspondences(&self.source, &self.target, &self.pairs).unwrap()
    }

    /// Greatest distance between where a pose and the truth put a source point, in the
    /// source's unit.
    fn off_by(&self, pose: &Transform) -> f64 {
        let apart = |p| math::norm(math::sub(pose.apply(p), self.truth.apply(p)));
        self.source.positions().map(apart).fold(0.0, f64::max) / self.truth.scale
    }
}

#[test]
fn most_matches_may_be_wrong() {
    for count in [100, 300, 1000] {
        for share in [0.0, 0.5, 0.8, 0.9, 0.95] {
            let problem = matched(count, (share * count as f64) as usize, 1.0, count as u64);
            let found = problem.solve(&exact());
            let off = problem.off_by(&found.transform);
            assert!(off < BOUND, "{share} of {count}: {off}");
            let right = (1.0 - share) * count as f64;
            assert!(found.effective_connections >= 0.9 * right, "{share} of {count}");
            assert!(found.trusted, "{share} of {count}: {:?}", found.doubts);
        }
    }
}

#[test]
fn wrong_matches_alone_are_doubted() {
    for count in [100, 300, 1000] {
        for (wrong, seed) in [(count, 1), (count, 2), (count - count / 100, 3)] {
            let problem = matched(count, wrong, 1.0, seed);
            let found = problem.solve(&exact());
            let off = problem.off_by(&found.transform);
            assert!(off < BOUND || !found.trusted, "{wrong} of {count}: {off}");
            if wrong == count {
                let few = |doubt: &Warning| matches!(doubt, Warning::FewInliers { .. });
                assert!(found.doubts.iter().any(few), "{count}: {:?}", found.doubts);
            }
        }
    }
}

#[test]
fn scale_is_voted_for_when_asked() {
    for scale in [1.3, 0.01] {
        let problem = matched(300, 180, scale, 5);
        let teaser = Teaser { noise_bound: Some(BOUND * scale), ..Teaser::default() };
        let voted = problem.solve(&Teaser { estimate_scale: true, ..teaser.clone() });
        assert!((voted.transform.scale / scale - 1.0).abs() < 0.01, "{}", voted.transform.scale);
        assert!(problem.off_by(&voted.transform) < 2.0 * BOUND && voted.trusted);
        match teaser.register_correspondences(&problem.source, &problem.target, &problem.pairs) {
            Ok(fixed) => assert!(!fixed.trusted, "{:?}", fixed.evaluation),
            Err(error) => assert!(matches!(error, Error::TooFewPoints { .. }), "{error}"),
        }
    }
}

#[test]
fn matches_may_repeat_but_must_be_there_and_span_a_plane() {
    let problem = matched(60, 30, 1.0, 1);
    let once = problem.solve(&exact());
    let twice = Matched { pairs: problem.pairs.repeat(2), ..matched(60, 30, 1.0, 1) };
    let found = twice.solve(&exact());
    assert_eq!(found.effective_connections, 2.0 * once.effective_connections);
    assert!(pose_difference(&found.transform, &once.transform) < 2e-3);
    let (source, target) = (&problem.source, &problem.target);
    let solve = |pairs: &[(u32, u32)]| exact().register_correspondences(source, target, pairs);
    for pairs in [&[(0, 0), (1, 1), (60, 2)], &[(0, 0), (1, 1), (2, 60)]] {
        assert!(matches!(solve(pairs), Err(Error::Shape { expected: 61, found: 60, .. })));
    }
    for few in 0..3 {
        let error = solve(&problem.pairs[..few]).unwrap_err();
        assert!(matches!(error, Error::TooFewPoints { needed: 3, .. }), "{few}: {error}");
    }
    // One match, many times over.
    assert!(matches!(solve(&[(0, 0); 10]), Err(Error::Degenerate { .. })));
    let line: Vec<_> = (0..20).map(|i| [f64::from(i), 2.0 * f64::from(i), 0.0]).collect();
    let line = PointCloud::new(&line).unwrap();
    let pairs: Vec<_> = (0..20).map(|i| (i, i)).collect();
    let error = exact().register_correspondences(&line, &line, &pairs).unwrap_err();
    assert!(matches!(error, Error::Degenerate { .. }), "{error}");
}

#[test]
fn given_matches_follow_motion_unit_order_and_a_map_offset() {
    let problem = matched(200, 140, 1.0, 9);
    let still = problem.solve(&exact()).transform;
    let turn = Transform {
        translation: [4.0, 5.0, -6.0],
        ..Transform::from_rotation_vector([2.0, -0.5, 0.7])
    };
    let far = Transform::rigid(math::IDENTITY, [5e5, 5.6e6, 200.0]);
    for motion in [turn, far] {
        let (source, target) = (
            problem.source.transformed(&motion).unwrap(),
            problem.target.transformed(&motion).unwrap(),
        );
        let solve =
            |a, b| exact().register_correspondences(a, b, &problem.pairs).unwrap().transform;
        // The target moved: the pose moves with it. The source moved: it is undone first.
        let by_target = motion.inverse().after(&solve(&problem.source, &target));
        let by_source = solve(&source, &problem.target).after(&motion);
        for pose in [by_target, by_source] {
            let apart = |p| math::norm(math::sub(pose.apply(p), still.apply(p)));
            let most = problem.source.positions().map(apart).fold(0.0, f64::max);
            assert!(most < 1e-4, "{motion:?}: {most}");
        }
    }
    for unit in [1e-3, 1e4] {
        let change = Transform { scale: unit, ..Transform::IDENTITY };
        let clouds = [&problem.source, &problem.target].map(|c| c.transformed(&change).unwrap());
        let solve = |bound, clouds: [&PointCloud; 2]| {
            let teaser = Teaser { noise_bound: bound, ..Teaser::default() };
            teaser.register_correspondences(clouds[0], clouds[1], &problem.pairs).unwrap().transform
        };
        let given = solve(Some(BOUND * unit), [&clouds[0], &clouds[1]]);
        assert!(turned(&given, &still) < 1e-4, "{unit}");
        let own = solve(None, [&clouds[0], &clouds[1]]);
        let before = solve(None, [&problem.source, &problem.target]);
        assert!(turned(&own, &before) < 1e-4, "{unit}");
    }
    let mut shuffled = problem.pairs.clone();
    shuffled.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
    let found =
        exact().register_correspondences(&problem.source, &problem.target, &shuffled).unwrap();
    assert!(pose_difference(&found.transform, &still) < 1e-9);
}

fn turned(a: &Transform, b: &Transform) -> f64 {
    math::frobenius(&math::mat_sub(&a.rotation, &b.rotation))
}

/// For a whole object of two thousand points: the paper's 150 are a large part of it.
fn by_descriptor() -> Teaser {
    let mut teaser = Teaser::default();
    teaser.features.neighborhood = Neighborhood::Nearest(80);
    teaser
}

/// Two samples of one shape, no point in common, the target moved.
fn described(motion: &Transform) -> (PointCloud, PointCloud) {
    let sample = |seed| boulder().sample(2000, seed).unwrap();
    (sample(1), sample(2).transformed(motion).unwrap())
}

#[test]
fn any_rotation_is_found_from_descriptors() {
    for vector in [[0.0; 3], [0.4, 2.0, -1.1], [0.0, 0.0, 3.1]] {
        let motion =
            Transform { translation: [3.0, -1.0, 2.0], ..Transform::from_rotation_vector(vector) };
        let (source, target) = described(&motion);
        let found = by_descriptor().register(&source, &target).unwrap();
        let error = pose_error(&found.transform, &motion, source.centroid());
        assert!(error.rotation_deg < 10.0 && error.translation < 0.2, "{vector:?}: {error:?}");
        let stages = found.time_s.0.iter().map(|(stage, _)| stage.to_string()).collect::<Vec<_>>();
        let own = ["matches", "graph", "clique", "rotation", "evaluate"];
        assert!(own.iter().all(|own| stages.iter().any(|stage| stage == own)), "{stages:?}");
        assert_eq!((found.points.source.used, found.points.target.described), (2000, 2000));
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_every_time() {
    let (source, target) = described(&Transform::from_rotation_vector([0.3, -1.0, 0.2]));
    let problem = matched(60, 40, 1.0, 2);
    let run = |threads| {
        let teaser = Teaser { threads, trace: true, ..by_descriptor() };
        let found = teaser.register(&source, &target).unwrap();
        let certified = problem.solve(&Teaser { threads, certify: true, ..exact() });
        (found.transform, found.moments, found.trace, certified.transform, certified.certificate)
    };
    let first = run(1);
    assert!([1, 2, 3, 7].into_iter().all(|threads| run(threads) == first));
}

#[test]
fn the_trace_ends_at_the_answer_with_less_and_less_weight() {
    let problem = matched(200, 100, 1.0, 4);
    let silent = problem.solve(&exact());
    let found = problem.solve(&Teaser { trace: true, ..exact() });
    assert!(silent.trace.is_empty() && silent.transform == found.transform);
    assert_eq!(found.trace.len(), found.iterations as usize);
    let last = found.trace.last().unwrap();
    assert_eq!((last.transform, last.iteration), (found.transform, found.iterations));
    assert!(found.trace.iter().all(|step| step.weight <= found.trace[0].weight));
}

#[test]
fn a_search_that_ends_early_says_so() {
    // Most pairs agree within so wide a bound, and no set of them stands out.
    let problem = matched(400, 400, 1.0, 6);
    let teaser = Teaser { noise_bound: Some(0.15), clique_steps: 1, ..Teaser::default() };
    let found = problem.solve(&teaser);
    let short = |doubt: &Warning| matches!(doubt, Warning::CliqueNotProved { found } if *found > 3);
    assert!(found.doubts.iter().any(short), "{:?}", found.doubts);
    assert_eq!(found.transform, problem.solve(&teaser).transform);
}

#[test]
fn too_few_iterations_are_doubted() {
    let problem = matched(200, 20, 1.0, 4);
    let teaser = Teaser { max_iterations: 1, noise_bound: Some(NOISE), ..Teaser::default() };
    let found = problem.solve(&teaser);
    assert!(found.doubts.contains(&Warning::NotConverged { iterations: 1 }), "{:?}", found.doubts);
}

#[test]
fn a_certificate_is_there_when_asked_for_and_changes_nothing() {
    for (count, wrong) in [(12, 0), (60, 30), (400, 200)] {
        let problem = matched(count, wrong, 1.0, 8);
        let plain = problem.solve(&exact());
        let found = problem.solve(&Teaser { certify: true, ..exact() });
        assert!(plain.certificate.is_none() && plain.transform == found.transform);
        let certificate = found.certificate.unwrap();
        assert!(certificate.gap <= 1e-3, "{count}: {certificate:?}");
        assert!(certificate.rotation_deg < 1.0, "{count}: {certificate:?}");
        assert!(serde_json::to_value(&found).unwrap()["certificate"]["gap"].is_number());
    }
}

#[test]
fn unrelated_clouds_are_doubted() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let cube: Vec<_> = (0..500).map(|_| [(); 3].map(|()| rng.random_range(-1.0..1.0))).collect();
    let cube = PointCloud::new(&cube).unwrap();
    let flat: Vec<_> = cube.positions().map(|[x, y, _]| [x, y, 0.1 * (3.0 * x).sin()]).collect();
    let flat = PointCloud::new(&flat).unwrap();
    let (source, _) = described(&Transform::IDENTITY);
    for target in [&cube, &flat] {
        match Teaser::default().register(&source, target) {
            Ok(found) => assert!(!found.trusted, "{:?}", found.evaluation),
            Err(error) => assert!(matches!(error, Error::TooFewPoints { .. }), "{error}"),
        }
    }
}

#[test]
fn wrong_poses_of_real_scans_are_doubted() {
    let Some(data) = common::shared_data() else { return };
    let pairs = common::scans::real_pairs(&data, 30, 2000);
    let mut right = 0;
    for pair in &pairs {
        let found = Teaser::default().register(&pair.source, &pair.target).unwrap();
        let error = pose_error(&found.transform, &pair.truth, pair.source.centroid());
        assert!(error.rotation_deg < 20.0 || !found.trusted, "{}: {error:?}", pair.name);
        right += usize::from(error.rotation_deg < 10.0);
    }
    println!("{right} of {} pairs within 10 degrees", pairs.len());
    assert!(right >= pairs.len() / 4, "{right} of {}", pairs.len());
}
