//! One step against overlap: pairs of real scans, moved at random, registered by one closed-form
//! solve.
//!
//! Methods on the full connection get clouds downsampled to one voxel size, as many points as
//! `cf-spectral` uses; `cf-spectral`, `teaser` and `consensus` get the same or the whole clouds and
//! downsample them on their own. The sensors' positions are known: the zero of each file, where the
//! file names none.

mod interval;
mod picture;
mod table;

use std::path::PathBuf;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use serde_json::json;

pub use interval::clopper_pearson;
pub use table::markdown;

use super::{csv_cache, files};
use cfreg::benchmark::{Pair, SuccessCriterion, list, random_pose};
use cfreg::cloud::{PointCloud, Transform, ViewpointSource};
use cfreg::error::{Error, Result};
use cfreg::method::{Cf, CfSpectral, Method, Register, Registration};
use cfreg::verify::pose_error;
use cfreg::weight::Normalization;
use cfreg::{filter, io};

/// Pairs, and where the results go.
#[derive(Debug, Clone, PartialEq)]
pub struct OverlapOptions {
    /// Lists of pairs ([`list::read`]), with files relative to the folder of each list.
    pub lists: Vec<PathBuf>,
    /// Folder of the results; created if missing. Existing runs with the same settings are not
    /// repeated.
    pub output: PathBuf,
    /// Only every N-th pair, at least 1.
    pub every: usize,
    /// Names of the methods ([`contender`]).
    pub methods: Vec<String>,
}

/// The methods by name: the three one-step methods of the full connection, the one with
/// second-order weights, and two that are not one step.
pub const CONTENDERS: [&str; 6] =
    ["cf", "cf-both", "cf-multiscale", "cf-spectral", "teaser", "consensus"];

/// Rotation error up to which a pose is right, degrees.
pub const RIGHT_DEG: f64 = 10.0;
/// Points of the clouds for methods that do not downsample.
const POINTS: usize = CfSpectral::POINTS;

/// A method on a pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OverlapRun {
    /// Set of the pair.
    pub dataset: String,
    /// File of the source, as in the list.
    pub source: String,
    /// File of the target.
    pub target: String,
    /// Share of the source that the target also covers.
    pub overlap: f64,
    /// Name of the method.
    pub method: String,
    /// Rotation error, degrees; empty without a pose.
    pub rotation_deg: Option<f64>,
    /// Distance of the source's centroids under the pose and the truth, as a share of the source's
    /// diagonal; empty without a pose.
    pub shift: Option<f64>,
    /// Whether the pose meets the success criterion of its size ([`SuccessCriterion::for_size`]).
    pub meets_criterion: bool,
    /// Second over first eigenvalue of the second-order compatibility; empty for other methods.
    pub eigenvalue_ratio: Option<f64>,
    /// Seconds of the registration.
    pub seconds: f64,
    /// Why there is no pose; empty with one.
    pub error: String,
}

impl OverlapRun {
    /// Returns whether the rotation is within [`RIGHT_DEG`].
    pub fn is_right(&self) -> bool {
        self.rotation_deg.is_some_and(|degrees| degrees <= RIGHT_DEG)
    }
}

/// Everything that the runs depend on: the first line of the file.
#[derive(Serialize)]
struct OverlapSettings<'a> {
    lists: Vec<String>,
    every: usize,
    method: &'a str,
    settings: &'a Method,
    points: usize,
    version: &'static str,
}

/// Returns the method of that name: one of [`CONTENDERS`], or `cf-spectral:NAME=VALUE`, with one of
/// its numbers, or of its compatibility's, other than the default.
///
/// # Errors
/// [`Error::Config`] for another name, and for a variation that is not such a number; those of
/// [`Method::with`].
pub fn contender(name: &str) -> Result<Method> {
    let rule = || format!("must be of {}, or cf-spectral:NAME=VALUE", CONTENDERS.join(", "));
    let unknown = || Error::config("methods", name, rule());
    if let Some(variation) = name.strip_prefix("cf-spectral:") {
        let (setting, value) = variation.split_once('=').ok_or_else(unknown)?;
        let number: serde_json::Number = value.parse().map_err(|_| unknown())?;
        let method = Method::CfSpectral(CfSpectral::default());
        return match setting {
            "length_tolerance" | "min_length" | "normal_tolerance" => {
                method.with([("compatibility", json!({ setting: number }))])
            }
            _ => method.with([(setting, number.into())]),
        };
    }
    match name {
        "cf-both" => Ok(Method::Cf(Cf { normalization: Normalization::Both, ..Cf::default() })),
        _ if CONTENDERS.contains(&name) => name.parse(),
        _ => Err(unknown()),
    }
}

/// Registers every pair with a known overlap by every method, or reads earlier results; `progress`
/// receives the numbers of finished runs and of all runs.
///
/// # Errors
/// Those of reading lists and clouds, and of writing results. A run without a pose is a result.
pub fn run(
    options: &OverlapOptions,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<OverlapRun>> {
    let mut pairs = Vec::new();
    for path in &options.lists {
        pairs.extend(list::read(path, path.parent().unwrap_or("".as_ref()))?);
    }
    let numbered = (0..).zip(&pairs).step_by(options.every.max(1));
    let pairs: Vec<(u64, &Pair)> =
        numbered.filter(|(_, pair)| pair.truth.is_some() && pair.overlap.is_some()).collect();
    let all = pairs.len() * options.methods.len();
    let mut runs = Vec::new();
    for name in &options.methods {
        let method = contender(name)?;
        let settings = OverlapSettings {
            lists: options.lists.iter().map(|path| path.display().to_string()).collect(),
            every: options.every,
            method: name,
            settings: &method,
            points: POINTS,
            version: env!("CARGO_PKG_VERSION"),
        };
        let path = options.output.join(format!("overlap_{}.csv", name.replace([':', '='], "_")));
        let own = match csv_cache::read(&path, &settings) {
            Some(own) => own,
            None => {
                let before = runs.len();
                let mut own = Vec::new();
                for &(number, pair) in &pairs {
                    own.push(register(name, &method, number, pair)?);
                    progress(before + own.len(), all);
                }
                csv_cache::write(&path, &settings, &own)?;
                own
            }
        };
        runs.extend(own);
        progress(runs.len(), all);
    }
    let text = markdown(&runs, &options.methods);
    files::write_bytes(&options.output.join("overlap.md"), text.as_bytes())?;
    picture::figure(&runs, &options.methods)
        .save(&options.output.join("one-step-against-overlap"))?;
    Ok(runs)
}

/// The clouds of a pair: the source as in its file, moved at random, and the target.
struct MovedPair {
    source: PointCloud,
    moved: PointCloud,
    target: PointCloud,
    motion: Transform,
}

impl MovedPair {
    fn read(number: u64, pair: &Pair) -> Result<MovedPair> {
        let read = |path| ViewpointSource::Origin.apply(io::read(path)?);
        let (source, target) = (read(&pair.source)?, read(&pair.target)?);
        let motion = random_pose(number, source.diagonal());
        Ok(MovedPair { moved: source.transformed(&motion)?, source, target, motion })
    }

    /// Downsamples both to one voxel size, with some [`POINTS`] points of the larger one.
    fn downsampled(&self) -> Result<[PointCloud; 2]> {
        let ends = [&self.moved, &self.target];
        let mut size: f64 = 0.0;
        for cloud in ends {
            size = size.max(filter::voxel_size_for(cloud, POINTS)?);
        }
        Ok([filter::voxel_grid(ends[0], size)?, filter::voxel_grid(ends[1], size)?])
    }
}

fn register(name: &str, method: &Method, number: u64, pair: &Pair) -> Result<OverlapRun> {
    let clouds = MovedPair::read(number, pair)?;
    let downsamples = matches!(method, Method::CfSpectral(_) | Method::Consensus(_));
    let thin = if downsamples { None } else { Some(clouds.downsampled()?) };
    let [source, target] = match &thin {
        Some([source, target]) => [source, target],
        None => [&clouds.moved, &clouds.target],
    };
    let start = Instant::now();
    let found = method.register(source, target);
    let seconds = start.elapsed().as_secs_f64();
    let path = |path: &std::path::Path| path.display().to_string();
    let run = OverlapRun {
        dataset: pair.dataset.clone(),
        source: path(&pair.source),
        target: path(&pair.target),
        overlap: pair.overlap.unwrap_or(0.0),
        method: name.into(),
        rotation_deg: None,
        shift: None,
        meets_criterion: false,
        eigenvalue_ratio: None,
        seconds,
        error: String::new(),
    };
    Ok(match found {
        Ok(found) => run.with_pose(&found, pair, &clouds),
        Err(error) => OverlapRun { error: error.to_string(), ..run },
    })
}

impl OverlapRun {
    fn with_pose(self, found: &Registration, pair: &Pair, clouds: &MovedPair) -> OverlapRun {
        let MovedPair { source, motion, .. } = clouds;
        let pose = found.transform.after(motion);
        let truth = pair.truth.unwrap_or(Transform::IDENTITY);
        let error = pose_error(&pose, &truth, source.centroid());
        let rule = SuccessCriterion::for_size(source.diagonal() * pair.unit);
        OverlapRun {
            rotation_deg: Some(error.rotation_deg),
            shift: Some(error.translation / source.diagonal()),
            meets_criterion: rule.is_met(rule.error(&pose, &truth, source), source, pair.unit),
            eigenvalue_ratio: found.eigenvalue_ratio,
            ..self
        }
    }
}
