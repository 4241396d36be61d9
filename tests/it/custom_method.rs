//! A method from outside the crate, by public names alone: it registers, is verified, runs in bulk
//! and has a page.

use std::sync::Arc;

use cfreg::batch::{Batch, PairList, results};
use cfreg::cloud::shape::boulder;
use cfreg::math::{self, Mat3, Vec3};
use cfreg::method::{Consensus, MethodRecord, Register, Registration, SolvedPose};
use cfreg::report::PairReport;
use cfreg::verify::{Decision, default_distance, evaluate};
use cfreg::{Error, PointCloud, Result, Transform};
use serde::Serialize;

/// Principal axes onto principal axes; of the four choices of signs the one with the largest
/// fitness.
#[derive(Serialize)]
struct PrincipalAxes {
    min_points: usize,
}

/// The centroid, and the axes as columns, right-handed.
fn frame(cloud: &PointCloud) -> (Vec3, Mat3) {
    let center = cloud.centroid();
    let mut covariance = [[0.0; 3]; 3];
    for p in cloud.positions() {
        let d = math::sub(p, center);
        covariance = [0, 1, 2].map(|i| math::add(covariance[i], math::scaled(d, d[i])));
    }
    let (_, vectors) = cfreg::math::eigen::symmetric(&covariance);
    let mut axes = vectors;
    axes[2] = math::cross(axes[0], axes[1]);
    (center, math::transpose(&axes))
}

impl Register for PrincipalAxes {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        for (cloud, name) in [(source, "the source"), (target, "the target")] {
            if cloud.len() < self.min_points {
                let (found, needed) = (cloud.len(), self.min_points);
                return Err(Error::TooFewPoints { what: name.into(), found, needed });
            }
        }
        let ((from, a), (onto, b)) = (frame(source), frame(target));
        let mut best: Option<(f64, Transform)> = None;
        for signs in [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]] {
            let flipped = b.map(|row| [0, 1, 2].map(|k| row[k] * signs[k]));
            let rotation = math::mat_mul(&flipped, &math::transpose(&a));
            let pose = Transform::rigid(rotation, [0.0; 3]);
            let translation = math::sub(onto, pose.rotate(from));
            let pose = Transform { translation, ..pose };
            let distance = default_distance(source, target, pose.scale)?;
            let fitness = evaluate(source, target, &pose, distance)?.fitness;
            if best.is_none_or(|(least, _)| fitness > least) {
                best = Some((fitness, pose));
            }
        }
        let (_, pose) = best.expect("there are four");
        SolvedPose::new(pose, MethodRecord::new("principal-axes", self)).finish(source, target)
    }
}

fn pair() -> (PointCloud, PointCloud, Transform) {
    let truth = Transform {
        translation: [2.0, -1.0, 0.5],
        ..Transform::from_rotation_vector([0.4, -1.0, 0.8])
    };
    let target = boulder().sample(2000, 2).unwrap().transformed(&truth).unwrap();
    (boulder().sample(2000, 1).unwrap(), target, truth)
}

const METHOD: PrincipalAxes = PrincipalAxes { min_points: 10 };

#[test]
fn it_registers_and_is_verified() {
    let (source, target, truth) = pair();
    let found = METHOD.register(&source, &target).unwrap();
    assert!(found.transform.after(&truth.inverse()).angle() < 0.1, "{:?}", found.transform);
    assert_eq!(
        (&*found.method.name, &found.method.settings["min_points"]),
        ("principal-axes", &10.into())
    );
    assert!(found.evaluation.fitness > 0.3 && found.connections == 0);
    // Nearest points at the pose stand in for weights.
    assert!(found.moments.weight > 100.0 && found.singular_values[1] > 0.01, "{found:?}");
    let verdict = Consensus::default().verify(&source, &target, &found.transform).unwrap();
    let judged = found.with_verdict(verdict);
    let verdict = judged.verdict.as_ref().unwrap();
    assert_eq!(judged.trusted, verdict.decision == Decision::Accept, "{:?}", judged.doubts);
    let few = source.select(&[0, 1, 2]);
    assert!(matches!(METHOD.register(&few, &target), Err(Error::TooFewPoints { .. })));
}

#[test]
fn it_runs_in_bulk_and_has_a_page() {
    let (source, target, _) = pair();
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("rows.csv");
    let mut batch = Batch::new(&METHOD, &METHOD);
    let clouds = [("a", Arc::new(source.clone())), ("b", Arc::new(target.clone()))];
    batch.in_memory.extend(clouds.map(|(name, cloud)| (name.to_string(), cloud)));
    let done = batch.run(&PairList::new("", [["a", "b"], ["b", "a"]]), &output).unwrap();
    assert_eq!(done.errors, 0);
    let rows = results::read(&output).unwrap();
    assert!(rows.len() == 2 && rows.iter().all(|row| row.fitness.unwrap() > 0.3));
    let found = METHOD.register(&source, &target).unwrap();
    let page = PairReport::new(&found, &source, &target).html().unwrap();
    assert!(page.contains("principal-axes"));
}

#[test]
fn correspondences_from_elsewhere_are_verified_on_the_surfaces() {
    let (source, _, truth) = pair();
    let target = source.transformed(&truth).unwrap();
    let right = (0..60u32).map(|i| (i, i));
    let wrong = (0..200u32).map(|i| (i * 7 % 2000, i * 13 % 2000));
    let pairs: Vec<(u32, u32)> = right.chain(wrong).collect();
    let consensus = Consensus::default();
    let found = consensus.register_correspondences(&source, &target, &pairs, None).unwrap();
    assert!(found.is_usable(), "{:?}", found.verdict);
    assert!(found.transform.after(&truth.inverse()).angle() < 0.01);
    // A pose that wrong ones propose is accepted only where refinement has made it right.
    let wrong = &pairs[60..];
    let found = consensus.register_correspondences(&source, &target, wrong, None).unwrap();
    let is_right = found.transform.after(&truth.inverse()).angle() < 0.01;
    assert!(!found.is_usable() || is_right, "{:?}", found.verdict);
    let refused = |pairs: &[(u32, u32)], scores: Option<&[f32]>| {
        consensus.register_correspondences(&source, &target, pairs, scores).unwrap_err()
    };
    assert!(matches!(refused(&[(0, 0), (1, 1)], None), Error::TooFewPoints { .. }));
    assert!(matches!(refused(&[(0, 0), (1, 2000), (2, 2)], None), Error::Shape { .. }));
    assert!(matches!(refused(&pairs, Some(&[1.0])), Error::Shape { .. }));
    let bad = vec![f32::NAN; pairs.len()];
    assert!(matches!(refused(&pairs, Some(&bad)), Error::Config { field: "scores", .. }));
}

#[test]
fn results_come_back_from_their_json() {
    let (source, target, _) = pair();
    let refined: cfreg::method::Method = "gicp".parse().unwrap();
    let pipeline =
        cfreg::method::Pipeline::new("consensus".parse().unwrap(), vec![refined]).unwrap();
    for method in [&pipeline as &dyn Register, &METHOD] {
        let found = method.register(&source, &target).unwrap();
        let text = serde_json::to_string(&found).unwrap();
        let back: Registration = serde_json::from_str(&text).unwrap();
        assert_eq!(back.transform, found.transform);
        assert_eq!(
            (&back.method, &back.doubts, &back.points),
            (&found.method, &found.doubts, &found.points)
        );
        assert_eq!((&back.verdict, &back.time_s), (&found.verdict, &found.time_s));
        assert_eq!(back.refined_from.is_some(), found.refined_from.is_some());
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
    }
}
