//! The verdict follows the clouds: their unit, a map offset, and a motion of both.

use crate::common;

use cfreg::cloud::shape::boulder;
use cfreg::math::{self, Vec3};
use cfreg::method::{Consensus, Register};
use cfreg::verify::{Decision, Verdict};
use cfreg::{PointCloud, Transform};
use proptest::prelude::*;

/// Two views of a shape from places 22 degrees apart, each with its sensor.
fn views(seed: u64) -> [PointCloud; 2] {
    let seen = |from: Vec3, seed: u64| {
        let cloud = boulder().sample(4000, seed).unwrap();
        let center = cloud.centroid();
        let toward = math::normalized(math::sub(from, center));
        let front = |&i: &usize| math::dot(math::sub(cloud.position(i), center), toward) > 0.0;
        let front: Vec<usize> = (0..cloud.len()).filter(front).collect();
        cloud.select(&front).with_viewpoint(from).unwrap()
    };
    [seen([5.0, 0.0, 1.0], 2 * seed), seen([4.6, 1.9, 1.0], 2 * seed + 1)]
}

fn verdict(source: &PointCloud, target: &PointCloud) -> Verdict {
    Consensus::default().register(source, target).unwrap().verdict.unwrap()
}

/// On the right pose.
fn judged(source: &PointCloud, target: &PointCloud, truth: &Transform) -> Verdict {
    Consensus::default().verify(source, target, truth).unwrap()
}

fn log_odds(verdict: &Verdict) -> f64 {
    let p = verdict.probability.clamp(1e-6, 1.0 - 1e-6);
    (p / (1.0 - p)).ln()
}

fn motion() -> impl Strategy<Value = Transform> {
    let vector = proptest::array::uniform3(-3.0..3.0f64);
    let shift = proptest::array::uniform3(-20.0..20.0f64);
    (vector, shift).prop_map(|(vector, translation)| Transform {
        translation,
        ..Transform::from_rotation_vector(vector)
    })
}

/// The cloud with other positions, its sensor among them.
fn placed(cloud: &PointCloud, place: impl Fn(Vec3) -> Vec3) -> PointCloud {
    let points: Vec<Vec3> = cloud.positions().map(&place).collect();
    let viewpoint = place(cloud.viewpoint().unwrap());
    PointCloud::new(&points).unwrap().with_viewpoint(viewpoint).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4))]

    #[test]
    fn the_unit_changes_only_rounding(exponent in -20..21i32, seed in 0..50u64) {
        let unit = 2f64.powi(exponent);
        let [source, target] = views(seed);
        let before = verdict(&source, &target);
        let scaled = |cloud: &PointCloud| placed(cloud, |p| math::scaled(p, unit));
        let after = verdict(&scaled(&source), &scaled(&target));
        // The margin is over the best wrong pose, and rounding may lead the search to another one.
        prop_assert!((before.probability - after.probability).abs() < 1e-3,
            "{} {}", before.probability, after.probability);
        prop_assert!((before.overlap - after.overlap).abs() < 1e-6);
        prop_assert_eq!(before.decision, after.decision);
    }

    // A round offset moves the f64 origin alone.
    #[test]
    fn a_round_map_offset_changes_only_rounding(
        east in 0..9i32, north in 0..90i32, seed in 0..50u64,
    ) {
        let offset = [f64::from(east) * 1e5, f64::from(north) * 1e5, 300.0];
        let [source, target] = views(seed);
        let before = verdict(&source, &target);
        let far = |cloud: &PointCloud| placed(cloud, |p| math::add(p, offset));
        let after = verdict(&far(&source), &far(&target));
        prop_assert!((before.probability - after.probability).abs() < 1e-3,
            "{} {}", before.probability, after.probability);
        prop_assert_eq!(before.decision, after.decision);
    }

    // Cubes of a turned cloud hold other points, and matches are others: the log odds stay within
    // 4, as from 0.5 to 0.98, the overlap within a tenth, and accept never turns into reject.
    #[test]
    fn a_motion_of_both_changes_it_within_bounds(
        first in motion(), second in motion(), seed in 0..50u64,
    ) {
        let [source, target] = views(seed);
        let before = judged(&source, &target, &Transform::IDENTITY);
        let moved = (source.transformed(&first).unwrap(), target.transformed(&second).unwrap());
        let after = judged(&moved.0, &moved.1, &second.after(&first.inverse()));
        let decisions = [before.decision, after.decision];
        prop_assert!(
            !(decisions.contains(&Decision::Accept) && decisions.contains(&Decision::Reject)),
            "{before} {after}"
        );
        let apart = (log_odds(&before) - log_odds(&after)).abs();
        prop_assert!(apart < 4.0, "{before} {after}");
        prop_assert!((before.overlap - after.overlap).abs() < 0.1, "{before} {after}");
    }
}

/// Real pairs, as they are stored and with both clouds moved at random and put into map
/// coordinates: prints how far the log odds go apart.
#[test]
#[cfg_attr(
    debug_assertions,
    ignore = "unoptimised: slow; cargo test --release --features cli --test it verdict_equivariance"
)]
fn motions_of_real_pairs() {
    let Some(folder) = common::shared_data() else { return };
    let mut apart = Vec::new();
    let mut changed = 0;
    for pair in common::scans::real_pairs(&folder, 12, 20_000) {
        let map = Transform {
            translation: [512_345.7, 5_412_345.3, 312.9],
            ..Transform::from_rotation_vector([0.3, -0.2, 1.1])
        };
        let moved = |cloud: &PointCloud| cloud.transformed(&map).unwrap();
        let before = judged(&pair.source, &pair.target, &pair.truth);
        let truth = map.after(&pair.truth.after(&map.inverse()));
        let after = judged(&moved(&pair.source), &moved(&pair.target), &truth);
        apart.push((log_odds(&before) - log_odds(&after)).abs());
        changed += usize::from(before.decision != after.decision);
    }
    apart.sort_by(f64::total_cmp);
    let at = |share: f64| apart[((apart.len() - 1) as f64 * share) as usize];
    eprintln!(
        "{} pairs: log odds apart by {:.2} in the median, {:.2} at 90 %, {:.2} at most; {changed} other decisions",
        apart.len(),
        at(0.5),
        at(0.9),
        at(1.0)
    );
    assert!(at(0.5) < 2.0 && 10 * changed <= apart.len(), "{apart:?}");
}
