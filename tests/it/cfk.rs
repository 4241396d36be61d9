//! Keypoints and the full connection of them: what is found, how it follows the clouds,
//! and what happens with too few.

use crate::common;

use std::collections::BTreeSet;

use cfreg::cloud::shape::boulder;
use cfreg::descriptor::{HistogramScale, fpfh};
use cfreg::keypoint::{Iss, Keypoints, Sift};
use cfreg::math::{self, Vec3};
use cfreg::method::{Cfk, FeatureConfig, Method, Register, Registration, Timings};
use cfreg::moments::FullConnection;
use cfreg::normals::{self, Orientation};
use cfreg::search::{Neighborhood, Neighbors};
use cfreg::verify::{MIN_KEYPOINTS, Warning};
use cfreg::weight::{Normalization, WeightScheme};
use cfreg::{Error, PointCloud, Transform, par};
use serde::Deserialize;

const K: usize = 60;

fn cloud(points: usize, seed: u64) -> PointCloud {
    boulder().sample(points, seed).unwrap().with_viewpoint([0.0; 3]).unwrap()
}

fn curvature(cloud: &PointCloud) -> Vec<f32> {
    let neighbors = Neighbors::find(cloud.points(), Neighborhood::Nearest(K)).unwrap();
    normals::estimate(cloud, &neighbors, Orientation::Viewpoint).unwrap().curvature
}

fn detectors() -> [Keypoints; 2] {
    [Keypoints::default(), Keypoints::Iss(Iss::default())]
}

fn detect(keypoints: &Keypoints, cloud: &PointCloud) -> Vec<usize> {
    keypoints.detect(cloud.points(), &curvature(cloud)).unwrap()
}

fn cfk(keypoints: Keypoints) -> Cfk {
    let mut cfk = Cfk { keypoints, ..Cfk::default() };
    cfk.cf.features.neighborhood = Neighborhood::Nearest(K);
    cfk
}

/// Share of the larger set that both have.
fn shared(a: &[usize], b: &[usize]) -> f64 {
    let (a, b): (BTreeSet<_>, BTreeSet<_>) = (a.iter().collect(), b.iter().collect());
    a.intersection(&b).count() as f64 / a.len().max(b.len()).max(1) as f64
}

#[derive(Deserialize)]
struct Given {
    sift: Vec<Sift>,
    iss: Vec<Iss>,
    surfaces: Vec<Surface>,
}

#[derive(Deserialize)]
struct Surface {
    points: Vec<[f32; 3]>,
    values: Vec<f32>,
}

#[derive(Deserialize)]
struct Expected {
    /// A keypoint: the point, or the points any of which is right.
    sift: Vec<Vec<Vec<usize>>>,
    iss: Vec<Vec<usize>>,
}

#[test]
fn keypoints_are_those_of_the_reference() {
    let given: Given = common::golden::read("keypoints", "input");
    let expected: Vec<Expected> = common::golden::read("keypoints", "expected");
    for (Surface { points, values }, expected) in given.surfaces.iter().zip(expected) {
        // Lengths of the case are in the unit of its surfaces.
        for (&sift, keypoints) in given.sift.iter().zip(&expected.sift) {
            let sift = Sift { unit: Some(sift.min_scale), min_scale: 1.0, ..sift };
            let found = sift.detect(points, values).unwrap();
            let known = |i: &usize| keypoints.iter().any(|right| right.contains(i));
            assert!(found.iter().all(known), "{sift:?}: {found:?}, not {keypoints:?}");
            let hit = |right: &Vec<usize>| right.iter().any(|i| found.contains(i));
            assert!(keypoints.iter().all(hit), "{sift:?}: {found:?}, not {keypoints:?}");
        }
        for (&iss, keypoints) in given.iss.iter().zip(&expected.iss) {
            let found = Iss { unit: Some(1.0), ..iss }.detect(points).unwrap();
            assert_eq!(&found, keypoints, "{iss:?}");
        }
    }
}

#[test]
fn keypoints_follow_the_order_of_points_exactly() {
    let one = cloud(1500, 4);
    let values = curvature(&one);
    let order: Vec<usize> = (0..one.len()).map(|i| (i * 7 + 11) % one.len()).collect();
    let other = one.select(&order);
    let other_values: Vec<f32> = order.iter().map(|&i| values[i]).collect();
    for keypoints in detectors() {
        let want = keypoints.detect(one.points(), &values).unwrap();
        let found = keypoints.detect(other.points(), &other_values).unwrap();
        let mut found: Vec<usize> = found.into_iter().map(|i| order[i]).collect();
        found.sort_unstable();
        assert!(want.len() >= 20, "{}: {}", keypoints.name(), want.len());
        assert_eq!(found, want, "{}", keypoints.name());
    }
}

#[test]
fn keypoints_ignore_map_offsets_units_and_threads() {
    let one = cloud(1500, 4);
    let snapped: Vec<Vec3> =
        one.positions().map(|p| p.map(|x| (x * 65536.0).round() / 65536.0)).collect();
    let near = PointCloud::new(&snapped).unwrap().with_viewpoint([0.0; 3]).unwrap();
    let offset = [5e5, 5.6e6, -300.0];
    let far: Vec<Vec3> = snapped.iter().map(|&p| math::add(p, offset)).collect();
    let far = PointCloud::new(&far).unwrap().with_viewpoint(offset).unwrap();
    let unit: Vec<Vec3> = snapped.iter().map(|&p| math::scaled(p, 1024.0)).collect();
    let unit = PointCloud::new(&unit).unwrap().with_viewpoint([0.0; 3]).unwrap();
    for keypoints in detectors() {
        let want = detect(&keypoints, &near);
        assert_eq!(detect(&keypoints, &far), want, "{}", keypoints.name());
        assert_eq!(detect(&keypoints, &unit), want, "{}", keypoints.name());
        for threads in [1, 2, 3, 7] {
            let found = par::with_threads(threads, || detect(&keypoints, &near)).unwrap();
            assert_eq!(found, want, "{} on {threads} threads", keypoints.name());
        }
    }
}

/// ISS knows no axes. SIFT thins by a grid along them: turned in it, the cloud has other
/// means and about two thirds of its keypoints.
#[test]
fn keypoints_under_a_rotation() {
    let still = cloud(3000, 4);
    let motion = Transform {
        translation: [0.3, -0.2, 0.5],
        ..Transform::from_rotation_vector([0.4, -1.3, 0.7])
    };
    let moved = still.transformed(&motion).unwrap();
    for (keypoints, least) in detectors().into_iter().zip([0.35, 0.99]) {
        let share = shared(&detect(&keypoints, &still), &detect(&keypoints, &moved));
        assert!(share >= least, "{}: {share}", keypoints.name());
    }
}

#[test]
fn keypoints_are_described_from_all_points_around() {
    let source = cloud(1500, 1);
    let target = cloud(1400, 2);
    let cfk = cfk(Keypoints::default());
    let mut times = Timings::default();
    let mut prepare = |cloud| {
        cfk.cf.features.extract_at_keypoints(cloud, "it", Some(&cfk.keypoints), &mut times).unwrap()
    };
    for cloud in [&source, &target] {
        let neighbors = Neighbors::find(cloud.points(), Neighborhood::Nearest(K)).unwrap();
        let normals = normals::estimate(cloud, &neighbors, Orientation::Viewpoint).unwrap();
        let all = fpfh(cloud.points(), &normals.vectors, &neighbors, HistogramScale::Pcl).unwrap();
        let rows = cfk.keypoints.detect(cloud.points(), &normals.curvature).unwrap();
        let prepared = prepare(cloud);
        let described = prepared.view();
        assert_eq!(prepared.counts().keypoints, Some(rows.len()));
        assert_eq!(described.descriptors, &all.select(&rows));
        assert!(rows.iter().zip(described.points).all(|(&row, p)| *p == cloud.points()[row]));
    }
    // And the answer is one solve on the connection of these.
    let [a, b] = [&source, &target].map(&mut prepare);
    let connection = FullConnection::new(a.view(), b.view()).unwrap();
    let moments =
        connection.scheme_moments(WeightScheme::Gaussian, 100.0, Normalization::None).unwrap();
    let found = cfk.register(&source, &target).unwrap();
    assert_eq!(found.moments, moments);
    assert_eq!(found.connections, (a.view().points.len() * b.view().points.len()) as u64);
}

/// Two samples share few points of ISS, and the pose is coarse.
#[test]
fn any_rotation_is_found_from_keypoints() {
    let (vectors, bounds) = ([[0.0, 2.9, 0.5], [1.0, -1.0, 0.2]], [15.0, 40.0]);
    for ((keypoints, vector), bound) in detectors().into_iter().zip(vectors).zip(bounds) {
        let truth =
            Transform { translation: [0.3, -0.1, 0.2], ..Transform::from_rotation_vector(vector) };
        let source = cloud(3000, 1);
        let target = cloud(3000, 2).transformed(&truth).unwrap();
        let found = cfk(keypoints).register(&source, &target).unwrap();
        let error = cfreg::verify::pose_error(&found.transform, &truth, source.centroid());
        assert!(error.rotation_deg < bound, "{}: {error:?}", keypoints.name());
        let counts = [found.points.source, found.points.target];
        for (cloud, count) in [&source, &target].into_iter().zip(counts) {
            let detected = detect(&keypoints, cloud).len();
            assert_eq!(count.keypoints, Some(detected), "{}", keypoints.name());
            assert!(count.described <= detected && count.used == cloud.len());
        }
    }
}

/// A contrast between those of the keypoints of the source, so that `count` of them stay.
fn contrast_that_leaves(count: usize, source: &PointCloud) -> f64 {
    let left = |contrast| {
        detect(&Keypoints::Sift(Sift { min_contrast: contrast, ..Sift::default() }), source).len()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match left(middle) {
            n if n == count => return middle,
            n if n > count => low = middle,
            _ => high = middle,
        }
    }
    panic!("no contrast leaves {count} keypoints");
}

fn with_contrast(contrast: f64, source: &PointCloud) -> cfreg::Result<Registration> {
    let sift = Sift { min_contrast: contrast, ..Sift::default() };
    cfk(Keypoints::Sift(sift)).register(source, source)
}

#[test]
fn too_few_keypoints_are_refused_and_few_are_doubted() {
    let source = cloud(1500, 1);
    for count in [0, 1, 2] {
        let contrast = if count == 0 { 1.0 } else { contrast_that_leaves(count, &source) };
        let error = with_contrast(contrast, &source).unwrap_err();
        let Error::TooFewPoints { what, found, needed } = &error else { panic!("{error}") };
        assert_eq!((*found, *needed), (count, 3));
        assert!(what.contains("sift") && what.contains("lower its thresholds"), "{what}");
    }
    for count in [3, MIN_KEYPOINTS - 1, MIN_KEYPOINTS] {
        let found = with_contrast(contrast_that_leaves(count, &source), &source).unwrap();
        let doubt = Warning::FewKeypoints { found: count, needed: MIN_KEYPOINTS };
        assert_eq!(found.points.source.keypoints, Some(count));
        assert_eq!(found.doubts.contains(&doubt), count < MIN_KEYPOINTS, "{:?}", found.doubts);
        assert!(count >= MIN_KEYPOINTS || !found.trusted);
    }
}

#[test]
fn a_plane_has_no_keypoints_and_says_so() {
    let flat: Vec<Vec3> = (0..900).map(|i| [f64::from(i % 30), f64::from(i / 30), 0.0]).collect();
    let flat = PointCloud::new(&flat).unwrap();
    for keypoints in detectors() {
        let found = cfk(keypoints).register(&flat, &flat);
        assert!(matches!(found, Err(Error::TooFewPoints { needed: 3, .. })), "{found:?}");
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads_and_in_every_run() {
    let (source, target) = (cloud(1500, 1), cloud(1400, 2));
    for keypoints in detectors() {
        let run = |threads| {
            let mut cfk = cfk(keypoints);
            cfk.cf.threads = threads;
            let found = cfk.register(&source, &target).unwrap();
            (found.transform, found.moments, found.points)
        };
        let first = run(1);
        assert!([1, 2, 3, 7].into_iter().all(|threads| run(threads) == first));
    }
}

#[test]
fn hostile_settings_are_errors() {
    let source = cloud(300, 1);
    let method: Method = "cfk".parse().unwrap();
    let refused = |json: serde_json::Value| {
        let method = method.clone().with([("keypoints", json.clone())]);
        match method.and_then(|method| method.register(&source, &source)) {
            Err(Error::Config { .. } | Error::Setting { .. }) => {}
            found => panic!("{json}: {found:?}"),
        }
    };
    for (field, value) in [
        ("min_scale", "-1"),
        ("min_scale", "1e300"),
        ("octaves", "0"),
        ("octaves", "18446744073709551615"),
        ("scales", "1000000"),
        ("min_contrast", "-0.1"),
        ("unit", "0"),
        ("unit", "1e308"),
        ("min_scal", "1"),
        ("scales", "\"many\""),
    ] {
        let value: serde_json::Value = serde_json::from_str(value).unwrap();
        refused(serde_json::json!({ "sift": { field: value } }));
    }
    for (field, value) in [
        ("salient_radius", "1e9"),
        ("non_max_radius", "0"),
        ("gamma21", "2"),
        ("gamma32", "-1"),
        ("min_neighbors", "0"),
        ("min_scale", "1"),
    ] {
        let value: serde_json::Value = serde_json::from_str(value).unwrap();
        refused(serde_json::json!({ "iss": { field: value } }));
    }
    refused(serde_json::json!({ "harris": {} }));
    refused(serde_json::json!(7));
    // Within the ranges, at their ends: whatever comes, no panic.
    for sift in [
        Sift { min_scale: 1e3, octaves: 16, scales: 16, ..Sift::default() },
        Sift { min_scale: 1e-3, octaves: 16, scales: 1, ..Sift::default() },
        Sift { unit: Some(1e-15), min_scale: 1e-3, ..Sift::default() },
        Sift { unit: Some(1e15), min_scale: 1e3, ..Sift::default() },
    ] {
        let _ = cfk(Keypoints::Sift(sift)).register(&source, &source);
    }
    for iss in [
        Iss { salient_radius: 1e3, non_max_radius: 1e-3, ..Iss::default() },
        Iss { unit: Some(1e15), min_neighbors: usize::MAX, ..Iss::default() },
    ] {
        let _ = cfk(Keypoints::Iss(iss)).register(&source, &source);
    }
}

#[test]
fn real_scans_have_keypoints_that_register_them() {
    let Some(data) = common::shared_data() else { return };
    for file in ["stanford_bunny/bun000.ply", "kitti00/000000.ply"] {
        let scan = cfreg::io::read(data.join(file)).unwrap();
        let scan = cfreg::filter::sample(&scan, 6000, 0).with_viewpoint([0.0; 3]).unwrap();
        let truth = Transform {
            translation: [0.01, -0.02, 0.03],
            ..Transform::from_rotation_vector([1.0, -2.0, 0.5])
        };
        let moved = scan.transformed(&truth).unwrap();
        for keypoints in detectors() {
            let cfk = Cfk { keypoints, ..Cfk::default() };
            assert_eq!(cfk.cf.features, FeatureConfig::default());
            let found = cfk.register(&scan, &moved).unwrap();
            let error = cfreg::verify::pose_error(&found.transform, &truth, scan.centroid());
            let what = format!("{file} {}: {error:?} {:?}", keypoints.name(), found.points);
            assert!(error.rotation_deg < 5.0, "{what}");
            assert!(found.points.source.keypoints > Some(100), "{what}");
        }
    }
}
