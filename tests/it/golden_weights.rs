//! Weights and closed forms are those of the independent f64 reference.
//!
//! `tests/golden/README.md` describes the cases: every kernel and normalisation, weights of
//! points, every solver on moments that are well and badly posed.

use crate::common;

use cfreg::math::Vec3;
use cfreg::moments::{FullConnection, Moments};
use cfreg::pose::{self, ScaleEstimate, Solver};
use cfreg::weight::{Normalization, WeightScheme};
use cfreg::{Error, PointCloud};
use common::compare::pose_difference;
use common::golden::{
    ExpectedPose, ExpectedSolution, GoldenPair, MOMENTS_TIMES_BETA, Sums, descriptors,
    feature_view, read,
};
use serde::Deserialize;

/// A few f32 roundings of d²/β and the 4e-7 of `math::fast`, on weights that fall with both.
const WEIGHT: f64 = 2e-7;

// --- Weights -------------------------------------------------------------------------

#[derive(Deserialize)]
struct WeightsInput {
    beta: f64,
    nu: f32,
    #[serde(flatten)]
    sides: GoldenPair<DescribedPoints>,
}

#[derive(Deserialize)]
struct DescribedPoints {
    points: Vec<Vec3>,
    descriptors: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Weighed {
    kernel: String,
    normalisation: Normalization,
    #[serde(flatten)]
    solved: ExpectedSolution,
}

#[derive(Deserialize)]
struct KernelTable {
    kernel: String,
    beta: f64,
    nu: f32,
    weights: Vec<f64>,
}

#[derive(Deserialize)]
struct Distances {
    squared_distances: Vec<f32>,
}

fn scheme(kernel: &str, nu: f32) -> WeightScheme {
    match kernel {
        "student-t" => WeightScheme::StudentT(nu),
        _ => kernel.parse().unwrap(),
    }
}

#[test]
fn every_kernel_has_the_same_weights() {
    let Distances { squared_distances } = read("kernels", "input");
    let tables: Vec<KernelTable> = read("kernels", "expected");
    for KernelTable { kernel, beta, nu, weights } in tables {
        for (&d2, want) in squared_distances.iter().zip(&weights) {
            let found = f64::from(scheme(&kernel, nu).weight(beta, d2).unwrap());
            // Absolute: f32 rounds 1e-200 to zero.
            let error = (found - want).abs();
            assert!(error < WEIGHT, "{kernel}, beta {beta}, d² {d2}: {error:e}");
        }
    }
}

#[test]
fn every_kernel_and_normalisation_has_the_same_moments_and_pose() {
    let WeightsInput { beta, nu, sides: GoldenPair { source, target } } = read("weights", "input");
    let clouds = [&source, &target].map(|side| PointCloud::new(&side.points).unwrap());
    let rows = [&source, &target].map(|side| descriptors(&side.descriptors));
    let connection =
        FullConnection::new(feature_view(&clouds[0], &rows[0]), feature_view(&clouds[1], &rows[1]))
            .unwrap();
    let expected: Vec<Weighed> = read("weights", "expected");
    assert_eq!(expected.len(), WeightScheme::NAMES.len() * Normalization::NAMES.len());
    for Weighed { kernel, normalisation, solved } in expected {
        let found = connection.scheme_moments(scheme(&kernel, nu), beta, normalisation).unwrap();
        solved.check(&found, MOMENTS_TIMES_BETA / beta, &format!("{kernel}, {normalisation}"));
    }
}

#[derive(Deserialize)]
struct PointWeights {
    source_weights: Vec<f32>,
    target_weights: Vec<f32>,
}

#[derive(Deserialize)]
struct Normalized {
    normalisation: Normalization,
    #[serde(flatten)]
    solved: ExpectedSolution,
}

#[test]
fn weights_of_points_have_the_same_moments_and_pose() {
    let WeightsInput { beta, sides: GoldenPair { source, target }, .. } = read("weights", "input");
    let PointWeights { source_weights, target_weights } = read("point_weights", "input");
    let clouds = [&source, &target].map(|side| PointCloud::new(&side.points).unwrap());
    let rows = [&source, &target].map(|side| descriptors(&side.descriptors));
    let connection =
        FullConnection::new(feature_view(&clouds[0], &rows[0]), feature_view(&clouds[1], &rows[1]))
            .unwrap()
            .with_point_weights(Some(&source_weights), Some(&target_weights))
            .unwrap();
    let expected: Vec<Normalized> = read("point_weights", "expected");
    assert_eq!(expected.len(), Normalization::NAMES.len());
    for Normalized { normalisation, solved } in expected {
        let scheme = WeightScheme::Gaussian;
        let found = connection.scheme_moments(scheme, beta, normalisation).unwrap();
        solved.check(&found, MOMENTS_TIMES_BETA / beta, &format!("{normalisation}"));
    }
}

// --- Poses ---------------------------------------------------------------------------

#[derive(Deserialize)]
struct Problem {
    name: String,
    #[serde(with = "Sums")]
    moments: Moments,
}

#[derive(Deserialize)]
struct Answers {
    name: String,
    rigid: Option<ExpectedPose>,
    similarity: Option<ExpectedPose>,
}

#[test]
fn every_solver_finds_the_same_pose_or_says_that_there_is_none() {
    let problems: Vec<Problem> = read("solve", "input");
    let answers: Vec<Answers> = read("solve", "expected");
    for (Problem { name, moments }, answer) in problems.iter().zip(&answers) {
        assert_eq!(*name, answer.name);
        let estimates =
            [(ScaleEstimate::Fixed, &answer.rigid), (ScaleEstimate::Umeyama, &answer.similarity)];
        for (scale, want) in estimates {
            for solver in Solver::ALL {
                let found = pose::solve(moments, solver, scale);
                let Some(want) = want else {
                    match found {
                        Err(Error::NoWeight { .. }) => assert_eq!(moments.weight, 0.0, "{name}"),
                        Err(Error::Degenerate { rank, .. }) => assert_eq!(rank, 1, "{name}"),
                        other => panic!("{name}, {solver}: {other:?}"),
                    }
                    continue;
                };
                let found = found.unwrap().transform;
                let error = pose_difference(&found, &want.transform());
                // What f64 leaves of the problem, with room for another order of sums.
                let bound = 1e-13 + 10.0 * want.solvers_differ_by;
                assert!(error < bound, "{name}, {solver}, {scale}: {error:e}");
                // The residual is a difference of sums as large as these.
                let squares = moments.source_squares + moments.target_squares;
                let error = (moments.residual(&found) - want.residual).abs();
                assert!(error < 1e-14 * squares, "{name}, {solver}, {scale}: residual {error:e}");
            }
        }
    }
}
