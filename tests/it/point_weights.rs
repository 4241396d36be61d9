//! Weights of points: what counts twice is there twice, what counts nothing is not there.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::method::{Consensus, Icp, Method, Metric, Pipeline, Refine, Register, Teaser};
use cfreg::moments::{FullConnection, Moments, naive};
use cfreg::weight::{Normalization, WeightScheme};
use cfreg::{PointCloud, Transform};
use common::compare::{moments_difference, pose_difference};
use common::sides::{NORMALIZATIONS, RandomCloud, bandwidth_for};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn connect([source, target]: &[RandomCloud; 2], weights: [Option<&[f32]>; 2]) -> FullConnection {
    let connection = FullConnection::new(source.feature_view(), target.feature_view()).unwrap();
    connection.with_point_weights(weights[0], weights[1]).unwrap()
}

fn weigh(connection: &FullConnection, dim: usize, normalization: Normalization) -> Moments {
    connection.scheme_moments(WeightScheme::Cauchy, bandwidth_for(dim), normalization).unwrap()
}

fn random(n: usize, seed: u64) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..n).map(|_| [0.0, rng.random_range(0.01..4.0), 1.0][rng.random_range(0..3)]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn fused_moments_are_those_of_the_double_loop(
        n in 1..150usize, m in 1..600usize, dim in prop::sample::select(vec![3, 33]),
        power in -60..60i32, seed in any::<u64>(), which in 1..4u8,
    ) {
        let sides = [RandomCloud::random(n, dim, 0.0, seed), RandomCloud::random(m, dim, 0.0, !seed)];
        let (mut a, mut b) = (random(n, seed), random(m, seed + 1));
        a[0] = 1.0;
        b[0] = 1.0;
        a.iter_mut().for_each(|a| *a *= 2f32.powi(power));
        let ones = [vec![1.0; n], vec![1.0; m]];
        let given = [(which & 1 > 0).then_some(&a[..]), (which & 2 > 0).then_some(&b[..])];
        let all = [given[0].unwrap_or(&ones[0]), given[1].unwrap_or(&ones[1])];
        let connection = connect(&sides, given);
        for normalization in NORMALIZATIONS {
            let fused = weigh(&connection, dim, normalization);
            let kernel = |d2: f64| 1.0 / (1.0 + d2 / bandwidth_for(dim));
            let [from, to] = [sides[0].feature_view(), sides[1].feature_view()];
            let exact = naive::point_weighted_moments(from, to, kernel, normalization, all);
            let error = moments_difference(&exact, &fused);
            prop_assert!(error < 2e-6, "{normalization}: {error:e}");
        }
    }

    #[test]
    fn a_weight_is_as_many_points(
        n in 1..60usize, m in 1..60usize, dim in prop::sample::select(vec![3, 33]),
        seed in any::<u64>(),
    ) {
        let sides = [RandomCloud::random(n, dim, 0.0, seed), RandomCloud::random(m, dim, 0.0, !seed)];
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut counts = [n, m].map(|n| (0..n).map(|_| rng.random_range(0..4usize)).collect::<Vec<_>>());
        counts.iter_mut().for_each(|counts| counts[0] = 1);
        let repeated = [0, 1].map(|k| {
            let rows: Vec<usize> =
                (0..counts[k].len()).flat_map(|i| vec![i; counts[k][i]]).collect();
            sides[k].select(&rows)
        });
        let weights = counts.map(|counts| counts.iter().map(|&c| c as f32).collect::<Vec<_>>());
        let weighed = connect(&sides, [Some(&weights[0]), Some(&weights[1])]);
        let weighed = weigh(&weighed, dim, Normalization::None);
        let twice = weigh(&connect(&repeated, [None; 2]), dim, Normalization::None);
        // Pairs that are there twice are two squares, and not the square of two.
        let weighed = Moments { weight_squared: twice.weight_squared, ..weighed };
        let error = moments_difference(&weighed, &twice);
        prop_assert!(error < 2e-6, "{error:e}");
    }
}

#[test]
fn equal_weights_change_nothing() {
    let sides = [RandomCloud::random(100, 33, 0.0, 1), RandomCloud::random(90, 33, 0.0, 2)];
    for normalization in NORMALIZATIONS {
        let plain = weigh(&connect(&sides, [None; 2]), 33, normalization);
        let ones = [vec![1.0; 100], vec![1.0; 90]];
        let ones = weigh(&connect(&sides, [Some(&ones[0]), Some(&ones[1])]), 33, normalization);
        let error = moments_difference(&plain, &ones);
        assert!(error < 1e-6, "{normalization}: {error:e}");
    }
    assert!(connect(&sides, [None; 2]).with_point_weights(Some(&[1.0]), None).is_err());
    let negative = [-1.0; 90];
    assert!(connect(&sides, [None; 2]).with_point_weights(None, Some(&negative)).is_err());
}

#[test]
fn a_tolerance_leaves_nothing_out_beside_weights() {
    let sides = [RandomCloud::random(7_300, 3, 0.0, 1), RandomCloud::random(6_900, 3, 0.0, 2)];
    let weights = random(7_300, 3);
    let connection = connect(&sides, [Some(&weights), None]);
    let moments = |tolerance| {
        let (scheme, none) = (WeightScheme::Gaussian, Normalization::None);
        connection.pruned_moments(scheme, 0.5, none, tolerance).unwrap()
    };
    assert_eq!(moments(1e-2), moments(0.0));
}

/// Two samples, the second turned a little.
fn clouds() -> [PointCloud; 2] {
    let motion = Transform::from_rotation_vector([0.05, -0.08, 0.1]);
    let target = boulder().sample(420, 2).unwrap().transformed(&motion).unwrap();
    [boulder().sample(400, 1).unwrap(), target]
}

fn weighed(cloud: &PointCloud, weight: impl Fn(usize) -> f64) -> PointCloud {
    cloud.clone().with_weights((0..cloud.len()).map(weight).collect()).unwrap()
}

const BY_POSITION: [&str; 6] = ["icp", "plane-icp", "gicp", "kc", "cpd", "dare"];
const ALL: [&str; 12] = [
    "icp",
    "plane-icp",
    "gicp",
    "kc",
    "cpd",
    "dare",
    "cf",
    "cf-multiscale",
    "cf-spectral",
    "cfk",
    "teaser",
    "consensus",
];

fn register(name: &str, [source, target]: &[PointCloud; 2]) -> Transform {
    let method: Method = name.parse().unwrap();
    let set = |name: &'static str, value: i32| method.clone().with([(name, value.into())]);
    let method = match name {
        "cf" | "teaser" => set("neighbors", 60).unwrap(),
        "cfk" => method.with([("neighbors", 60.into()), ("detector", "iss".into())]).unwrap(),
        _ => method,
    };
    Pipeline::new(method, vec![]).unwrap().register(source, target).unwrap().transform
}

#[test]
fn in_every_method_equal_weights_change_nothing_and_others_do() {
    let clouds = clouds();
    for name in ALL {
        let plain = register(name, &clouds);
        for weight in [1.0, 7.0] {
            let found = register(name, &clouds.clone().map(|cloud| weighed(&cloud, |_| weight)));
            let off = pose_difference(&plain, &found);
            assert!(off < 1e-4, "{name} {weight}: {off:e}");
        }
        let half = clouds.clone().map(|cloud| {
            let right: Vec<bool> = cloud.positions().map(|p| p[0] > 0.0).collect();
            weighed(&cloud, |i| if right[i] { 10.0 } else { 1.0 })
        });
        let off = pose_difference(&plain, &register(name, &half));
        if name == "teaser" {
            assert_eq!(off, 0.0, "a match is consistent or not");
        } else {
            assert!(off > 1e-4, "{name} does not look at weights: {off:e}");
        }
    }
}

#[test]
fn by_position_weight_nothing_is_not_there() {
    let clouds = clouds();
    let some = |cloud: &PointCloud| weighed(cloud, |i| f64::from(u8::from(i % 3 > 0)));
    let left = |cloud: &PointCloud| {
        cloud.select(&(0..cloud.len()).filter(|i| i % 3 > 0).collect::<Vec<_>>())
    };
    for name in BY_POSITION {
        let zero = register(name, &[some(&clouds[0]), some(&clouds[1])]);
        let gone = register(name, &[left(&clouds[0]), left(&clouds[1])]);
        let off = pose_difference(&zero, &gone);
        assert!(off < 1e-5, "{name}: {off:e}");
    }
    let nothing = some(&clouds[0]).select(&[0, 3, 6, 9]);
    for name in BY_POSITION {
        let method: Method = name.parse().unwrap();
        let found = method.register(&nothing, &clouds[1]);
        assert!(matches!(found, Err(cfreg::Error::TooFewPoints { .. })), "{name}");
    }
}

#[test]
fn a_source_point_of_weight_two_is_two_pairs_of_icp() {
    let [source, target] = clouds();
    let doubled: Vec<usize> =
        (0..source.len()).flat_map(|i| vec![i; 1 + usize::from(i % 4 == 0)]).collect();
    let doubled = source.select(&doubled);
    let heavy = weighed(&source, |i| if i % 4 == 0 { 2.0 } else { 1.0 });
    let weights = WeightScheme::Cauchy;
    let icp = Icp { metric: Metric::Point, bandwidth: Some(0.1), weights, ..Icp::default() };
    let icp = Icp { max_iterations: 5, ..icp };
    let refine = |cloud: &PointCloud| icp.refine(cloud, &target, &Transform::IDENTITY).unwrap();
    let off = pose_difference(&refine(&doubled).transform, &refine(&heavy).transform);
    assert!(off < 1e-9, "{off:e}");
    let off = pose_difference(&refine(&source).transform, &refine(&heavy).transform);
    assert!(off > 1e-5, "{off:e}");
}

#[test]
fn what_counts_nothing_has_no_match_in_teaser() {
    let [source, _] = clouds();
    let motion = Transform::from_rotation_vector([0.05, -0.08, 0.1]);
    let target = source.transformed(&motion).unwrap();
    let pairs: Vec<(u32, u32)> = (0..source.len() as u32).map(|i| (i, i)).collect();
    let counts = |i: usize, every: usize| f64::from(u8::from(!i.is_multiple_of(every)));
    let left = (0..source.len()).filter(|&i| counts(i, 3) * counts(i, 5) > 0.0).count() as u64;
    let (source, target) = (weighed(&source, |i| counts(i, 3)), weighed(&target, |i| counts(i, 5)));
    let given = Teaser::default().register_correspondences(&source, &target, &pairs).unwrap();
    assert_eq!(given.connections, left);
    // Two samples of the same points look alike point by point.
    let found = Teaser::default().register(&source, &target).unwrap();
    assert!(found.connections <= left, "{} of {left}", found.connections);
}

#[test]
fn what_counts_nothing_does_not_pull_the_pose() {
    // A clump that only the source has, heavy in points and light in weight.
    let [source, target] = clouds();
    let clump = boulder().sample(600, 9).unwrap();
    let shift = [0.9 * source.diagonal(), 0.2, 0.1];
    let all: Vec<[f64; 3]> = source
        .positions()
        .chain(clump.positions().map(|p| [0.3 * p[0] + shift[0], 0.3 * p[1], 0.3 * p[2]]))
        .collect();
    let whole = PointCloud::new(&all).unwrap();
    let known = weighed(&whole, |i| f64::from(u8::from(i < source.len())));
    let truth = Transform::from_rotation_vector([0.05, -0.08, 0.1]);
    let error = |source: &PointCloud| {
        let found = Icp::default().refine(source, &target, &Transform::IDENTITY).unwrap();
        found.transform.after(&truth.inverse()).angle().to_degrees()
    };
    let (with, without) = (error(&whole), error(&known));
    assert!(without < 2.0 && with > 2.0 * without, "{with} {without}");
}

#[test]
fn consensus_follows_what_counts() {
    // Two stones that moved each its way.
    let motions = [[0.05, -0.08, 0.1], [0.3, 0.2, -0.4]].map(Transform::from_rotation_vector);
    let few = 1500;
    let stones = |seed: u64, [small, large]: [Transform; 2]| {
        let [one, other] =
            [(few, seed), (2 * few, seed + 2)].map(|(n, seed)| boulder().sample(n, seed).unwrap());
        let aside = |[x, y, z]: [f64; 3]| [1.5 * x + 4.0, 0.7 * y, z];
        let one = one.positions().map(|p| small.apply(p));
        let all = one.chain(other.positions().map(|p| large.apply(aside(p))));
        PointCloud::new(&all.collect::<Vec<_>>()).unwrap()
    };
    let (source, target) = (stones(1, [Transform::IDENTITY; 2]), stones(2, motions));
    for (which, motion) in motions.iter().enumerate() {
        let known = weighed(&source, |i| f64::from(u8::from((i < few) == (which == 0))));
        let found = Consensus::default().register(&known, &target).unwrap();
        let off = found.transform.after(&motion.inverse()).angle().to_degrees();
        assert!(off < 5.0, "stone {which}: {off}");
    }
}
