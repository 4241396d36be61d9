//! The paper's accuracy test (section IV-D, Table II).

use serde::Serialize;

use super::protocol::{Draw, NormalViewpoint, Protocol};
use super::{MeanStd, Model, Motion};
use cfreg::error::{Error, Result};
use cfreg::method::Register;
use cfreg::verify::PoseError;

/// Settings of the test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct AccuracySettings {
    /// Pairs that are registered; default 100.
    pub trials: usize,
    /// Points drawn from the model for each cloud of a pair; default 500.
    pub points: usize,
    /// Kind of motion; default large.
    pub motion: Motion,
    /// Seed of motions and samples.
    pub seed: u64,
}

impl Default for AccuracySettings {
    fn default() -> Self {
        AccuracySettings { trials: 100, points: 500, motion: Motion::Large, seed: 0 }
    }
}

/// Results of the trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AccuracyReport {
    /// The settings.
    pub settings: AccuracySettings,
    /// One error a trial, in order; `None` where there was no answer.
    pub errors: Vec<Option<PoseError>>,
    /// Number of trials whose pose was reported as not trusted.
    pub doubted: usize,
}

impl AccuracyReport {
    /// Mean and standard deviation of `measure` over the trials that gave an answer.
    pub fn statistics(&self, measure: impl Fn(&PoseError) -> f64) -> (f64, f64) {
        let values: Vec<f64> = self.errors.iter().flatten().map(measure).collect();
        MeanStd::from_values(&values)
            .map_or((f64::NAN, f64::NAN), |spread| (spread.mean, spread.deviation))
    }

    /// Returns the number of trials without a pose.
    pub fn failures(&self) -> usize {
        self.errors.iter().filter(|error| error.is_none()).count()
    }
}

/// Runs the test: both clouds of a pair are sampled from `model` independently, the target is
/// moved, `method` estimates the motion. `progress` is called after every trial.
///
/// # Errors
/// [`Error::Config`] for no trials or samples below three points, the errors of [`Model::sample`].
/// A trial without a pose is counted and is no error.
pub fn run(
    model: &Model,
    method: &dyn Register,
    settings: AccuracySettings,
    mut progress: impl FnMut(usize),
) -> Result<AccuracyReport> {
    if settings.trials == 0 {
        return Err(Error::config("trials", 0, "must be at least 1"));
    }
    let AccuracySettings { points, motion, seed, .. } = settings;
    let mut report = AccuracyReport { settings, errors: Vec::new(), doubted: 0 };
    for number in 0..settings.trials as u64 {
        let draw = Draw { motion, viewpoint: NormalViewpoint::Origin, points, seed, number };
        let trial = Protocol::Accuracy.trial(model, draw)?;
        let answer = method.register(&trial.source, &trial.target).ok();
        report.doubted += usize::from(answer.as_ref().is_some_and(|answer| !answer.trusted));
        report.errors.push(answer.map(|answer| trial.error(&answer.transform)));
        progress(report.errors.len());
    }
    Ok(report)
}
