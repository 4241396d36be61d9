//! What every method promises, whichever it is.

use cfreg::cloud::shape::boulder;
use cfreg::math;
use cfreg::method::{Cf, Cfk, Method, Pipeline, Register};
use cfreg::par::Interrupt;
use cfreg::verify::pose_error;
use cfreg::weight::{Composite, Gaussian, Normalization, WeightScheme};
use cfreg::{Error, PointCloud, Transform};

/// Two samples of one surface, the second one turned by `angle` radians.
fn pair(points: usize, angle: f64) -> (PointCloud, PointCloud, Transform) {
    let axis = math::normalized([0.3, 0.9, -0.2]);
    let truth = Transform {
        translation: [0.05, -0.03, 0.02],
        ..Transform::from_rotation_vector(math::scaled(axis, angle))
    };
    let seen = |seed| boulder().sample(points, seed).unwrap().with_viewpoint([0.0; 3]).unwrap();
    (seen(1), seen(2).transformed(&truth).unwrap(), truth)
}

fn methods() -> Vec<Method> {
    let method = |name: &&str| {
        let method: Method = name.parse().unwrap();
        // The clouds are small: so are the neighbourhoods that descriptors need.
        method.clone().with([("neighbors", 60.into())]).unwrap_or(method)
    };
    Method::NAMES.iter().map(method).collect()
}

/// A few iterations: enough for promises that hold step by step.
fn short(method: Method) -> Method {
    match method.name() {
        "consensus" | "cf" | "cf-spectral" | "cfk" | "teaser" => method,
        _ => method.with([("max_iterations", 8.into())]).unwrap(),
    }
}

#[test]
fn every_method_finds_a_small_motion() {
    let (source, target, truth) = pair(800, 0.12);
    for method in methods() {
        let found = method.register(&source, &target).unwrap();
        let error = pose_error(&found.transform, &truth, source.centroid());
        let name = method.name();
        // Right: within 10 degrees and 5 % of the size.
        let near = error.translation < 0.05 * source.diagonal();
        assert!(error.rotation_deg < 10.0 && near, "{name}: {error:?}");
        assert_eq!(found.method.name, found.method.parse::<Method>().unwrap().name());
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let (source, target, _) = pair(400, 0.3);
    for method in methods().into_iter().map(short) {
        let run = |threads: usize| {
            let method = method.clone().with([("threads", threads.into())]).unwrap();
            let found = method.register(&source, &target).unwrap();
            (found.transform, found.moments, found.iterations)
        };
        let first = run(1);
        for threads in [1, 2, 3, 7] {
            assert_eq!(first, run(threads), "{} on {threads}", method.name());
        }
    }
}

#[test]
fn the_unit_does_not_matter() {
    let (source, target, _) = pair(400, 0.3);
    // The paper's bound of ICP is a length.
    let without_length = |method: &Method| *method != "icp-paper".parse().unwrap();
    for method in methods().into_iter().filter(without_length).map(short) {
        let one = method.register(&source, &target).unwrap().transform;
        for unit in [1.0 / 1024.0, 4096.0] {
            let scaled = |cloud: &PointCloud| {
                let points: Vec<_> = cloud.positions().map(|p| math::scaled(p, unit)).collect();
                let at = math::scaled(cloud.viewpoint().unwrap(), unit);
                PointCloud::new(&points).unwrap().with_viewpoint(at).unwrap()
            };
            let other = method.register(&scaled(&source), &scaled(&target));
            let other = other.unwrap_or_else(|e| panic!("{}: {e}", method.name())).transform;
            let apart = math::frobenius(&math::mat_sub(&one.rotation, &other.rotation));
            assert!(apart < 1e-4, "{} at {unit}: {apart:e}", method.name());
        }
    }
}

#[test]
fn odd_clouds_are_errors_or_doubted() {
    let (cloud, ..) = pair(300, 0.0);
    let few = PointCloud::new(&[[0.0; 3], [1.0, 0.0, 0.0]]).unwrap();
    let lump = PointCloud::new(&[[1.0, 2.0, 3.0]; 50]).unwrap();
    let line: Vec<_> = (0..200).map(|i| [0.01 * f64::from(i), 0.0, 0.0]).collect();
    let line = PointCloud::new(&line).unwrap();
    for method in methods().into_iter().map(short) {
        let name = method.name();
        for (a, b) in [(&few, &cloud), (&cloud, &few), (&PointCloud::default(), &cloud)] {
            let found = method.register(a, b);
            assert!(matches!(found, Err(Error::TooFewPoints { .. })), "{name}: {found:?}");
        }
        for odd in [&lump, &line] {
            for (a, b) in [(odd, &cloud), (&cloud, odd), (odd, odd)] {
                let trusted = method.register(a, b).is_ok_and(|found| found.trusted);
                assert!(!trusted, "{name}");
            }
        }
    }
}

#[test]
fn flat_clouds_are_errors_or_doubted() {
    // A disc, twice: nothing in it tells how far one has turned on the other.
    let disc = |turn: f64| {
        let at = |i: usize| {
            let (radius, angle) = ((i as f64 / 600.0).sqrt(), 2.399_963 * i as f64 + turn);
            [radius * angle.cos(), radius * angle.sin(), 0.0]
        };
        PointCloud::new(&(0..600).map(at).collect::<Vec<_>>()).unwrap()
    };
    for method in methods().into_iter().map(short) {
        let trusted = method.register(&disc(0.0), &disc(1.0)).is_ok_and(|found| found.trusted);
        assert!(!trusted, "{}", method.name());
    }
}

#[test]
fn methods_that_start_from_a_pose_say_when_they_end_in_a_wrong_one() {
    for angle in [1.8, 2.5, 3.1] {
        let (source, target, truth) = pair(1500, angle);
        for name in ["icp", "plane-icp", "gicp", "kc", "cpd", "dare"] {
            let method: Method = name.parse().unwrap();
            let Ok(found) = method.register(&source, &target) else { continue };
            let error = pose_error(&found.transform, &truth, source.centroid()).rotation_deg;
            assert!(error < 20.0 || !found.trusted, "{name} from {angle}: {error:.0} deg");
        }
    }
}

#[test]
fn a_chain_refines_what_one_step_found() {
    let (source, target, truth) = pair(1500, 2.5);
    for refinement in ["icp", "plane-icp", "gicp", "kc", "cpd"] {
        let chain =
            Pipeline::new("cf".parse().unwrap(), vec![refinement.parse().unwrap()]).unwrap();
        let found = chain.register(&source, &target).unwrap();
        let error = |pose| pose_error(pose, &truth, source.centroid()).rotation_deg;
        let before = found.refined_from.as_ref().unwrap();
        let (first, last) = (error(&before.transform), error(&found.transform));
        assert!(found.trusted && last < 1.0 && last < first, "{refinement}: {first} to {last}");
    }
    assert!(Pipeline::new("cf".parse().unwrap(), vec!["teaser".parse().unwrap()]).is_err());
}

#[test]
fn weights_of_ones_own_register_as_those_of_a_name() {
    let (source, target, _) = pair(500, 0.4);
    let named = Cf { normalization: Normalization::Both, beta: Some(60.0.into()), ..Cf::default() };
    let plain = Cf::default();
    let kernel = Composite::kernel(WeightScheme::Gaussian, 60.0.into());
    let composed =
        Composite::Product(vec![kernel, Composite::Sum(vec![]), Composite::Product(vec![])]);
    let expected = named.register(&source, &target).unwrap();
    let by_kernel = plain
        .register_with(&source, &target, |connection| {
            connection.moments(&Gaussian { beta: 60.0 }, Normalization::Both)
        })
        .unwrap();
    assert_eq!(by_kernel.transform, expected.transform);
    let settings = &by_kernel.method.settings;
    assert_eq!((settings["weights"].as_str(), by_kernel.beta), (Some("custom"), None));
    assert!(settings["beta"].is_null());
    // A factor 0 in a product leaves nothing.
    let nothing = plain.register_with(&source, &target, |connection| {
        let kernel = composed.resolve(|beta| connection.bandwidth(beta))?;
        connection.moments(&kernel, Normalization::None)
    });
    assert!(matches!(nothing, Err(Error::NoWeight { .. })), "{nothing:?}");
    // What is recorded as custom cannot be run again by its name.
    let again = by_kernel.method.parse::<Method>();
    assert!(again.is_none_or(|method| method.register(&source, &target).is_err()));

    let keypoints = Cfk { cf: named, ..Cfk::default() };
    let by_kernel = Cfk::default()
        .register_with(&source, &target, |connection| {
            connection.moments(&Gaussian { beta: 60.0 }, Normalization::Both)
        })
        .unwrap();
    assert_eq!(by_kernel.transform, keypoints.register(&source, &target).unwrap().transform);
    assert_eq!(by_kernel.method.name, "cfk");
}

#[test]
fn settings_out_of_range_are_refused_before_clouds_are_looked_at() {
    for (name, setting, value) in [
        ("consensus", "seeds", 0.into()),
        ("cf", "neighbors", 2.into()),
        ("cf", "beta", (-1).into()),
        ("cfk", "neighbors", 2.into()),
        ("teaser", "gnc_factor", 1.into()),
        ("icp", "keep", 2.into()),
        ("kc", "factor", 1.into()),
        ("cpd", "outliers", 1.into()),
        ("dare", "max_iterations", 0.into()),
    ] {
        let method: Method = name.parse().unwrap();
        method.validate().unwrap();
        let bad = method.with([(setting, value)]).unwrap();
        assert!(matches!(bad.validate(), Err(Error::Config { .. })), "{name} {setting}");
    }
}

#[test]
fn every_method_can_be_ended_from_outside() {
    let (source, target, _) = pair(300, 0.1);
    for method in methods() {
        let interrupt = Interrupt::default();
        interrupt.request();
        let ended = interrupt.guard(|| method.register(&source, &target));
        assert!(matches!(ended, Err(Error::Interrupted)), "{}", method.name());
    }
}
