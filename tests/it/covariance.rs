//! The covariance of a pose: is it of the size of the errors, and does it know what slides?

use cfreg::benchmark::random_pose;
use cfreg::cloud::shape::boulder;
use cfreg::math::{self, Vec3};
use cfreg::method::{Consensus, Register};
use cfreg::verify::{Decision, PoseCovariance};
use cfreg::{PointCloud, Transform};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// 95 % quantile of χ² with six degrees of freedom.
const CHI_SQUARE_95: f64 = 12.592;

struct Draw(ChaCha8Rng);

impl Draw {
    fn uniform(&mut self) -> f64 {
        2.0 * self.0.random::<f64>() - 1.0
    }

    /// Box and Muller 1958.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
        radius * (std::f64::consts::PI * self.uniform()).cos()
    }
}

/// `points` of a surface with noise, each on one of two clouds; the source is moved.
fn pair(
    points: impl Iterator<Item = Vec3>,
    noise: f64,
    draw: &mut Draw,
    motion: &Transform,
) -> [PointCloud; 2] {
    let mut clouds = [Vec::new(), Vec::new()];
    for (k, point) in points.enumerate() {
        clouds[k % 2].push(point.map(|x| x + noise * draw.normal()));
    }
    let [source, target] = clouds.map(|points| PointCloud::new(&points).unwrap());
    [source.transformed(motion).unwrap(), target]
}

fn covariance([source, target]: &[PointCloud; 2]) -> (Transform, PoseCovariance) {
    let found = Consensus::default().register(source, target).unwrap();
    (found.transform, found.verdict.unwrap().covariance.unwrap())
}

/// A hilly ground of 8 by 6, another shape than those that the constants were chosen on.
fn ground(count: usize, draw: &mut Draw) -> Vec<Vec3> {
    let mut place = || {
        let (x, y) = (4.0 * draw.uniform(), 3.0 * draw.uniform());
        let height = 0.5 * (1.3 * x + 0.4).sin() * (1.1 * y).cos() + 0.4 * (0.7 * x * y).sin();
        [x, y, height + 0.3 * (2.1 * y - x).cos()]
    };
    (0..count).map(|_| place()).collect()
}

#[test]
fn errors_are_of_the_size_that_the_covariance_says() {
    for (name, noise) in [("boulder", 0.01), ("ground", 0.03)] {
        let mut errors: Vec<f64> = Vec::new();
        for trial in 0..24 {
            let mut draw = Draw(ChaCha8Rng::seed_from_u64(trial));
            let points = match name {
                "boulder" => boulder().sample(8000, trial).unwrap().positions().collect(),
                _ => ground(8000, &mut draw),
            };
            let motion = random_pose(trial, 3.0);
            let clouds = pair(points.into_iter(), noise, &mut draw, &motion);
            let (pose, covariance) = covariance(&clouds);
            assert!(covariance.unobservable.is_empty());
            errors.push(covariance.nees(&pose, &motion.inverse()));
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let within = errors.iter().filter(|&&error| error < CHI_SQUARE_95).count();
        println!("{name}: NEES {mean:.2} in the mean (6 expected), {within} of 24 within 95 %");
        // The mean of 24 has a standard deviation of 0.7.
        assert!((3.5..8.5).contains(&mean), "{name}: {mean}");
        assert!(within >= 20, "{name}: {within}");
    }
}

#[test]
fn motions_that_nothing_holds_are_named() {
    type Surface = fn(&mut Draw) -> Vec3;
    let surfaces: [(&str, usize, Surface); 4] = [
        ("plane", 3, |draw| [draw.uniform(), draw.uniform(), 0.0]),
        ("sphere", 3, |draw| {
            loop {
                let at = [draw.uniform(), draw.uniform(), draw.uniform()];
                if (0.2..1.0).contains(&math::norm(at)) {
                    return math::normalized(at);
                }
            }
        }),
        ("cylinder", 2, |draw| {
            let (sin, cos) = (std::f64::consts::PI * draw.uniform()).sin_cos();
            [0.3 * cos, 0.3 * sin, draw.uniform()]
        }),
        ("corridor", 1, |draw| {
            let (along, across) = (5.0 * draw.uniform(), draw.uniform());
            let wall = 1.0f64.copysign(draw.uniform());
            if draw.uniform() < 0.0 { [across, wall, along] } else { [wall, across, along] }
        }),
    ];
    for (name, loose, surface) in surfaces {
        let mut draw = Draw(ChaCha8Rng::seed_from_u64(3));
        let points: Vec<Vec3> = (0..10_000).map(|_| surface(&mut draw)).collect();
        let motion = random_pose(3, 3.0);
        let (_, covariance) = covariance(&pair(points.into_iter(), 0.01, &mut draw, &motion));
        let found = &covariance.unobservable;
        assert_eq!(found.len(), loose, "{name}: {found:?}");
        // All in the target's frame, where these shapes stand upright.
        let size = |v: Vec3| math::norm(v);
        match name {
            "plane" => {
                let along = |m: &cfreg::verify::Twist| {
                    m.translation[2].abs() + size([m.rotation[0], m.rotation[1], 0.0])
                };
                assert!(found.iter().all(|motion| along(motion) < 0.1), "{found:?}");
            }
            "sphere" => {
                assert!(found.iter().all(|motion| size(motion.translation) < 0.1), "{found:?}");
            }
            "cylinder" | "corridor" => {
                let across = |v: Vec3| size([v[0], v[1], 0.0]);
                let off = |m: &cfreg::verify::Twist| across(m.translation) + across(m.rotation);
                assert!(found.iter().all(|motion| off(motion) < 0.1), "{found:?}");
            }
            _ => unreachable!(),
        }
        // Their variance is the size of what lies on each other, not less.
        let trace: f64 = (3..6).map(|i| covariance.matrix[i][i]).sum();
        let turns: f64 = (0..3).map(|i| covariance.matrix[i][i]).sum();
        assert!(trace + turns > 0.5, "{name}: {trace} {turns}");
    }
}

#[test]
fn the_unit_and_the_place_change_nothing_else() {
    let mut draw = Draw(ChaCha8Rng::seed_from_u64(5));
    let points: Vec<Vec3> = boulder().sample(6000, 5).unwrap().positions().collect();
    let clouds = pair(points.into_iter(), 0.01, &mut draw, &random_pose(5, 3.0));
    let (_, metres) = covariance(&clouds);
    let larger = Transform { scale: 1024.0, ..Transform::IDENTITY };
    let far = Transform { translation: [5e5, 5.6e6, 0.0], ..larger };
    let moved = [&clouds[0], &clouds[1]].map(|cloud| cloud.transformed(&far).unwrap());
    let (_, other) = covariance(&moved);
    for i in 0..6 {
        for j in 0..6 {
            let unit = |k: usize| if k < 3 { 1.0 } else { 1024.0 };
            let (a, b) = (metres.matrix[i][j] * unit(i) * unit(j), other.matrix[i][j]);
            let size = (metres.matrix[i][i] * metres.matrix[j][j]).sqrt() * unit(i) * unit(j);
            assert!((a - b).abs() < 0.05 * size, "{i} {j}: {a} {b}");
        }
    }
    let there = far.apply(metres.center);
    assert!(math::norm(math::sub(there, other.center)) < 1.0, "{there:?} {:?}", other.center);
    // Symmetric, and a covariance: no direction has a negative variance.
    let symmetric = |i: usize, j: usize| metres.matrix[i][j] == metres.matrix[j][i];
    assert!((0..36).all(|k| symmetric(k / 6, k % 6)));
    assert!(math::cholesky::factor(&metres.matrix).is_some());
}

#[test]
fn what_is_free_is_told_of_flat_clouds_and_of_copies() {
    type Surface = fn(&mut Draw) -> Vec3;
    // Shapes, and how many motions are free. A line is no surface: along it and about it at least.
    let shapes: [(&str, usize, Surface); 5] = [
        ("plane", 3, |draw| [draw.uniform(), draw.uniform(), 0.0]),
        ("nearly a plane", 3, |draw| [draw.uniform(), draw.uniform(), 1e-4 * draw.uniform()]),
        ("cylinder", 2, |draw| {
            let (sin, cos) = (std::f64::consts::PI * draw.uniform()).sin_cos();
            [0.3 * cos, 0.3 * sin, draw.uniform()]
        }),
        ("sphere", 3, |draw| {
            loop {
                let at = [draw.uniform(), draw.uniform(), draw.uniform()];
                if (0.2..1.0).contains(&math::norm(at)) {
                    return math::normalized(at);
                }
            }
        }),
        ("line", 2, |draw| [draw.uniform(), 1e-3 * draw.normal(), 1e-3 * draw.normal()]),
    ];
    for (name, free, surface) in shapes {
        for copy in [false, true] {
            let mut draw = Draw(ChaCha8Rng::seed_from_u64(11));
            let points: Vec<Vec3> = (0..4000).map(|_| surface(&mut draw)).collect();
            let points = match copy {
                true => points.iter().flat_map(|point| [*point; 2]).collect(),
                false => points,
            };
            let motion = random_pose(4, 3.0);
            let [source, target] = pair(points.into_iter(), 0.0, &mut draw, &motion);
            // The true pose, whatever a search makes of such clouds.
            let judged = Consensus::default().verify(&source, &target, &motion.inverse());
            // All places of an exact plane, or of a line, may look alike: that is no verdict.
            let Ok(verdict) = judged else {
                assert!(name == "plane" || name == "line", "{name}, copy {copy}: {judged:?}");
                continue;
            };
            let loose = verdict.covariance.as_ref().map(|known| known.unobservable.len());
            println!("{name}, copy {copy}: {:?}, {loose:?} of {free}", verdict.decision);
            // Curved samples that are copies hold each other by what their normals have in common.
            if name.contains("plane") || (!copy && name != "line") {
                assert_eq!(loose, Some(free), "{name}, copy {copy}");
            }
            if !copy || name.contains("plane") {
                assert_ne!(verdict.decision, Decision::Accept, "{name}, copy {copy}");
            }
            let of_line = name == "line" && !copy;
            assert!(!of_line || loose.is_none_or(|loose| loose >= free), "{loose:?}");
        }
    }
}
