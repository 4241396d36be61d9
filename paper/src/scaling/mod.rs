//! Time and memory of every method over the number of points.
//!
//! Each method runs, on one thread and with the settings of its name, on two samples of the bunny's
//! surface that are slightly rotated against each other: near enough for the methods that start
//! from a pose. Times depend on the machine and the day, and so do the sizes at which a method
//! stops; everything else is reproducible.

mod growth;
mod report;

use std::path::PathBuf;
use std::time::Instant;

use serde::{Deserialize, Serialize};

pub use growth::Growth;
pub use report::{draw, markdown};

use super::experiments::cell::{Interpretation, Shape};
use super::experiments::models;
use super::protocol::{Draw, Protocol, REVISION, Trial};
use super::{Model, Motion, csv_cache};
use cfreg::error::{Error, Result};
use cfreg::method::{Method, Register, Registration};
use cfreg::par;

/// Methods to run, by the names that `--method` takes.
pub const METHODS: [&str; 11] = [
    "cf",
    "cf-multiscale",
    "cf-spectral",
    "cfk",
    "icp",
    "plane-icp",
    "gicp",
    "kc",
    "cpd",
    "dare",
    "teaser",
];

/// Range of the runs, and the output folder.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalingOptions {
    /// Folder of the scans ([`models::load`]).
    pub data: PathBuf,
    /// Folder of the results; created if missing. Existing runs that are complete and have the same
    /// settings are not repeated.
    pub output: PathBuf,
    /// Numbers of points of each cloud, ascending.
    pub sizes: Vec<usize>,
    /// What no run should exceed: a method stops at the first size where the runs before
    /// lead to expect more.
    pub limit: RunLimit,
}

/// Limits of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RunLimit {
    /// Seconds.
    pub seconds: f64,
    /// Bytes; without effect unless there is a [`Meter`].
    pub bytes: u64,
}

impl ScalingOptions {
    /// From 500 points to where a run takes 10 s or 2 GiB, in a few minutes; with `smoke` at
    /// three sizes in a few seconds.
    pub fn new(data: PathBuf, output: PathBuf, smoke: bool) -> Self {
        let hundreds = [5, 10, 20, 50, 100, 200, 500, 1000, 2000];
        let sizes = if smoke { vec![300, 600, 1200] } else { hundreds.map(|k| 100 * k).into() };
        let seconds = if smoke { 30.0 } else { 10.0 };
        ScalingOptions { data, output, sizes, limit: RunLimit { seconds, bytes: 2 << 30 } }
    }
}

/// Measures the memory of the process. A library has no allocator of its own to ask: a program that
/// counts allocations passes its counters.
#[derive(Debug, Clone, Copy)]
pub struct Meter {
    /// Returns the allocated bytes, and restarts the peak from there.
    pub start: fn() -> usize,
    /// Returns the maximum of allocated bytes since the start.
    pub peak: fn() -> usize,
}

/// A measured registration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Name of the method.
    pub method: String,
    /// Points of each cloud.
    pub points: usize,
    /// Wall-clock seconds on one thread, the minimum of a few runs if it is short.
    pub seconds: f64,
    /// Maximum of simultaneously allocated bytes, beyond the clouds themselves; empty if not
    /// measured.
    pub bytes: Option<u64>,
    /// Number of times that weights were computed and solved; 0 without a pose, and `trusted` is
    /// false.
    pub iterations: u32,
    /// Rotation error, degrees; empty without a pose.
    pub rotation_deg: Option<f64>,
    /// Whether the pose has no warning.
    pub trusted: bool,
    /// Seconds of the stages, in their order.
    pub stages: String,
    /// Why there is no pose; empty with one.
    pub error: String,
}

/// Everything except the machine that runs depend on: the first line of the file.
#[derive(Serialize)]
struct ScalingSettings<'a> {
    shape: Shape,
    reading: Interpretation,
    motion: Motion,
    seed: u64,
    sizes: &'a [usize],
    limit: RunLimit,
    memory: bool,
    model: String,
    revision: u32,
    version: &'static str,
    methods: &'a [Method],
    remark: &'static str,
}

const REMARK: &str =
    "seconds are of one machine and one day: another run has others, and may stop at other sizes";

const SEED: u64 = 2020;
const MOTION: Motion = Motion::Small;
const READING: Interpretation = Interpretation::Fitting;

/// Measures every method at every size within the limit, or reads earlier measurements; `progress`
/// receives the number of finished runs and of all runs.
///
/// # Errors
/// [`Error::Config`] for sizes that do not grow, or start below three; [`Error::Io`] for a missing
/// scan or a folder that cannot be written; the errors of the readers. A run without a pose is a
/// result.
pub fn run(
    options: &ScalingOptions,
    meter: Option<Meter>,
    progress: impl FnMut(usize, usize),
) -> Result<Vec<Run>> {
    if !options.sizes.is_sorted_by(|a, b| a < b) {
        return Err(Error::config("sizes", format!("{:?}", options.sizes), "must grow"));
    }
    let path = options.output.join("scaling.csv");
    let methods: Vec<Method> = METHODS.iter().map(|name| name.parse()).collect::<Result<_>>()?;
    let models::Source { model, digest, .. } = models::load(&options.data, Shape::Bunny, READING)?;
    let settings = ScalingSettings {
        shape: Shape::Bunny,
        reading: READING,
        motion: MOTION,
        seed: SEED,
        sizes: &options.sizes,
        limit: options.limit,
        memory: meter.is_some(),
        model: digest,
        revision: REVISION,
        version: env!("CARGO_PKG_VERSION"),
        methods: &methods,
        remark: REMARK,
    };
    if let Some(runs) = csv_cache::read(&path, &settings) {
        return Ok(runs);
    }
    std::fs::create_dir_all(&options.output).map_err(|error| Error::io(&options.output, error))?;
    let runs = measure_all(options, &methods, &model, meter, progress)?;
    csv_cache::write(&path, &settings, &runs)?;
    Ok(runs)
}

fn measure_all(
    options: &ScalingOptions,
    methods: &[Method],
    model: &Model,
    meter: Option<Meter>,
    mut progress: impl FnMut(usize, usize),
) -> Result<Vec<Run>> {
    let (mut runs, each) = (Vec::new(), options.sizes.len());
    for (k, (&name, method)) in METHODS.iter().zip(methods).enumerate() {
        let mut before: Vec<Run> = Vec::new();
        for (j, &points) in options.sizes.iter().enumerate() {
            progress(k * each + j, methods.len() * each);
            if exceeds_limit(options.limit, &before, points) {
                break;
            }
            // A separate thread: its count includes the per-thread state of libraries, and no other
            // count does.
            let trial = pair(model, points)?;
            before.push(par::on_new_thread(|| measure(name, method, &trial, meter))?);
        }
        runs.extend(before);
    }
    progress(methods.len() * each, methods.len() * each);
    Ok(runs)
}

/// Generates two samples, slightly rotated against each other.
fn pair(model: &Model, points: usize) -> Result<Trial> {
    let viewpoint = READING.viewpoint();
    let draw = Draw { motion: MOTION, viewpoint, points, seed: SEED, number: 0 };
    Protocol::Accuracy.trial(model, draw)
}

/// Whether a run with `points` is expected beyond the limit, as those before grew.
fn exceeds_limit(limit: RunLimit, before: &[Run], points: usize) -> bool {
    let expected = |measure: &dyn Fn(&Run) -> f64| {
        let at = |run: &Run| [run.points as f64, measure(run)];
        let (last, others) = before.split_last()?;
        let [n, value] = at(last);
        // From a single run: the worst usual exponent.
        let exponent = others.last().map_or(2.0, |run| {
            let [earlier, less] = at(run);
            (value / less).ln() / (n / earlier).ln()
        });
        Some(value * (points as f64 / n).powf(exponent.clamp(1.0, 3.0)))
    };
    let more = |expected: Option<f64>, most| expected.is_some_and(|expected| expected > most);
    more(expected(&|run| run.seconds), limit.seconds)
        || more(expected(&|run| run.bytes.unwrap_or(1) as f64), limit.bytes as f64)
}

/// Seconds up to which a run is repeated, and how often at most.
const REPEAT_BELOW_SECONDS: f64 = 0.5;
const MAX_REPEATS: usize = 5;

/// Measures on the threads that it is called from.
fn measure(name: &str, method: &Method, trial: &Trial, meter: Option<Meter>) -> Run {
    let timed = || {
        let start = Instant::now();
        let found = method.register(&trial.source, &trial.target);
        (start.elapsed().as_secs_f64(), found)
    };
    let held = meter.map(|meter| (meter.start)());
    let mut least = timed();
    let bytes = meter.zip(held).map(|(meter, held)| (meter.peak)().saturating_sub(held) as u64);
    let mut spent = least.0;
    for _ in 1..MAX_REPEATS {
        if spent > REPEAT_BELOW_SECONDS {
            break;
        }
        let again = timed();
        spent += again.0;
        if again.0 < least.0 {
            least = again;
        }
    }
    let (seconds, found) = least;
    let run = Run {
        method: name.into(),
        points: trial.source.len(),
        seconds,
        bytes,
        iterations: 0,
        rotation_deg: None,
        trusted: false,
        stages: String::new(),
        error: String::new(),
    };
    match found {
        Ok(found) => Run {
            iterations: found.iterations,
            rotation_deg: Some(trial.error(&found.transform).rotation_deg),
            trusted: found.trusted,
            stages: stages_text(&found),
            ..run
        },
        Err(error) => Run { error: error.to_string(), ..run },
    }
}

fn stages_text(found: &Registration) -> String {
    let stages = found.time_s.0.iter();
    stages.map(|(name, seconds)| format!("{name} {seconds:.2e}")).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(points: usize, seconds: f64, bytes: Option<u64>) -> Run {
        let (method, stages, error) = ("cf".into(), String::new(), String::new());
        let (iterations, rotation_deg, trusted) = (1, Some(0.5), true);
        Run { method, points, seconds, bytes, iterations, rotation_deg, trusted, stages, error }
    }

    #[test]
    fn a_method_stops_where_its_growth_would_exceed_a_limit() {
        let limit = RunLimit { seconds: 10.0, bytes: 1000 };
        let beyond = |before: &[Run], points| super::exceeds_limit(limit, before, points);
        assert!(!beyond(&[], 1_000_000));
        // One run: quadratic growth is assumed.
        assert!(!beyond(&[run(100, 1.0, None)], 300) && beyond(&[run(100, 1.0, None)], 320));
        // The exponent 1 of the earlier runs, 3 at most.
        let linear = [run(100, 0.5, None), run(200, 1.0, None)];
        assert!(!beyond(&linear, 1900) && beyond(&linear, 2100));
        let steep = [run(100, 0.001, None), run(200, 1.0, None)];
        assert!(!beyond(&steep, 420) && beyond(&steep, 440));
        let large = [run(100, 0.1, Some(100)), run(200, 0.2, Some(400))];
        assert!(!beyond(&large, 310) && beyond(&large, 320));
    }

    #[test]
    fn a_run_tells_its_time_error_and_memory() {
        let model = cfreg::cloud::shape::boulder().into();
        let trial = pair(&model, 1000).unwrap();
        let meter = Meter { start: || 1000, peak: || 5000 };
        let found = measure("icp", &"icp".parse().unwrap(), &trial, Some(meter));
        assert_eq!((found.method.as_str(), found.points, found.bytes), ("icp", 1000, Some(4000)));
        assert!(found.seconds > 0.0 && found.trusted && found.rotation_deg.unwrap() < 5.0);
        assert!(found.stages.contains("evaluate "), "{}", found.stages);
        let few = pair(&model, 3).unwrap();
        let none = measure("cfk", &"cfk".parse().unwrap(), &few, None);
        assert!(none.bytes.is_none() && none.rotation_deg.is_none() && !none.error.is_empty());
    }
}
