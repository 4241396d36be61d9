//! Every stage computes what the independent f64 reference computed.
//!
//! `tests/golden/README.md` describes the cases. Each stage is given the reference's own
//! values of the stage before, so that one fault makes one test fail; the last test goes
//! the whole way from points to pose on the crate's own values.

use crate::common;

use cfreg::PointCloud;
use cfreg::descriptor::{self, BINS, HistogramScale};
use cfreg::math::Vec3;
use cfreg::moments::FullConnection;
use cfreg::normals::{self, Orientation};
use cfreg::search::{Neighborhood, Neighbors, SearchTree};
use cfreg::weight::{Normalization, WeightScheme};
use common::compare::row_difference;
use common::golden::{
    ExpectedSolution, GoldenPair, MOMENTS_TIMES_BETA, descriptors, feature_view, read,
};
use serde::Deserialize;

/// f64 arithmetic on the same numbers, then half a unit in the last place of an f32 in
/// [½, 1): a coordinate of a normal.
const ROUNDED: f64 = 3.1e-8;
/// Half a unit in the last place of an f32 up to 256, the largest bin, and of the simple
/// histogram up to 128 that was added to it.
const HISTOGRAM: f64 = 1.2e-5;

#[derive(Deserialize)]
struct SurfacePair {
    neighbors: usize,
    #[serde(flatten)]
    sides: GoldenPair<Scan>,
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
    sides: GoldenPair<Stages>,
    registrations: Vec<Registration>,
}

#[derive(Deserialize)]
struct Registration {
    scale: HistogramScale,
    beta: f64,
    #[serde(flatten)]
    solved: ExpectedSolution,
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
    let GoldenPair { source, target } = &given.sides;
    ([side(source, sides.source), side(target, sides.target)], registrations)
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
            assert_eq!(sorted(neighbors.indices(i)), sorted(row), "of point {i}");
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
        assert!(row_difference(&found.vectors, &expected.normals) < ROUNDED);
        let curvature: Vec<[f64; 1]> = expected.curvature.iter().map(|&x| [x]).collect();
        let found: Vec<[f32; 1]> = found.curvature.iter().map(|&x| [x]).collect();
        assert!(row_difference(&found, &curvature) < ROUNDED);
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
                let error = row_difference(&[row], &[want]);
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
        let connection = FullConnection::new(
            feature_view(&source.cloud, &from),
            feature_view(&target.cloud, &to),
        );
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
        let connection = FullConnection::new(
            feature_view(&source.cloud, &from),
            feature_view(&target.cloud, &to),
        );
        let found = connection
            .unwrap()
            .scheme_moments(WeightScheme::Gaussian, beta, Normalization::None)
            .unwrap();
        solved.check(&found, MOMENTS_TIMES_BETA / beta, &format!("{scale}, beta {beta}"));
    }
}
