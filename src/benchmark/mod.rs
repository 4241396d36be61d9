//! Benchmarks of any methods on a list of real pairs with known poses: recall, time, and the
//! reliability of their verdicts.

pub mod candidates;
mod external_poses;
mod kept_rows;
pub mod list;
mod pair_clouds;
pub mod reliability;
pub mod report;
pub mod success_criterion;

use std::path::Path;
use std::time::Instant;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

pub use external_poses::ExternalPoses;
pub use list::Pair;
pub use success_criterion::SuccessCriterion;

use self::kept_rows::KeptRows;
use self::pair_clouds::PairClouds;
use crate::cloud::{PointCloud, Transform, ViewpointSource};
use crate::error::Result;
use crate::math::{self, Vec3};
use crate::method::{Pipeline, Register, Registration};
use crate::verify::Decision;

/// The settings of a benchmark.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// Whether the source is moved by a random motion first; default yes. Clouds of a list are
    /// often close to their true relative pose, which would make global registration trivial.
    pub moved: bool,
    /// Seed of the motions.
    pub seed: u64,
    /// Source of the sensor viewpoints.
    pub viewpoints: ViewpointSource,
    /// Success criterion of a pose; default by the size of the source
    /// ([`SuccessCriterion::for_size`]).
    pub rule: Option<SuccessCriterion>,
    /// Points to which clouds are downsampled at random, 0 for all.
    pub points: usize,
}

impl Default for Settings {
    fn default() -> Self {
        let viewpoints = ViewpointSource::default();
        Settings { moved: true, seed: 0, viewpoints, rule: None, points: 0 }
    }
}

/// The result of one method on one pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct BenchmarkRow {
    /// The pair's set.
    pub dataset: String,
    /// File of the source, as in the list.
    pub source: String,
    /// File of the target.
    pub target: String,
    /// Share of the source that the target also covers; 0 for unrelated clouds.
    pub overlap: Option<f64>,
    /// Name of the method, refinements after `+`.
    pub method: String,
    /// Whether the pose is correct.
    pub right: bool,
    /// The success criterion.
    pub rule: SuccessCriterion,
    /// Rotation error, degrees; empty without a pose or a truth.
    pub rotation_deg: Option<f64>,
    /// Translation error in the clouds' unit.
    pub translation: Option<f64>,
    /// Whether the method accepts its own pose.
    pub accepted: bool,
    /// Whether the method reports the pose as one of several.
    pub ambiguous: bool,
    /// Probability that the pose is correct, from methods that report it.
    pub probability: Option<f64>,
    /// Squared error normalised by the method's covariance, from methods that report it
    /// ([`PoseCovariance::nees`](crate::verify::PoseCovariance::nees)).
    #[serde(default)]
    pub nees: Option<f64>,
    /// Seconds of the registration, without reading files.
    pub seconds: f64,
    /// Why there is no pose; empty with one.
    pub error: String,
}

/// Parses a method by its name, refinements after `+`: `cf-multiscale+gicp`.
///
/// # Errors
/// Those of its parts and of [`Pipeline::new`].
pub fn parse_method(name: &str) -> Result<Pipeline> {
    let mut parts = name.split('+').map(str::parse);
    let first = parts.next().unwrap_or_else(|| "".parse())?;
    Pipeline::new(first, parts.collect::<Result<_>>()?)
}

/// Runs `methods` over `pairs` and returns a row for each pair and method, in order.
///
/// With `output` each row is appended to that file as soon as it is complete, and rows already in
/// the file, by the same settings, are not run again. `progress` is called with the numbers of rows
/// done and of all rows.
///
/// # Errors
/// Those of reading clouds; [`Error::Config`](crate::Error::Config) for an `output` made by other
/// settings. A pair without a pose is a row.
pub fn run(
    pairs: &[Pair],
    methods: &[String],
    settings: Settings,
    output: Option<&Path>,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<BenchmarkRow>> {
    let chains =
        methods.iter().map(|name| parse_method(name)).collect::<Result<Vec<Pipeline>>>()?;
    let mut kept = match output {
        Some(path) => KeptRows::open(path, &settings)?,
        None => KeptRows::default(),
    };
    let mut clouds = PairClouds::default();
    let mut rows = Vec::new();
    let all = pairs.len() * methods.len();
    for (number, pair) in pairs.iter().enumerate() {
        for (name, chain) in methods.iter().zip(&chains) {
            let row = match kept.find(pair, name) {
                Some(row) => row,
                None => {
                    let row = register_pair(pair, number, (name, chain), settings, &mut clouds)?;
                    kept.add(&row)?;
                    row
                }
            };
            rows.push(row);
            progress(rows.len(), all);
        }
    }
    Ok(rows)
}

/// A pair as it is passed to a method.
struct PreparedPair {
    /// The source as in its file.
    source: PointCloud,
    /// The source under `motion`.
    moved: PointCloud,
    target: PointCloud,
    motion: Transform,
    rule: SuccessCriterion,
}

impl PreparedPair {
    /// Prepares the pair with index `number` of the list.
    fn new(
        pair: &Pair,
        number: usize,
        settings: Settings,
        clouds: &mut PairClouds,
    ) -> Result<PreparedPair> {
        let source = clouds.get(&pair.source, settings, 2 * number as u64)?;
        let target = clouds.get(&pair.target, settings, 2 * number as u64 + 1)?;
        let seed = settings.seed.wrapping_mul(1_000_003).wrapping_add(number as u64);
        let motion = match settings.moved {
            true => random_pose(seed, source.diagonal()),
            false => Transform::IDENTITY,
        };
        let moved = source.transformed(&motion)?;
        let rule = settings
            .rule
            .unwrap_or_else(|| SuccessCriterion::for_size(source.diagonal() * pair.unit));
        Ok(PreparedPair { source, moved, target, motion, rule })
    }
}

fn register_pair(
    pair: &Pair,
    number: usize,
    (name, chain): (&str, &Pipeline),
    settings: Settings,
    clouds: &mut PairClouds,
) -> Result<BenchmarkRow> {
    let PreparedPair { source, moved, target, motion, rule } =
        PreparedPair::new(pair, number, settings, clouds)?;
    let start = Instant::now();
    let found = chain.register(&moved, &target);
    let seconds = start.elapsed().as_secs_f64();
    let mut row = BenchmarkRow::new(pair, name, rule, seconds);
    match found {
        Ok(found) => {
            row.accepted = found.is_usable();
            let verdict = verdict(&found);
            row.ambiguous = verdict.is_some_and(|verdict| verdict.decision == Decision::Ambiguous);
            row.probability = verdict.map(|verdict| verdict.probability);
            row.nees = pair.truth.as_ref().and_then(|truth| {
                let truth = truth.after(&motion.inverse());
                Some(verdict?.covariance.as_ref()?.nees(&found.transform, &truth))
            });
            // In the frames of the files, like published errors.
            row.set_errors(&found.transform.after(&motion), pair, &source);
        }
        Err(error) => row.error = error.to_string(),
    }
    Ok(row)
}

/// A pair that was registered again.
#[non_exhaustive]
pub struct Rerun {
    /// The source, moved as in the first run.
    pub source: PointCloud,
    /// The source as in its file.
    pub target: PointCloud,
    /// The registration result.
    pub found: Registration,
    /// The true pose of the moved source, if the list has one.
    pub truth: Option<Transform>,
}

/// Repeats the registration of [`run`] for the pair with index `number` of its list.
///
/// # Errors
/// Those of reading clouds, and of the method.
pub fn rerun(pair: &Pair, number: usize, method: &Pipeline, settings: Settings) -> Result<Rerun> {
    let PreparedPair { moved, target, motion, .. } =
        PreparedPair::new(pair, number, settings, &mut PairClouds::default())?;
    let found = method.register(&moved, &target)?;
    let truth = pair.truth.as_ref().map(|truth| truth.after(&motion.inverse()));
    Ok(Rerun { source: moved, target, found, truth })
}

impl BenchmarkRow {
    /// Returns whether the row is of this pair.
    pub fn matches_pair(&self, pair: &Pair) -> bool {
        let same = |name: &str, path: &Path| name == path.display().to_string();
        same(&self.source, &pair.source)
            && same(&self.target, &pair.target)
            && self.dataset == pair.dataset
    }

    /// Creates the row of a pair without a pose.
    fn new(pair: &Pair, method: &str, rule: SuccessCriterion, seconds: f64) -> BenchmarkRow {
        let path = |path: &Path| path.display().to_string();
        BenchmarkRow {
            dataset: pair.dataset.clone(),
            source: path(&pair.source),
            target: path(&pair.target),
            overlap: pair.overlap.or(pair.truth.is_none().then_some(0.0)),
            method: method.into(),
            right: false,
            rule,
            rotation_deg: None,
            translation: None,
            accepted: false,
            ambiguous: false,
            probability: None,
            nees: None,
            seconds,
            error: String::new(),
        }
    }

    /// Compares `found` with the pair's true pose, if it has one.
    fn set_errors(&mut self, found: &Transform, pair: &Pair, source: &PointCloud) {
        if let Some(truth) = &pair.truth {
            let error = self.rule.error(found, truth, source);
            self.right = self.rule.is_met(error, source, pair.unit);
            self.rotation_deg = Some(error.rotation_deg);
            self.translation = Some(error.translation);
        }
    }
}

/// Returns the verdict of the first method: refinements keep its pose.
fn verdict(found: &Registration) -> Option<&crate::verify::Verdict> {
    let before = found.refined_from.as_deref();
    found.verdict.as_ref().or_else(|| before.and_then(verdict))
}

/// Draws a uniformly random rotation, and a translation of up to `size` along each axis.
pub fn random_pose(seed: u64, size: f64) -> Transform {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = || 2.0 * rng.random::<f64>() - 1.0;
    // Rejection from the 4D cube gives a uniform unit quaternion.
    let [w, x, y, z] = loop {
        let drawn = [(); 4].map(|()| uniform());
        let square: f64 = drawn.iter().map(|x| x * x).sum();
        if (0.01..=1.0).contains(&square) {
            break drawn.map(|x| x / square.sqrt());
        }
    };
    let sine = math::norm([x, y, z]);
    let angle = 2.0 * sine.atan2(w);
    let vector = math::scaled([x, y, z], angle / sine.max(1e-12));
    let translation: Vec3 = [(); 3].map(|()| size * uniform());
    Transform { translation, ..Transform::from_rotation_vector(vector) }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::cloud::shape::boulder;
    use crate::io;

    fn pairs(folder: &Path) -> Vec<Pair> {
        for (name, seed) in [("a.ply", 1), ("b.ply", 2)] {
            io::write(folder.join(name), &boulder().sample(600, seed).unwrap()).unwrap();
        }
        let pair = |truth| Pair {
            dataset: "boulder".into(),
            source: folder.join("a.ply"),
            target: folder.join("b.ply"),
            truth,
            overlap: Some(1.0),
            unit: 1.0,
        };
        vec![pair(Some(Transform::IDENTITY))]
    }

    #[test]
    fn rows_are_kept_and_not_run_again() {
        let folder = tempfile::tempdir().unwrap();
        let (pairs, output) = (pairs(folder.path()), folder.path().join("rows.csv"));
        let settings = Settings { rule: Some(SuccessCriterion::Relative), ..Settings::default() };
        let methods = ["consensus".to_string(), "consensus+icp".to_string()];
        let run =
            |methods: &[String], settings| run(&pairs, methods, settings, Some(&output), |_, _| ());
        let first = run(&methods[..1], settings).unwrap();
        assert!(first[0].right && first[0].error.is_empty(), "{first:?}");
        let both = run(&methods, settings).unwrap();
        // The same seconds to the last digit: it was read, not run.
        assert_eq!(both[0], first[0]);
        assert_eq!(both[1].method, "consensus+icp");
        // Cut within its last row: that row is run again.
        let text = fs::read_to_string(&output).unwrap();
        fs::write(&output, &text[..text.len() - 5]).unwrap();
        let again = run(&methods, settings).unwrap();
        assert_eq!((again[0].seconds, again[1].right), (first[0].seconds, both[1].right));
        assert_eq!(fs::read_to_string(&output).unwrap().lines().count(), 4);
        let other = Settings { seed: 1, ..settings };
        assert!(run(&methods, other).unwrap_err().to_string().contains("other settings"));
    }

    #[test]
    fn motions_are_rotations_of_all_angles() {
        let angles: Vec<f64> =
            (0..200).map(|seed| random_pose(seed, 1.0).angle().to_degrees()).collect();
        let mean = angles.iter().sum::<f64>() / 200.0;
        // A uniform rotation has the mean angle 90° + 360°/π² = 126.5°.
        assert!((mean - 126.5).abs() < 8.0, "{mean}");
        let turn = random_pose(3, 1.0).rotation;
        assert!((math::determinant(&turn) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn methods_are_named_with_their_refinements() {
        assert!(parse_method("cf+icp+gicp").is_ok() && parse_method("consensus").is_ok());
        for bad in ["", "cf+", "icp+cf", "sift"] {
            assert!(parse_method(bad).is_err(), "{bad}");
        }
    }
}
