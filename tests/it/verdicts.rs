//! The pose that is returned is the one that is verified: after refinements, from a given pose,
//! and of methods that have no verdict of their own.

use cfreg::cloud::shape::boulder;
use cfreg::math::{self, Vec3};
use cfreg::method::{Consensus, Icp, Method, Pipeline, Refine, Register};
use cfreg::verify::{self, Decision, Warning};
use cfreg::{PointCloud, Transform, filter};

fn chain(first: &str, refinements: &[&str]) -> Pipeline {
    let refinements = refinements.iter().map(|name| name.parse().unwrap()).collect();
    Pipeline::new(first.parse().unwrap(), refinements).unwrap()
}

fn boulders(points: usize) -> (PointCloud, PointCloud, Transform) {
    let truth = Transform {
        translation: [2.0, -1.0, 0.5],
        ..Transform::from_rotation_vector([0.5, -0.8, 0.3])
    };
    let target = boulder().sample(points, 2).unwrap().transformed(&truth).unwrap();
    (boulder().sample(points, 1).unwrap(), target, truth)
}

/// With `rows` marks of missing returns at the zero of the frame.
fn with_zeros(cloud: &PointCloud, rows: usize) -> PointCloud {
    let points: Vec<Vec3> = cloud.positions().chain(std::iter::repeat_n([0.0; 3], rows)).collect();
    PointCloud::new(&points).unwrap()
}

#[test]
fn missing_returns_change_no_method() {
    let (source, target, _) = boulders(600);
    let marked = [with_zeros(&source, 400), with_zeros(&target, 300)];
    for name in ["consensus", "cf", "icp", "kc", "cpd"] {
        let chain = chain(name, &[]);
        let plain = chain.register(&source, &target).unwrap();
        let found = chain.register(&marked[0], &marked[1]).unwrap();
        let off = verify::pose_error(&found.transform, &plain.transform, source.centroid());
        assert!(off.rotation_deg < 1e-3 && off.translation < 1e-4, "{name}: {off:?}");
        let counts = [found.points.source, found.points.target].map(|end| end.no_returns);
        assert_eq!(counts, [400, 300], "{name}");
    }
    let kept = chain("cf", &[]).keep_no_returns().register(&marked[0], &marked[1]).unwrap();
    // They are one place.
    assert_eq!((kept.points.source.no_returns, kept.points.source.used), (0, 601));
}

#[test]
fn points_that_come_in_tens_are_refined_as_if_they_came_once() {
    let (source, target, truth) = boulders(800);
    let tens = |cloud: &PointCloud| {
        let points: Vec<Vec3> = (0..10).flat_map(|_| cloud.positions()).collect();
        PointCloud::new(&points).unwrap()
    };
    let often = [tens(&source), tens(&target)];
    for refine in ["plane-icp", "gicp"] {
        let chain = chain("consensus", &[refine]);
        let once = chain.register(&source, &target).unwrap();
        let found = chain.register(&often[0], &often[1]).unwrap();
        let off = verify::pose_error(&found.transform, &once.transform, source.centroid());
        assert!(off.rotation_deg < 1e-2, "{refine}: {off:?}");
        let off = verify::pose_error(&found.transform, &truth, source.centroid());
        assert!(off.rotation_deg < 1.0 && found.trusted, "{refine}: {off:?} {:?}", found.doubts);
    }
}

/// Two parts of a hilly land, sampled apart: half of each is in the other.
fn overlapping() -> (PointCloud, PointCloud) {
    let hill = |k: usize| {
        let at = |step: usize, size: f64| {
            (((k * k * step + 13 * k + 7) % 97) as f64 / 97.0 - 0.5) * size
        };
        ([at(31, 6.4), at(53, 2.4)], 0.1 + 0.2 * (at(71, 1.0) + 0.5), at(17, 0.8))
    };
    let hills: Vec<_> = (0..60).map(hill).collect();
    let height = |x: f64, y: f64| -> f64 {
        let one = |&([u, v], width, height): &([f64; 2], f64, f64)| {
            height * (-((x - u).powi(2) + (y - v).powi(2)) / (2.0 * width * width)).exp()
        };
        hills.iter().map(one).sum()
    };
    let part = |from: f64, to: f64, shift: f64| {
        let at = |i: usize| {
            let x = from + (to - from) * ((i % 130) as f64 + shift) / 130.0;
            let y = -1.0 + 2.0 * ((i / 130) as f64 + shift) / 65.0;
            [x, y, height(x, y)]
        };
        PointCloud::new(&(0..130 * 65).map(at).collect::<Vec<Vec3>>()).unwrap()
    };
    (part(-3.0, 1.0, 0.0), part(-1.0, 3.0, 0.4))
}

/// How far a pose is from the identity where the source is.
fn shift(found: &Transform, source: &PointCloud) -> f64 {
    verify::pose_error(found, &Transform::IDENTITY, source.centroid()).translation
}

#[test]
fn icp_from_a_pose_that_is_given_is_not_drawn_away() {
    let (source, target) = overlapping();
    let near = Transform {
        translation: [0.01, -0.01, 0.01],
        ..Transform::from_rotation_vector([0.0, 0.005, 0.01])
    };
    let off = |found: &Transform| shift(found, &source);
    let unbounded = Icp::default().refine(&source, &target, &near).unwrap();
    assert!(off(&unbounded.transform) > 0.2, "{}", off(&unbounded.transform));
    let bounded = chain("icp", &[]).with_initial(near).unwrap();
    let found = bounded.register(&source, &target).unwrap();
    assert!(off(&found.transform) < 0.04, "{}", off(&found.transform));
    // A bound that is given counts.
    let icp = Method::Icp(Icp { max_distance: Some(100.0), ..Icp::default() });
    let told = Pipeline::new(icp, Vec::new()).unwrap().with_initial(near).unwrap();
    assert_eq!(told.register(&source, &target).unwrap().transform, unbounded.transform);
    assert!(chain("cf", &[]).with_initial(near).is_err());
}

#[test]
fn icp_from_a_rough_pose_finds_its_way() {
    let (source, target, truth) = boulders(2000);
    for angle in [0.1f64, 0.2, 0.3] {
        let turn = Transform::from_rotation_vector([angle, 0.0, 0.0]);
        let rough = truth.after(&turn);
        let found =
            chain("icp", &[]).with_initial(rough).unwrap().register(&source, &target).unwrap();
        let off = verify::pose_error(&found.transform, &truth, source.centroid());
        assert!(off.rotation_deg < 1.0, "from {angle}: {off:?}");
    }
}

#[test]
fn a_refinement_that_moves_an_accepted_pose_away_is_dropped() {
    let (source, target) = overlapping();
    // Pairs of any length draw the clouds onto each other.
    let unbounded = Method::Icp(Icp { max_distance: Some(10.0), ..Icp::default() });
    let chain = Pipeline::new("consensus".parse().unwrap(), vec![unbounded]).unwrap();
    let found = chain.register(&source, &target).unwrap();
    // The pose of the search is kept, and a reason says why.
    assert!(shift(&found.transform, &source) < 0.02 && found.refined_from.is_none());
    let verdict = found.verdict.as_ref().unwrap();
    assert!(found.trusted && verdict.decision == Decision::Accept, "{verdict}");
    let dropped = |reason: &String| reason.starts_with("the refinement by icp was dropped");
    assert!(verdict.reasons.iter().any(dropped), "{verdict}");
}

#[test]
fn a_refinement_has_a_verdict_of_its_own() {
    let (source, target, _) = boulders(1500);
    for refine in ["icp", "plane-icp", "gicp", "kc", "cpd", "dare"] {
        let found = chain("consensus", &[refine]).register(&source, &target).unwrap();
        let verdict = found.verdict.as_ref().unwrap();
        assert!(
            verdict.reasons.iter().any(|reason| reason.contains("refinement on the surfaces")),
            "{refine}"
        );
        assert_eq!(found.trusted, found.doubts.is_empty());
    }
    // An answer that is continued has one, too.
    let begun = Consensus::default().register(&source, &target).unwrap();
    let found = chain("consensus", &["icp"]).refine_from(begun, &source, &target).unwrap();
    assert!(found.verdict.is_some());
}

#[test]
fn wrong_poses_of_small_clouds_are_not_trusted() {
    // Samples of a filled ball: every rotation fits.
    let ball = |seed: u64| {
        let cube = boulder().sample(4000, seed).unwrap();
        let center = cube.centroid();
        let inward = |(i, p): (usize, Vec3)| {
            let share = ((i * 7 % 100) as f64 / 100.0).cbrt();
            let out = math::normalized(math::sub(p, center));
            math::scaled(out, share)
        };
        PointCloud::new(&cube.positions().enumerate().map(inward).collect::<Vec<_>>()).unwrap()
    };
    let (source, target) = (filter::sample(&ball(1), 300, 1), filter::sample(&ball(2), 300, 2));
    for name in ["cf", "cf-multiscale", "icp", "kc", "cpd", "dare"] {
        let plain = chain(name, &[]).register(&source, &target).unwrap();
        let doubted = |doubt: &Warning| matches!(doubt, Warning::HighChanceFitness { .. });
        assert!(plain.doubts.iter().any(doubted), "{name}: {:?}", plain.evaluation);
        let judge = Consensus::default();
        let judged = chain(name, &[]).with_verification(judge).register(&source, &target).unwrap();
        assert!(!judged.trusted, "{name}: {:?}", judged.verdict);
    }
}

#[test]
fn a_ball_on_itself_is_not_accepted() {
    // Laid on the faces of a cube, which quarter turns map to themselves.
    let at = |i: usize| {
        let [u, v] = [i % 20, i / 20 % 20].map(|k| (k as f64 - 9.5) / 10.0);
        let mut point = [u, v, if (i / 400).is_multiple_of(2) { 1.0 } else { -1.0 }];
        point.rotate_right(i / 800);
        math::normalized(point)
    };
    let ball = PointCloud::new(&(0..2400).map(at).collect::<Vec<Vec3>>()).unwrap();
    for name in ["consensus", "icp"] {
        let chain = chain(name, &[]).with_verification(Consensus::default());
        let found = chain.register(&ball, &ball).unwrap();
        let verdict = found.verdict.as_ref().unwrap();
        assert!(
            found.evaluation.chance_corrected_fitness() < 0.3,
            "{name}: {:?}",
            found.evaluation
        );
        assert_ne!(verdict.decision, Decision::Accept, "{name}: {verdict}");
        assert!(!found.trusted, "{name}");
    }
}

#[test]
fn odd_clouds_with_a_pose_to_start_from_have_a_defined_result() {
    let cloud = |n: usize| {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
        PointCloud::new(&points[..n]).unwrap()
    };
    let place = PointCloud::new(&[[1.0, 2.0, 3.0]; 9]).unwrap();
    let huge = Transform { translation: [1e17, 0.0, 0.0], ..Transform::IDENTITY };
    for name in ["icp", "plane-icp", "gicp"] {
        let from = |initial| chain(name, &[]).with_initial(initial).unwrap();
        for (source, target) in [(0, 0), (0, 4), (4, 0), (1, 4), (2, 2)] {
            let found = from(Transform::IDENTITY).register(&cloud(source), &cloud(target));
            assert!(found.is_err(), "{name} {source} {target}");
        }
        assert!(from(Transform::IDENTITY).register(&place, &place).is_err(), "{name}");
        _ = from(huge).register(&cloud(4), &cloud(4));
        _ = from(Transform::IDENTITY).register(&cloud(4), &place);
    }
}

#[test]
fn clouds_too_small_for_a_verdict_are_doubted() {
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]];
    let cloud = PointCloud::new(&points).unwrap();
    let icp = chain("icp", &[]).with_verification(Consensus::default());
    let found = icp.register(&cloud, &cloud).unwrap();
    assert!(!found.trusted);
    assert!(found.verdict.is_some() || found.doubts.contains(&Warning::NotVerified));
}
