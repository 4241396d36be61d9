//! TEASER takes the steps of the independent f64 reference, round by round.

use crate::common;

use cfreg::math::{self, Mat3, Vec3};
use cfreg::method::Teaser;
use cfreg::{PointCloud, Transform};
use common::compare::pose_difference;
use common::golden::read;
use serde::Deserialize;

#[derive(Deserialize)]
struct Given {
    name: String,
    noise_bound: f64,
    estimate_scale: bool,
    cost_threshold: f64,
    source: Vec<Vec3>,
    target: Vec<Vec3>,
}

#[derive(Deserialize)]
struct Expected {
    scale: f64,
    clique: Vec<usize>,
    inliers: Vec<usize>,
    rounds: Vec<Round>,
}

#[derive(Deserialize)]
struct Round {
    rotation: Mat3,
    translation: Vec3,
    cost: f64,
    weight: f64,
}

/// Clouds keep f32 about their centre: 6e-8 of a unit cube, 2e-6 of a bound, and a cost
/// sums over some hundred residuals.
const ROUNDED: f64 = 2e-6;
const COST: f64 = 1e-4;

#[test]
fn every_round_is_that_of_the_reference() {
    let (given, expected): (Vec<Given>, Vec<Expected>) =
        (read("teaser", "input"), read("teaser", "expected"));
    assert!(given.len() == 3 && expected.len() == 3);
    for (given, expected) in given.iter().zip(&expected) {
        let name = &given.name;
        let cloud = |points: &[Vec3]| PointCloud::new(points).unwrap();
        let pairs: Vec<_> = (0..given.source.len() as u32).map(|k| (k, k)).collect();
        let teaser = Teaser {
            noise_bound: Some(given.noise_bound),
            estimate_scale: given.estimate_scale,
            cost_threshold: given.cost_threshold,
            trace: true,
            ..Teaser::default()
        };
        let (source, target) = (cloud(&given.source), cloud(&given.target));
        let found = teaser.register_correspondences(&source, &target, &pairs).unwrap();
        let scale = found.transform.scale;
        assert!((scale / expected.scale - 1.0).abs() < ROUNDED, "{name}: {scale}");
        assert_eq!(found.trace.len(), expected.rounds.len(), "{name}");
        // All pairs of the clique count in the first round.
        let clique = expected.clique.len() as f64;
        assert_eq!(found.trace[0].weight, clique * (clique - 1.0) / 2.0, "{name}");
        for (step, round) in found.trace.iter().zip(&expected.rounds) {
            let Round { rotation, translation, cost, weight } = *round;
            let want = Transform { rotation, translation, scale: expected.scale };
            let apart = pose_difference(&step.transform, &want);
            assert!(apart < ROUNDED, "{name}, round {}: {apart}", step.iteration);
            assert!((step.objective / cost - 1.0).abs() < COST, "{name}: {}", step.objective);
            assert!((step.weight / weight - 1.0).abs() < COST, "{name}: {}", step.weight);
        }
        // The inliers, by their number and their sum.
        assert_eq!(found.moments.weight, expected.inliers.len() as f64, "{name}");
        let sum = expected.inliers.iter().fold([0.0; 3], |s, &k| math::add(s, given.source[k]));
        let origin = math::scaled(found.moments.source_origin, found.moments.weight);
        let apart = math::norm(math::sub(math::add(found.moments.source_sum, origin), sum));
        assert!(apart < ROUNDED * clique, "{name}: {apart}");
    }
}
