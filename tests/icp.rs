//! The ICP family: the equations, what the answer must follow, and where it must doubt.

mod common;

use cfreg::experiment::shape::boulder;
use cfreg::math::{self, Vec3};
use cfreg::method::{Icp, Method, Metric, Refine, Register, StopReason};
use cfreg::weight::WeightScheme;
use cfreg::{Error, PointCloud, Transform, quality};

const METRICS: [Metric; 3] = [Metric::Point, Metric::Plane, Metric::Generalized];

fn icp(metric: Metric) -> Icp {
    Icp { metric, ..Icp::default() }
}

fn motion(size: f64) -> Transform {
    let turn = Transform::from_rotation_vector([0.5 * size, -0.3 * size, 0.8 * size]);
    Transform { translation: [0.2 * size, -0.1 * size, 0.3 * size], ..turn }
}

fn pair(size: f64) -> (PointCloud, PointCloud) {
    let sample = |seed| boulder().sample(1500, seed).unwrap();
    (sample(1), sample(2).transformed(&motion(size)).unwrap())
}

fn angle(found: &Transform, want: &Transform) -> f64 {
    quality::truth_error(found, want, [0.0; 3]).rotation_deg
}

#[test]
fn one_step_is_the_double_loops_nearest_points_and_their_rest_is_a_fixed_point() {
    let (source, target) = pair(0.1);
    let found = icp(Metric::Point).register(&source, &target).unwrap();
    assert_eq!(found.stop, StopReason::PoseSettled);
    let mut total = 0.0;
    for p in source.positions() {
        let square = |q: Vec3| {
            let d = math::sub(found.transform.apply(p), q);
            math::dot(d, d)
        };
        total += target.positions().map(square).fold(f64::INFINITY, f64::min);
    }
    let rms = (total / source.len() as f64).sqrt();
    assert!((found.weighted_rms / rms - 1.0).abs() < 1e-4, "{} {rms}", found.weighted_rms);
}

#[test]
fn every_metric_finds_a_small_motion_and_the_surfaces_do_it_in_fewer_steps() {
    let (source, target) = pair(0.15);
    let found = METRICS.map(|metric| icp(metric).register(&source, &target).unwrap());
    for found in &found {
        let off = angle(&found.transform, &motion(0.15));
        assert!(found.trusted && off < 1.0, "{}: {off} {:?}", found.method, found.doubts);
    }
    assert!(found[2].iterations < found[0].iterations);
}

#[test]
fn every_metric_doubts_what_lies_beyond_its_basin() {
    let sample = |seed| boulder().sample(1500, seed).unwrap();
    for turn in [[0.0, 0.0, 2.5], [1.8, 0.0, 1.0], [0.0, 3.0, 0.0]] {
        let truth = Transform::from_rotation_vector(turn);
        let target = sample(2).transformed(&truth).unwrap();
        for metric in METRICS {
            let found = icp(metric).register(&sample(1), &target).unwrap();
            let off = angle(&found.transform, &truth);
            assert!(off < 5.0 || !found.trusted, "{metric:?}: {off}");
        }
    }
}

#[test]
fn unit_and_threads_and_map_offsets_change_nothing() {
    let (source, target) = pair(0.1);
    for metric in METRICS {
        let run = |threads| {
            let icp = Icp { threads, keep: 0.9, reciprocal: true, ..icp(metric) };
            icp.register(&source, &target).unwrap()
        };
        let first = run(1);
        for threads in [2, 5] {
            assert_eq!(first.transform, run(threads).transform, "{metric:?}");
        }
        for scale in [1e-3, 1e4] {
            let unit = Transform { scale, ..Transform::IDENTITY };
            let scaled = |cloud: &PointCloud| cloud.transformed(&unit).unwrap();
            let icp = Icp { keep: 0.9, reciprocal: true, ..icp(metric) };
            let found = icp.register(&scaled(&source), &scaled(&target)).unwrap();
            assert!(angle(&found.transform, &first.transform) < 0.02, "{metric:?} {scale}");
        }
        let far = Transform { translation: [5e5, 5.6e6, 0.0], ..Transform::IDENTITY };
        let moved = |cloud: &PointCloud| cloud.transformed(&far).unwrap();
        let start = Transform::IDENTITY;
        let found = icp(metric).refine(&moved(&source), &moved(&target), &start).unwrap();
        let near = icp(metric).register(&source, &target).unwrap();
        assert!(angle(&found.transform, &near.transform) < 0.02, "{metric:?} far");
    }
}

#[test]
fn robust_weights_and_trimming_resist_outliers() {
    let (source, target) = pair(0.1);
    let mut points: Vec<Vec3> = source.positions().collect();
    points.extend((0..300).map(|i| [3.0 + 0.01 * f64::from(i), 2.0, 1.0]));
    let spoiled = PointCloud::new(&points).unwrap();
    let off = |icp: Icp| angle(&icp.register(&spoiled, &target).unwrap().transform, &motion(0.1));
    let plain = off(Icp::default());
    for robust in [
        Icp { keep: 0.8, ..Icp::default() },
        Icp { weights: WeightScheme::Tukey, bandwidth: Some(0.5), ..Icp::default() },
        Icp { max_distance: Some(0.5), ..Icp::default() },
    ] {
        let with = off(robust);
        assert!(with < 1.0 && plain > 3.0 * with, "{with} {plain}");
    }
}

#[test]
fn nothing_within_the_bound_is_no_weight_and_lines_are_degenerate() {
    let (source, target) = pair(0.1);
    let away = Transform { translation: [50.0, 0.0, 0.0], ..Transform::IDENTITY };
    let line: Vec<Vec3> = (0..200).map(|i| [f64::from(i), 0.0, 0.0]).collect();
    let line = PointCloud::new(&line).unwrap();
    for metric in METRICS {
        let bounded = Icp { max_distance: Some(0.5), ..icp(metric) };
        let found = bounded.refine(&source, &target, &away);
        assert!(matches!(found, Err(Error::NoWeight)), "{found:?}");
        let found = icp(metric).register(&line, &line);
        assert!(matches!(found, Err(Error::Degenerate { .. })), "{found:?}");
    }
}

#[test]
fn a_plane_is_doubted_and_does_not_drift() {
    let at = |i: i32| [f64::from(i % 30), f64::from(i / 30) * 1.3, 0.0];
    let plane = PointCloud::new(&(0..900).map(at).collect::<Vec<_>>()).unwrap();
    let lifted = Transform { translation: [0.0, 0.0, 0.2], ..Transform::IDENTITY };
    let target = plane.transformed(&lifted).unwrap();
    for metric in [Metric::Plane, Metric::Generalized] {
        let found = icp(metric).register(&plane, &target).unwrap();
        assert!(!found.trusted, "{metric:?}");
        let [x, y, z] = found.transform.translation;
        assert!(x.abs() + y.abs() < 0.01 && (z - 0.2).abs() < 0.01, "{x} {y} {z}");
    }
}

#[test]
fn names_make_their_metric_and_the_paper_stops_early() {
    for (name, made) in
        [("icp", "icp"), ("icp-paper", "icp"), ("plane-icp", "plane-icp"), ("gicp", "gicp")]
    {
        assert_eq!(name.parse::<Method>().unwrap().name(), made);
        assert!(Method::NAMES.contains(&name));
    }
    // The paper's objects are a fifth of a unit large: 0.05 squared units is no bar.
    let small = Transform { scale: 0.1, ..Transform::IDENTITY };
    let (source, target) = pair(0.15);
    let scaled = |cloud: &PointCloud| cloud.transformed(&small).unwrap();
    let found = Icp::paper().register(&scaled(&source), &scaled(&target)).unwrap();
    assert_eq!((found.iterations, found.stop), (2, StopReason::ObjectiveSettled));
}
