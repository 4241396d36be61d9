//! Is a wrong pose ever trusted? Real pairs of every kind, moved apart at random.
//!
//! `cargo test --release --features cli --test it trust -- --nocapture` prints the figures.

use crate::common;

use cfreg::method::{Cf, Method, Register, Registration};
use cfreg::verify::{MIN_CHANCE_CORRECTED_FITNESS, pose_error};
use cfreg::weight::Normalization;
use cfreg::{Transform, math};
use common::scans::RealPair;

/// Rotations off by more than this are wrong, by less than [`RIGHT`] right, degrees.
const WRONG: f64 = 20.0;
const RIGHT: f64 = 10.0;

#[test]
fn wrong_poses_of_real_scans_are_doubted() {
    let Some(data) = common::shared_data() else { return };
    // The inlier distance follows the resolution: with few points chance is harder to tell.
    for (points, allowed) in [(2000, 0), (1000, 0), (500, 4)] {
        let pairs = common::scans::real_pairs(&data, 8, points);
        let mut tally = Tally::default();
        for pair in &pairs {
            for normalization in [Normalization::None, Normalization::Both] {
                let cf = Cf { normalization, ..Cf::default() };
                let found = cf.register(&pair.source, &pair.target).unwrap();
                tally.add(pair, &found, &normalization.to_string());
            }
        }
        let Tally { wrong, right, trusted_wrong, .. } = &mut tally;
        println!(
            "{} pairs of {points} points, two normalisations\n\
             off by more than {WRONG} deg: {}, {} of them trusted\n\
             off by less than {RIGHT} deg: {}, {} of them at least {MIN_CHANCE_CORRECTED_FITNESS}",
            pairs.len(),
            spread(wrong),
            trusted_wrong.len(),
            spread(right),
            right.iter().filter(|&&x| x >= MIN_CHANCE_CORRECTED_FITNESS).count(),
        );
        assert!(pairs.len() > 50 && wrong.len() > 30 && right.len() > 5);
        assert!(trusted_wrong.len() <= allowed, "{trusted_wrong:#?}");
    }
}

/// The same for the methods that start from a pose: from near the truth to far from it.
#[test]
fn wrong_optima_of_real_scans_are_doubted() {
    let Some(data) = common::shared_data() else { return };
    // Unoptimised, fewer.
    let step = if cfg!(debug_assertions) { 36 } else { 24 };
    let pairs = common::scans::real_pairs(&data, step, 600);
    // Mixtures take most of the time, and have tests of their own.
    let methods: &[&str] = match cfg!(debug_assertions) {
        true => &["icp", "plane-icp", "gicp", "kc"],
        false => &["icp", "plane-icp", "gicp", "kc", "cpd", "dare"],
    };
    for &name in methods {
        let method: Method = name.parse().unwrap();
        let mut tally = Tally::default();
        for (seed, pair) in pairs.iter().enumerate() {
            for degrees in [3.0, 60.0, 150.0] {
                let start = off(pair, degrees, seed as f64);
                let refinement = method.as_refinement().unwrap();
                // Nothing to hold on to is no answer, and no harm.
                let found = refinement.refine(&pair.source, &pair.target, &start);
                let Ok(found) = found else { continue };
                tally.add(pair, &found, &format!("from {degrees} deg"));
            }
        }
        let Tally { wrong, right, trusted_wrong, trusted_right } = &mut tally;
        println!(
            "{name}\n  off by more than {WRONG} deg: {}, {} of them trusted\n  \
             off by less than {RIGHT} deg: {}, {trusted_right} of them trusted",
            spread(wrong),
            trusted_wrong.len(),
            spread(right),
        );
        assert!(wrong.len() > 480 / step && *trusted_right > 0, "{name}");
        assert!(trusted_wrong.is_empty(), "{name}: {trusted_wrong:#?}");
    }
}

/// Agreements of wrong and of right poses, and what was trusted among them.
#[derive(Default)]
struct Tally {
    wrong: Vec<f64>,
    right: Vec<f64>,
    trusted_wrong: Vec<String>,
    trusted_right: usize,
}

impl Tally {
    fn add(&mut self, pair: &RealPair, found: &Registration, how: &str) {
        let center = pair.source.centroid();
        let angle = pose_error(&found.transform, &pair.truth, center).rotation_deg;
        let agreement = found.evaluation.chance_corrected_fitness();
        if angle > WRONG {
            self.wrong.push(agreement);
            if found.trusted {
                self.trusted_wrong.push(format!("{}, {how}: {angle:.0} deg", pair.name));
            }
        } else if angle < RIGHT {
            self.right.push(agreement);
            self.trusted_right += usize::from(found.trusted);
        }
    }
}

/// The truth turned by `degrees` about the target's centroid, and shifted by 2 % of the size.
fn off(pair: &RealPair, degrees: f64, seed: f64) -> Transform {
    let axis = [(seed + degrees).sin(), (1.3 * seed).cos(), (0.7 * seed + degrees).sin()];
    let axis = math::normalized(axis);
    let turn = Transform::from_rotation_vector(math::scaled(axis, degrees.to_radians()));
    let center = pair.target.centroid();
    let back = math::sub(center, turn.apply(center));
    let shift = math::scaled(axis, 0.02 * pair.source.diagonal());
    Transform { translation: math::add(back, shift), ..turn }.after(&pair.truth)
}

fn spread(agreements: &mut [f64]) -> String {
    agreements.sort_by(f64::total_cmp);
    let [least, .., greatest] = agreements else { return format!("{agreements:?}") };
    let (least, greatest, n) = (*least, *greatest, agreements.len());
    let median = agreements[n / 2];
    format!("{n} poses, agreement {least:.2} to {greatest:.2}, median {median:.2}")
}
