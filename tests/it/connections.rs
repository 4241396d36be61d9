//! What methods connected, made again.

use cfreg::Transform;
use cfreg::cloud::shape::boulder;
use cfreg::math;
use cfreg::method::{Cf, Method, Register, WeightBlock};
use cfreg::weight::WeightScheme;

#[test]
fn right_pairs_weigh_more_than_others() {
    let truth = Transform::from_rotation_vector([0.4, -0.9, 0.2]);
    let source = boulder().sample(800, 1).unwrap();
    let target = boulder().sample(800, 2).unwrap().transformed(&truth).unwrap();
    for name in ["consensus", "cf", "cfk", "teaser"] {
        let method: Method = name.parse().unwrap();
        let found = method.weight_graph(&source, &target, &truth).unwrap().unwrap();
        let WeightBlock { rows, weights, distances: apart, principal_feature: looks, .. } =
            &found.block;
        let n = rows.len();
        assert!(n > 20 && weights.len() == n * n && apart.len() == n && looks.len() == n);
        let mean = |on: bool| {
            let at = (0..n * n).filter(|k| (k / n == k % n) == on);
            let part: Vec<f64> = at.map(|k| f64::from(weights[k])).collect();
            part.iter().sum::<f64>() / part.len() as f64
        };
        assert!(mean(true) > 2.0 * mean(false), "{name}: {} {}", mean(true), mean(false));
        assert!(found.links.windows(2).all(|two| two[0].weight >= two[1].weight));
        assert_eq!(
            (found.full, found.inlier_distance.is_none()),
            (name.starts_with("cf"), found.full)
        );
        for link in found.links.iter().filter(|_| !found.full) {
            let [p, q] =
                [(0, link.source), (1, link.target)].map(|(k, i)| found.points[k][i as usize]);
            let off = math::norm(math::sub(truth.apply(p), q));
            assert_eq!(link.weight > 0.0, off < found.inlier_distance.unwrap(), "{name}: {off}");
        }
        for (k, received) in found.weight_sums.iter().enumerate() {
            assert_eq!(received.len(), found.points[k].len());
        }
    }
}

#[test]
fn weights_of_the_second_order_are_nearer_to_the_diagonal() {
    let truth = Transform::from_rotation_vector([0.4, -0.9, 0.2]);
    let source = boulder().sample(800, 1).unwrap();
    let target = boulder().sample(800, 2).unwrap().transformed(&truth).unwrap();
    let method: Method = "cf-spectral".parse().unwrap();
    let found = method.weight_graph(&source, &target, &truth).unwrap().unwrap();
    let WeightBlock { rows, weights, first_order, .. } = &found.block;
    let n = rows.len();
    let share = |weights: &[f32]| {
        let diagonal: f64 = (0..n).map(|k| f64::from(weights[k * n + k])).sum();
        diagonal / weights.iter().map(|&weight| f64::from(weight)).sum::<f64>()
    };
    let (second, first) = (share(weights), share(first_order));
    assert!(second > 1.5 * first && second > 0.3, "{second} {first}");
    // Each connection is in one entry of the block.
    let sum: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
    let links: f64 = found.links.iter().map(|link| link.weight).sum();
    assert!((sum / links - 1.0).abs() < 1e-4, "{sum} {links}");
    let near = found.links[..100].iter().filter(|link| {
        let [p, q] = [(0, link.source), (1, link.target)].map(|(k, i)| found.points[k][i as usize]);
        math::norm(math::sub(truth.apply(p), q)) < found.inlier_distance.unwrap()
    });
    assert!(near.count() > 90);
}

#[test]
fn matches_agree_with_the_pose_that_they_gave() {
    let source = boulder().sample(800, 1).unwrap();
    let target = boulder().sample(800, 2).unwrap();
    let method: Method = "consensus".parse().unwrap();
    let pose = method.register(&source, &target).unwrap().transform;
    let found = method.weight_graph(&source, &target, &pose).unwrap().unwrap();
    let near = found.links.iter().filter(|link| link.weight > 0.5).count();
    assert!(near > 20, "{near}");
    let wrong = Transform::from_rotation_vector([0.0, 0.0, 2.0]).after(&pose);
    let found = method.weight_graph(&source, &target, &wrong).unwrap().unwrap();
    assert!(found.links.iter().filter(|link| link.weight > 0.5).count() < near / 4);
}

#[test]
fn what_has_no_weights_to_show_says_so() {
    let cloud = boulder().sample(300, 1).unwrap();
    let own = Cf { weights: WeightScheme::Custom, ..Cf::default() };
    for method in ["icp".parse().unwrap(), "cpd".parse().unwrap(), Method::Cf(own)] {
        let found = method.weight_graph(&cloud, &cloud, &Transform::IDENTITY).unwrap();
        assert_eq!(found, None, "{}", method.name());
    }
}
