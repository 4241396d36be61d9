//! Every stage computes what the independent f64 reference computed.
//!
//! `tests/golden/README.md` describes the cases. Each stage is given the reference's own
//! values of the stage before, so that one fault makes one test fail; the last test goes
//! the whole way from points to pose on the crate's own values.

mod common;

use cfreg::descriptor::{self, BINS, HistogramScale};
use cfreg::math::{Mat3, Vec3};
use cfreg::moments::{Described, FullConnection, Moments};
use cfreg::normals::{self, Orientation};
use cfreg::pose::{self, ScaleEstimate, Solver};
use cfreg::search::{Neighborhood, Neighbors, SearchTree};
use cfreg::weight::{Normalization, WeightScheme};
use cfreg::{Descriptors, Error, PointCloud, Transform};
use common::compare::{moments_differ_by, poses_differ_by, rows_differ_by};
use common::golden::read;
use serde::Deserialize;

/// f64 arithmetic on the same numbers, then half a unit in the last place of an f32 in
/// [½, 1): a coordinate of a normal.
const ROUNDED: f64 = 3.1e-8;
/// Half a unit in the last place of an f32 up to 256, the largest bin, and of the simple
/// histogram up to 128 that was added to it.
const HISTOGRAM: f64 = 1.2e-5;
/// A few f32 roundings of d²/β and the 4e-7 of `math::fast`, on weights that fall with both.
const WEIGHT: f64 = 2e-7;
/// f32 distances by the product, |a|² + |b|² − 2ab, are off by some 1e-7 of |a|² ≈ 2000.
/// Relative to β that is the error of a weight; it averages out in part.
const MOMENTS_TIMES_BETA: f64 = 1e-3;

/// [`Moments`] as the files name them.
#[derive(Deserialize)]
#[serde(remote = "Moments")]
struct Sums {
    source_origin: Vec3,
    target_origin: Vec3,
    weight: f64,
    weight_squared: f64,
    source_sum: Vec3,
    target_sum: Vec3,
    cross: Mat3,
    source_squares: f64,
    target_squares: f64,
}

#[derive(Deserialize)]
struct Pose {
    scale: f64,
    rotation: Mat3,
    translation: Vec3,
    residual: f64,
    solvers_differ_by: f64,
}

impl Pose {
    fn transform(&self) -> Transform {
        Transform { rotation: self.rotation, translation: self.translation, scale: self.scale }
    }
}

/// What became of a weighted connection.
#[derive(Deserialize)]
struct Solved {
    #[serde(with = "Sums")]
    moments: Moments,
    effective_connections: f64,
    pose: Option<Pose>,
}

impl Solved {
    /// Compares moments and what all four solvers make of them.
    fn check(&self, found: &Moments, tolerance: f64, context: &str) {
        let error = moments_differ_by(&self.moments, found);
        assert!(error < tolerance, "{context}: moments off by {error:e}");
        let error = (found.effective_connections() / self.effective_connections - 1.0).abs();
        assert!(error < tolerance, "{context}: effective connections off by {error:e}");
        for solver in Solver::ALL {
            let exact = pose::solve(&self.moments, solver, ScaleEstimate::Fixed);
            let fused = pose::solve(found, solver, ScaleEstimate::Fixed);
            let Some(pose) = &self.pose else {
                assert!(matches!(exact, Err(Error::Degenerate { .. })), "{context}: {exact:?}");
                assert!(matches!(fused, Err(Error::Degenerate { .. })), "{context}: {fused:?}");
                continue;
            };
            let error = poses_differ_by(&exact.unwrap().transform, &pose.transform());
            assert!(error < 1e-14, "{context}: {solver} off by {error:e}");
            // A factor on all weights turns nothing, so little of the moments' error arrives;
            // the second singular value divides what does.
            let fused = fused.unwrap();
            let error = poses_differ_by(&fused.transform, &pose.transform());
            let bound = 0.1 * tolerance / fused.singular_values[1];
            assert!(error < bound, "{context}: {solver} off by {error:e}, {bound:e} allowed");
        }
    }
}

// --- The surface pair ----------------------------------------------------------------

#[derive(Deserialize)]
struct Pair<S> {
    source: S,
    target: S,
}

#[derive(Deserialize)]
struct SurfacePair {
    neighbors: usize,
    #[serde(flatten)]
    sides: Pair<Scan>,
}

#[derive(Deserialize)]
struct Scan {
    points: Vec<Vec3>,
    viewpoint: Vec3,
}

#[derive(Deserialize)]
struct Stages {
    neighbours: Vec<Vec<u32>>,
    normals: Vec<Vec3>,
    curvature: Vec<f64>,
    fpfh_pcl: Vec<Vec<f64>>,
    fpfh_open3d: Vec<Vec<f64>>,
}

impl Stages {
    fn fpfh(&self, scale: HistogramScale) -> &[Vec<f64>] {
        match scale {
            HistogramScale::Pcl => &self.fpfh_pcl,
            HistogramScale::Open3d => &self.fpfh_open3d,
        }
    }
}

#[derive(Deserialize)]
struct Expected {
    #[serde(flatten)]
    sides: Pair<Stages>,
    registrations: Vec<Registration>,
}

#[derive(Deserialize)]
struct Registration {
    scale: HistogramScale,
    beta: f64,
    #[serde(flatten)]
    solved: Solved,
}

const SCALES: [HistogramScale; 2] = [HistogramScale::Pcl, HistogramScale::Open3d];

/// One side of the pair: the scan, its neighbourhoods by the crate, and the answers.
struct Side {
    cloud: PointCloud,
    neighbors: Neighbors,
    expected: Stages,
}

fn surface_pair() -> ([Side; 2], Vec<Registration>) {
    let given: SurfacePair = read("surface_pair", "input");
    let Expected { sides, registrations } = read("surface_pair", "expected");
    let side = |scan: &Scan, expected| {
        let cloud = PointCloud::new(&scan.points).unwrap().with_viewpoint(scan.viewpoint).unwrap();
        let k = Neighborhood::Nearest(given.neighbors);
        Side { neighbors: Neighbors::find(cloud.points(), k).unwrap(), cloud, expected }
    };
    let Pair { source, target } = &given.sides;
    ([side(source, sides.source), side(target, sides.target)], registrations)
}

fn descriptors(rows: &[Vec<f64>]) -> Descriptors {
    let values = rows.iter().flatten().map(|&x| x as f32).collect();
    Descriptors::new(rows[0].len(), values).unwrap()
}

fn described<'a>(cloud: &'a PointCloud, descriptors: &'a Descriptors) -> Described<'a> {
    Described { points: cloud.points(), origin: cloud.origin(), descriptors }
}

#[test]
fn neighbours_are_the_same_and_nearest_first() {
    for Side { cloud, neighbors, expected } in surface_pair().0 {
        let tree = SearchTree::new(cloud.points()).unwrap();
        for (i, row) in expected.neighbours.iter().enumerate() {
            let sorted = |row: &[u32]| {
                let mut row = row.to_vec();
                row.sort_unstable();
                row
            };
            assert_eq!(sorted(neighbors.of(i)), sorted(row), "of point {i}");
            let found = tree.k_nearest(&cloud.points()[i], row.len());
            let indices: Vec<u32> = found.iter().map(|neighbor| neighbor.index).collect();
            assert_eq!(sorted(&indices), sorted(row), "of point {i}, by the tree");
            // In order, but for those that the five roundings of an f32 d² cannot tell apart.
            for (neighbor, &j) in found.iter().zip(row) {
                let [p, q] = [i, j as usize].map(|k| cloud.position(k));
                let want: f64 = (0..3).map(|axis| (p[axis] - q[axis]).powi(2)).sum();
                let error = (f64::from(neighbor.squared_distance) - want).abs();
                assert!(error <= 3e-7 * want, "point {i}, neighbour {j}: {error:e}");
            }
        }
    }
}

#[test]
fn normals_and_curvature_are_the_same() {
    for Side { cloud, neighbors, expected } in surface_pair().0 {
        let found = normals::estimate(&cloud, &neighbors, Orientation::Viewpoint).unwrap();
        assert!(rows_differ_by(&found.vectors, &expected.normals) < ROUNDED);
        let curvature: Vec<[f64; 1]> = expected.curvature.iter().map(|&x| [x]).collect();
        let found: Vec<[f32; 1]> = found.curvature.iter().map(|&x| [x]).collect();
        assert!(rows_differ_by(&found, &curvature) < ROUNDED);
    }
}

#[test]
fn histograms_are_the_same_on_both_scales() {
    for Side { cloud, neighbors, expected } in surface_pair().0 {
        let normals: Vec<[f32; 3]> = expected.normals.iter().map(|n| n.map(|x| x as f32)).collect();
        for scale in SCALES {
            let found = descriptor::fpfh(cloud.points(), &normals, &neighbors, scale).unwrap();
            for (i, (row, want)) in found.rows().zip(expected.fpfh(scale)).enumerate() {
                let row: [f32; BINS] = row.try_into().unwrap();
                let want: [f64; BINS] = want[..].try_into().unwrap();
                let error = rows_differ_by(&[row], &[want]);
                assert!(error < HISTOGRAM, "{scale}, point {i}: {error:e}");
            }
        }
    }
}

#[test]
fn weighted_connections_have_the_same_moments_and_pose() {
    let ([source, target], registrations) = surface_pair();
    for Registration { scale, beta, solved } in registrations {
        let [from, to] = [&source, &target].map(|side| descriptors(side.expected.fpfh(scale)));
        let connection =
            FullConnection::new(described(&source.cloud, &from), described(&target.cloud, &to));
        let found = connection
            .unwrap()
            .scheme_moments(WeightScheme::Gaussian, beta, Normalization::None)
            .unwrap();
        solved.check(&found, MOMENTS_TIMES_BETA / beta, &format!("{scale}, beta {beta}"));
    }
}

#[test]
fn the_whole_way_from_points_to_pose_is_the_same() {
    let (sides, registrations) = surface_pair();
    for Registration { scale, beta, solved } in registrations {
        let [from, to] = [0, 1].map(|side| {
            let Side { cloud, neighbors, .. } = &sides[side];
            let found = normals::estimate(cloud, neighbors, Orientation::Viewpoint).unwrap();
            descriptor::fpfh(cloud.points(), &found.vectors, neighbors, scale).unwrap()
        });
        let [source, target] = &sides;
        let connection =
            FullConnection::new(described(&source.cloud, &from), described(&target.cloud, &to));
        let found = connection
            .unwrap()
            .scheme_moments(WeightScheme::Gaussian, beta, Normalization::None)
            .unwrap();
        solved.check(&found, MOMENTS_TIMES_BETA / beta, &format!("{scale}, beta {beta}"));
    }
}

// --- Weights -------------------------------------------------------------------------

#[derive(Deserialize)]
struct WeightsInput {
    beta: f64,
    nu: f32,
    #[serde(flatten)]
    sides: Pair<DescribedPoints>,
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
    solved: Solved,
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
    let WeightsInput { beta, nu, sides: Pair { source, target } } = read("weights", "input");
    let clouds = [&source, &target].map(|side| PointCloud::new(&side.points).unwrap());
    let rows = [&source, &target].map(|side| descriptors(&side.descriptors));
    let connection =
        FullConnection::new(described(&clouds[0], &rows[0]), described(&clouds[1], &rows[1]))
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
    solved: Solved,
}

#[test]
fn weights_of_points_have_the_same_moments_and_pose() {
    let WeightsInput { beta, sides: Pair { source, target }, .. } = read("weights", "input");
    let PointWeights { source_weights, target_weights } = read("point_weights", "input");
    let clouds = [&source, &target].map(|side| PointCloud::new(&side.points).unwrap());
    let rows = [&source, &target].map(|side| descriptors(&side.descriptors));
    let connection =
        FullConnection::new(described(&clouds[0], &rows[0]), described(&clouds[1], &rows[1]))
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
    rigid: Option<Pose>,
    similarity: Option<Pose>,
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
                        Err(Error::NoWeight) => assert_eq!(moments.weight, 0.0, "{name}"),
                        Err(Error::Degenerate { rank, .. }) => assert_eq!(rank, 1, "{name}"),
                        other => panic!("{name}, {solver}: {other:?}"),
                    }
                    continue;
                };
                let found = found.unwrap().transform;
                let error = poses_differ_by(&found, &want.transform());
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
