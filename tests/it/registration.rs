//! Whole registrations: how the answer must follow the clouds, and what odd clouds get.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::math::{self, Vec3};
use cfreg::method::{Cf, DescriptorScale, FeatureConfig, Register, Registration};
use cfreg::search::Neighborhood;
use cfreg::weight::{Bandwidth, Normalization, WeightScheme};
use cfreg::{Error, PointCloud, Transform, verify};
use common::compare;
use proptest::prelude::*;

fn cf() -> Cf {
    let describe =
        FeatureConfig { neighborhood: Neighborhood::Nearest(60), ..FeatureConfig::default() };
    Cf { features: describe, ..Cf::default() }
}

fn pair(seed: u64, points: usize) -> (PointCloud, PointCloud) {
    let seen = |seed| boulder().sample(points, seed).unwrap().with_viewpoint([0.0; 3]).unwrap();
    (seen(2 * seed), seen(2 * seed + 1).transformed(&pose_of_pair()).unwrap())
}

/// The true pose of every [`pair`].
fn pose_of_pair() -> Transform {
    Transform { translation: [0.3, -0.2, 0.1], ..Transform::from_rotation_vector([0.4, 0.9, -0.3]) }
}

fn pose(source: &PointCloud, target: &PointCloud) -> Transform {
    cf().register(source, target).unwrap().transform
}

/// Rotation (degrees) and shift at the source's centre between two poses.
fn apart(a: &Transform, b: &Transform, source: &PointCloud) -> (f64, f64) {
    let error = verify::pose_error(a, b, source.centroid());
    (error.rotation_deg, error.translation)
}

fn motion() -> impl Strategy<Value = Transform> {
    let vector = proptest::array::uniform3(-3.0..3.0f64);
    let shift = proptest::array::uniform3(-2.0..2.0f64);
    (vector, shift).prop_map(|(vector, translation)| Transform {
        translation,
        ..Transform::from_rotation_vector(vector)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    // f32 coordinates of a moved cloud differ in their last bits, so a few of many
    // thousand pair angles change their bin: hence tolerances and not equality.
    #[test]
    fn the_pose_follows_either_cloud(motion in motion(), seed in 0..20u64) {
        let (source, target) = pair(seed, 400);
        let still = pose(&source, &target);
        let moved = pose(&source.transformed(&motion).unwrap(), &target);
        let (angle, shift) = apart(&moved.after(&motion), &still, &source);
        prop_assert!(angle < 0.2 && shift < 0.01, "source: {angle} {shift}");
        let moved = pose(&source, &target.transformed(&motion).unwrap());
        let (angle, shift) = apart(&moved, &motion.after(&still), &source);
        prop_assert!(angle < 0.2 && shift < 0.01, "target: {angle} {shift}");
    }

    #[test]
    fn the_unit_does_not_matter(exponent in -6..7i32, seed in 0..20u64) {
        // Powers of two change no digit, so the answer keeps every bit of its rotation.
        let unit = Transform { scale: 2f64.powi(exponent), ..Transform::IDENTITY };
        let (source, target) = pair(seed, 300);
        let still = pose(&source, &target);
        let scaled = pose(&source.transformed(&unit).unwrap(), &target.transformed(&unit).unwrap());
        let (angle, _) = apart(&scaled, &still, &source);
        prop_assert!(angle < 0.2, "{angle}");
        let shift = math::sub(math::scaled(scaled.translation, 1.0 / unit.scale), still.translation);
        prop_assert!(math::norm(shift) < 0.01);
    }

    #[test]
    fn exchanging_the_clouds_inverts_the_pose(seed in 0..50u64) {
        let (source, target) = pair(seed, 300);
        let there = pose(&source, &target);
        let back = pose(&target, &source);
        let (angle, shift) = apart(&back.inverse(), &there, &source);
        prop_assert!(angle < 1e-3 && shift < 1e-4, "{angle} {shift}");
    }

    #[test]
    fn the_order_of_points_does_not_matter(seed in 0..50u64) {
        let (source, target) = pair(seed, 300);
        let turned: Vec<usize> = (0..source.len()).rev().collect();
        let (angle, shift) = apart(&pose(&source.select(&turned), &target), &pose(&source, &target), &source);
        prop_assert!(angle < 0.05 && shift < 0.005, "{angle} {shift}");
    }
}

#[test]
fn the_same_input_gives_the_same_bits_on_any_number_of_threads() {
    let (source, target) = pair(3, 700);
    for normalization in [Normalization::None, Normalization::Both, Normalization::Sinkhorn(3)] {
        let run = |threads| {
            let cf = Cf { threads, normalization, ..cf() };
            let found = cf.register(&source, &target).unwrap();
            (found.transform, found.moments, found.evaluation, found.singular_values)
        };
        let first = run(1);
        for threads in [1, 2, 3, 7] {
            assert_eq!(first, run(threads), "{normalization} {threads}");
        }
    }
}

#[test]
fn a_map_offset_changes_nothing() {
    // Coordinates as f32 files have them: exact in f64 also beside the offset.
    let snap = |cloud: &PointCloud| -> Vec<Vec3> {
        cloud.positions().map(|p| p.map(|x| (x * 65536.0).round() / 65536.0)).collect()
    };
    let (source, target) = pair(5, 500);
    let (source, target) = (snap(&source), snap(&target));
    let offset = [5e5, 5.6e6, 0.0];
    let far = |points: &[Vec3]| {
        let moved: Vec<Vec3> = points.iter().map(|&p| math::add(p, offset)).collect();
        PointCloud::new(&moved).unwrap()
    };
    let near = pose(&PointCloud::new(&source).unwrap(), &PointCloud::new(&target).unwrap());
    let moved = pose(&far(&source), &far(&target));
    let difference = math::frobenius(&math::mat_sub(&near.rotation, &moved.rotation));
    assert!(difference <= 1e-9, "{difference:e}");
    for &p in &source {
        let want = math::add(near.apply(p), offset);
        let shift = math::norm(math::sub(moved.apply(math::add(p, offset)), want));
        assert!(shift <= 1e-6 * 3.0, "{shift:e}");
    }
}

#[test]
fn identical_clouds_give_the_identity() {
    let (source, _) = pair(1, 500);
    let found = cf().register(&source, &source).unwrap();
    let (angle, shift) = apart(&found.transform, &Transform::IDENTITY, &source);
    assert!(found.trusted && angle < 1e-4 && shift < 1e-5, "{angle} {shift}");
}

#[test]
fn every_kernel_finds_the_pose() {
    let (source, target) = pair(0, 1500);
    let truth = Transform {
        translation: [0.3, -0.2, 0.1],
        ..Transform::from_rotation_vector([0.4, 0.9, -0.3])
    };
    for name in
        ["gaussian", "laplacian", "cauchy", "geman-mcclure", "truncated", "student-t", "tukey"]
    {
        let weights: WeightScheme = name.parse().unwrap();
        let cf =
            Cf { weights, beta: Some(200.0.into()), normalization: Normalization::Both, ..cf() };
        let found = cf.register(&source, &target).unwrap();
        let (angle, _) = apart(&found.transform, &truth, &source);
        assert!(angle < 15.0, "{name}: {angle}");
    }
}

fn cloud(points: &[Vec3]) -> PointCloud {
    PointCloud::new(points).unwrap()
}

fn attempt(source: &PointCloud) -> Result<Registration, Error> {
    cf().register(source, &pair(0, 300).1)
}

#[test]
fn too_few_points_are_named() {
    for n in 0..3 {
        let few = cloud(&[[0.0, 1.0, 2.0], [1.0, 1.0, 0.0]][..n]);
        match attempt(&few) {
            Err(Error::TooFewPoints { what, found, needed: 3 }) => {
                assert_eq!((what.as_str(), found), ("the source", n));
            }
            other => panic!("{n}: {other:?}"),
        }
        let swapped = cf().register(&pair(0, 300).0, &few);
        assert!(matches!(swapped, Err(Error::TooFewPoints { what, .. }) if what == "the target"));
    }
}

#[test]
fn clouds_that_determine_no_rotation_are_degenerate() {
    let lump = cloud(&[[1.0, 2.0, 3.0]; 200]);
    let line: Vec<Vec3> = (0..200).map(|i| math::scaled([1.0, 2.0, -1.0], f64::from(i))).collect();
    for thin in [lump, cloud(&line)] {
        assert!(matches!(attempt(&thin), Err(Error::Degenerate { .. })));
    }
}

#[test]
fn a_plane_is_an_error_or_doubted() {
    let plane: Vec<Vec3> =
        (0..400).map(|i| [f64::from(i % 20), f64::from(i / 20) * 1.3, 5.0]).collect();
    let plane = cloud(&plane);
    match cf().register(
        &plane,
        &plane.transformed(&Transform::from_rotation_vector([0.3, 0.0, 0.2])).unwrap(),
    ) {
        Err(Error::Degenerate { .. }) => {}
        Ok(found) => assert!(!found.trusted, "{found:?}"),
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn clouds_without_common_surface_are_doubted() {
    let (whole, _) = pair(0, 3000);
    let half = |sign: f64| -> PointCloud {
        let side: Vec<usize> =
            (0..whole.len()).filter(|&i| sign * whole.position(i)[0] > 0.05).collect();
        whole.select(&side)
    };
    let found = cf().register(&half(1.0), &half(-1.0)).unwrap();
    assert!(!found.trusted, "{:?}", found.evaluation);
}

#[test]
fn more_neighbours_than_points_means_all_points() {
    let (source, target) = pair(0, 100);
    let describe =
        FeatureConfig { neighborhood: Neighborhood::Nearest(5000), ..FeatureConfig::default() };
    let found = Cf { features: describe, ..Cf::default() }.register(&source, &target).unwrap();
    assert_eq!(found.points.source.neighbors, Some(100));
}

/// A scale with the normals of the first.
fn scale(neighborhood: Neighborhood) -> DescriptorScale {
    DescriptorScale { neighborhood, normal_neighborhood: None }
}

#[test]
fn several_neighbourhoods_and_an_automatic_bandwidth_sharpen_the_pose() {
    let truth = pose_of_pair();
    let sharp = Cf {
        features: FeatureConfig {
            more_scales: vec![scale(Neighborhood::Nearest(120)), scale(Neighborhood::Nearest(240))],
            normal_neighborhood: Some(Neighborhood::Nearest(15)),
            ..cf().features
        },
        beta: Some(Bandwidth::Auto(0.25)),
        normalization: Normalization::Both,
        ..Cf::default()
    };
    let error = |cf: &Cf| -> f64 {
        let error = |seed| {
            let (source, target) = pair(seed, 400);
            let found = cf.register(&source, &target).unwrap();
            assert_eq!(found.method.parse(), Some(cfreg::method::Method::Cf(cf.resolved())));
            assert!(found.beta.unwrap() > 0.0);
            apart(&found.transform, &truth, &source).0
        };
        (0..12).map(error).sum::<f64>() / 12.0
    };
    let (plain, sharp) = (error(&cf()), error(&sharp));
    assert!(sharp < 0.6 * plain, "{sharp} {plain}");
}

#[test]
fn a_point_without_one_of_its_descriptors_is_not_connected() {
    let (source, target) = pair(0, 300);
    let more = |n| FeatureConfig { more_scales: vec![scale(n)], ..cf().features };
    let tiny = more(Neighborhood::Radius(0.09));
    let found = Cf { features: tiny, ..Cf::default() }.register(&source, &target).unwrap();
    let described = found.points.source.described;
    assert!((10..300).contains(&described), "{described}");
    let refused =
        Cf { features: more(Neighborhood::Nearest(2)), ..Cf::default() }.register(&source, &target);
    assert!(matches!(refused, Err(Error::Config { field: "more_neighbors", .. })));
}

#[test]
fn points_that_are_not_finite_are_counted_in_the_answer() {
    let (source, target) = pair(0, 300);
    let mut points: Vec<Vec3> = source.positions().collect();
    points.insert(7, [f64::NAN, 0.0, 0.0]);
    points.push([0.0, f64::INFINITY, 0.0]);
    let spoiled = cloud(&points).with_viewpoint([0.0; 3]).unwrap();
    let found = cf().register(&spoiled, &target).unwrap();
    assert_eq!((found.points.source.dropped, found.points.source.used), (2, 300));
    assert_eq!(found.transform, pose(&source, &target));
}

#[test]
fn settings_out_of_range_name_the_field() {
    let (source, target) = pair(0, 100);
    let field = |cf: Cf| match cf.register(&source, &target) {
        Err(Error::Config { field, .. }) => field,
        other => panic!("{other:?}"),
    };
    assert_eq!(field(Cf { beta: Some((-1.0).into()), ..cf() }), "beta");
    assert_eq!(field(Cf { weights: WeightScheme::StudentT(0.0), ..cf() }), "weights");
    let describe =
        FeatureConfig { neighborhood: Neighborhood::Nearest(1), ..FeatureConfig::default() };
    assert_eq!(field(Cf { features: describe, ..Cf::default() }), "neighbors");
}

#[test]
fn a_tolerance_moves_the_answer_by_less_than_itself() {
    // Above the 5·10⁷ connections below which nothing is left out.
    let (source, target) = pair(3, 7_100);
    let dense = cf().register(&source, &target).unwrap();
    let tolerant = Cf { tolerance: 1e-3, ..cf() }.register(&source, &target).unwrap();
    assert_ne!(dense.moments, tolerant.moments);
    assert!(compare::pose_difference(&dense.transform, &tolerant.transform) < 1e-3);
    assert_eq!(tolerant.method.settings["tolerance"], 1e-3);
    for tolerance in [-1e-9, 1.0, f64::NAN] {
        let refused = Cf { tolerance, ..cf() }.register(&source, &target);
        assert!(matches!(refused, Err(Error::Config { field: "tolerance", .. })));
    }
}
