//! CF-spectral: connections and weights are those of the independent f64 reference; the pose follows
//! the clouds and nothing else; half an overlap is enough.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::math::Vec3;
use cfreg::method::{Cf, CfSpectral, Method, Register};
use cfreg::moments::{FullConnection, WeightedPair, moments_of_pairs};
use cfreg::normals::Orientation;
use cfreg::search::Neighborhood;
use cfreg::verify::pose_error;
use cfreg::weight::{Compatibility, ConnectionEnds, Normalization, WeightScheme};
use cfreg::{Error, PointCloud, Transform};
use common::golden::{
    ExpectedSolution, GoldenPair, MOMENTS_TIMES_BETA, descriptors, feature_view, read,
};
use serde::Deserialize;

#[derive(Deserialize)]
struct DescribedPoints {
    points: Vec<Vec3>,
    descriptors: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Given {
    beta: f64,
    connections: usize,
    unit: f64,
    compatibility: Compatibility,
    source_normals: Vec<[f32; 3]>,
    target_normals: Vec<[f32; 3]>,
}

#[derive(Deserialize)]
struct Expected {
    pairs: Vec<(u32, u32)>,
    first: Vec<f64>,
    second: Vec<f64>,
    eigenvalues: [f64; 2],
    #[serde(flatten)]
    solved: ExpectedSolution,
}

#[test]
fn connections_weights_and_pose_are_those_of_the_reference() {
    let GoldenPair::<DescribedPoints> { source, target } = read("weights", "input");
    let (given, expected): (Given, Expected) =
        (read("spectral", "input"), read("spectral", "expected"));
    let clouds = [&source, &target].map(|side| PointCloud::new(&side.points).unwrap());
    let rows = [&source, &target].map(|side| descriptors(&side.descriptors));
    let [from, onto] = [0, 1].map(|side| feature_view(&clouds[side], &rows[side]));
    let connection = FullConnection::new(from, onto).unwrap();
    let (scheme, both) = (WeightScheme::Gaussian, Normalization::Both);
    let found = connection.strongest(scheme, given.beta, both, given.connections).unwrap();
    let sorted = |mut pairs: Vec<(u32, u32)>| {
        pairs.sort_unstable();
        pairs
    };
    let pairs: Vec<(u32, u32)> = found.iter().map(|pair| (pair.source, pair.target)).collect();
    assert_eq!(sorted(pairs), sorted(expected.pairs.clone()));
    let first: f64 = found.iter().map(|pair| pair.weight).sum();
    let want: f64 = expected.first.iter().sum();
    assert!((first / want - 1.0).abs() < MOMENTS_TIMES_BETA / given.beta, "{first} {want}");

    // In the order of the reference, which differs where weights differ by rounding.
    let at = |values: &[[f32; 3]], index: fn(&(u32, u32)) -> u32| -> Vec<[f32; 3]> {
        expected.pairs.iter().map(|pair| values[index(pair) as usize]).collect()
    };
    let points = [at(from.points, |pair| pair.0), at(onto.points, |pair| pair.1)];
    let normals =
        [at(&given.source_normals, |pair| pair.0), at(&given.target_normals, |pair| pair.1)];
    let [source, target] =
        [0, 1].map(|side| ConnectionEnds { points: &points[side], normals: Some(&normals[side]) });
    let found = given.compatibility.second_order_weights(source, target, given.unit).unwrap();
    for (found, want) in found.eigenvalues.iter().zip(expected.eigenvalues) {
        assert!((found / want - 1.0).abs() < 1e-6, "{found} {want}");
    }
    // The power method ends at steps of 1e-7 for a vector of length 1, whose entries are some 0.06.
    for (found, want) in found.weights.iter().zip(&expected.second) {
        assert!((found - want).abs() < 1e-5, "{found} {want}");
    }
    let pairs: Vec<WeightedPair> = expected
        .pairs
        .iter()
        .zip(&found.weights)
        .map(|(&(source, target), &weight)| WeightedPair { source, target, weight })
        .collect();
    let moments = moments_of_pairs(&clouds[0], &clouds[1], &pairs).unwrap();
    expected.solved.check(&moments, 1e-5, "spectral");
}

/// Two samples of an object of which each misses another third, the target moved.
fn partial_clouds(motion: &Transform) -> [PointCloud; 2] {
    let part = |seed, side: f64| {
        let cloud = boulder().sample(3000, seed).unwrap().with_viewpoint([0.0; 3]).unwrap();
        let kept = (0..cloud.len()).filter(|&i| side * cloud.position(i)[0] > -0.3);
        cloud.select(&kept.collect::<Vec<_>>())
    };
    [part(1, 1.0), part(2, -1.0).transformed(motion).unwrap()]
}

fn motion() -> Transform {
    let turn = Transform::from_rotation_vector([0.7, -1.9, 1.1]);
    Transform { translation: [3.0, -2.0, 9.0], ..turn }
}

fn degrees(found: &Transform, truth: &Transform) -> f64 {
    pose_error(found, truth, [0.0; 3]).rotation_deg
}

#[test]
fn half_an_overlap_is_enough_for_one_step() {
    let [source, target] = partial_clouds(&motion());
    let found = CfSpectral::default().register(&source, &target).unwrap();
    let error = degrees(&found.transform, &motion());
    // Right, as one step is counted.
    assert!(error < 10.0, "{error}");
    assert_eq!((found.iterations, found.method.name.as_str()), (1, "cf-spectral"));
    assert!(found.connections <= 2000 && found.effective_connections > 50.0, "{found:?}");
    let full = Cf::default().register(&source, &target).unwrap();
    let without = degrees(&full.transform, &motion());
    assert!(without > 2.0 * error.max(1.0), "{without}");
}

#[test]
fn the_pose_follows_motion_order_exchange_and_threads() {
    let [source, target] = partial_clouds(&motion());
    let method = CfSpectral::default();
    let pose = |source: &PointCloud, target: &PointCloud| {
        method.register(source, target).unwrap().transform
    };
    let found = pose(&source, &target);
    // f32 coordinates of moved clouds differ in their last bits, which decide about some bins of
    // descriptors, and with them about some connections.
    let other = Transform {
        translation: [-5.0, 1.0, 2.0],
        ..Transform::from_rotation_vector([2.0, 0.4, -0.8])
    };
    let moved = pose(&source.transformed(&other).unwrap(), &target).after(&other);
    assert!(degrees(&moved, &found) < 0.3, "{}", degrees(&moved, &found));
    let exchanged = pose(&target, &source).inverse();
    assert!(degrees(&exchanged, &found) < 0.3, "{}", degrees(&exchanged, &found));
    let order: Vec<usize> = (0..source.len()).map(|i| (i * 7 + 5) % source.len()).collect();
    assert_ne!(source.len() % 7, 0);
    let permuted = pose(&source.select(&order), &target);
    assert!(degrees(&permuted, &found) < 0.3, "{}", degrees(&permuted, &found));
    for threads in [1, 2, 5] {
        let again = CfSpectral { threads, ..method.clone() };
        assert_eq!(again.register(&source, &target).unwrap().transform, found, "{threads}");
    }
}

#[test]
fn the_unit_changes_only_rounding() {
    let [source, target] = partial_clouds(&motion());
    let scaled = |cloud: &PointCloud| {
        cloud.transformed(&Transform { scale: 1024.0, ..Transform::IDENTITY }).unwrap()
    };
    let found = CfSpectral::default().register(&source, &target).unwrap().transform;
    let other = CfSpectral::default().register(&scaled(&source), &scaled(&target)).unwrap();
    // A cloud keeps its points about a round number, so that even powers of two round a little.
    let off = found.after(&other.transform.inverse());
    assert!(off.angle() < 1e-6, "{}", off.angle());
}

#[test]
fn large_clouds_are_downsampled_to_one_voxel_size() {
    let [source, target] = [1, 2].map(|seed| boulder().sample(20_000, seed).unwrap());
    let found = CfSpectral::default().register(&source, &target).unwrap();
    assert!(degrees(&found.transform, &Transform::IDENTITY) < 2.0);
    let (used, described) = (found.points.source.used, found.points.source.described);
    assert!(used == 20_000 && (2000..4500).contains(&described), "{used} {described}");
    // The voxel size is in the record: the same again with it.
    let voxel = found.method.settings["voxel"].as_f64();
    assert!(voxel.is_some());
    let again = CfSpectral { voxel, ..CfSpectral::default() };
    assert_eq!(again.register(&source, &target).unwrap().transform, found.transform);
    let record: Method = found.method.parse().unwrap();
    assert_eq!(record, Method::CfSpectral(again));
    let coarse = CfSpectral { voxel: Some(10.0 * source.diagonal()), ..CfSpectral::default() };
    let refused = coarse.register(&source, &target);
    assert!(matches!(refused, Err(Error::TooFewPoints { .. })), "{refused:?}");
}

#[test]
fn settings_that_are_missing_have_their_own_defaults() {
    let method: Method = serde_json::from_str(r#"{"method": "cf-spectral"}"#).unwrap();
    assert_eq!(method, "cf-spectral".parse().unwrap());
    let json =
        r#"{"method": "cf-spectral", "connections": 500, "compatibility": {"min_length": 3}}"#;
    let Ok(Method::CfSpectral(method)) = serde_json::from_str(json) else { panic!() };
    let compatibility = Compatibility { min_length: 3.0, ..Compatibility::default() };
    let want = CfSpectral { connections: 500, compatibility, ..CfSpectral::default() };
    assert_eq!(method, want);
    assert_eq!(method.features.neighborhood, Neighborhood::Nearest(100));
    assert_eq!(method.features.orientation, Orientation::Viewpoint);
    let bad = |method: CfSpectral| match method.validate() {
        Err(Error::Config { field, .. }) => field,
        other => panic!("{other:?}"),
    };
    for voxel in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(bad(CfSpectral { voxel: Some(voxel), ..CfSpectral::default() }), "voxel");
    }
    for connections in [0, 2, 1_000_000] {
        assert_eq!(bad(CfSpectral { connections, ..CfSpectral::default() }), "connections");
    }
}

#[test]
fn clouds_without_an_answer_are_errors() {
    let point = PointCloud::new(&[[1.0, 2.0, 3.0]; 50]).unwrap();
    let line = PointCloud::new(&(0..50).map(|i| [f64::from(i), 0.0, 0.0]).collect::<Vec<_>>());
    let cloud = boulder().sample(300, 1).unwrap();
    let line = line.unwrap();
    for (source, target) in [(&point, &cloud), (&cloud, &point), (&line, &line), (&point, &point)] {
        assert!(CfSpectral::default().register(source, target).is_err());
    }
}
