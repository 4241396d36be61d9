//! The paper's accuracy test (section IV-D, Table II).

use std::fmt;
use std::str::FromStr;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::Model;
use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::method::Register;
use crate::quality::{TruthError, truth_error};

/// Which of the paper's two kinds of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Rotation vector uniform in [−π/8, π/8)³, about the model's centroid.
    Small,
    /// Rotation vector uniform in [−π/2, π/2)³, about the origin of the frame.
    #[default]
    Large,
}

impl Motion {
    /// Draws a motion for a model with this centroid.
    pub fn draw(self, center: Vec3, rng: &mut ChaCha8Rng) -> Transform {
        let half = match self {
            Motion::Small => std::f64::consts::PI / 8.0,
            Motion::Large => std::f64::consts::PI / 2.0,
        };
        let vector = [(); 3].map(|()| half * (2.0 * rng.random::<f64>() - 1.0));
        let turn = Transform::from_rotation_vector(vector);
        match self {
            Motion::Large => turn,
            Motion::Small => {
                let translation = math::sub(center, turn.apply(center));
                Transform { translation, ..turn }
            }
        }
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Motion::Small => "small",
            Motion::Large => "large",
        })
    }
}

impl FromStr for Motion {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        match text {
            "small" => Ok(Motion::Small),
            "large" => Ok(Motion::Large),
            _ => Err(Error::config("motion", text, "must be small or large")),
        }
    }
}

/// Settings of the test.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Protocol {
    /// Pairs that are registered; default 100.
    pub trials: usize,
    /// Points drawn from the model for each cloud of a pair; default 500.
    pub points: usize,
    /// Kind of motion; default large.
    pub motion: Motion,
    /// Seed of motions and samples.
    pub seed: u64,
}

impl Default for Protocol {
    fn default() -> Self {
        Protocol { trials: 100, points: 500, motion: Motion::Large, seed: 0 }
    }
}

/// What came of the trials.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The settings.
    pub protocol: Protocol,
    /// One error a trial, in order; `None` where there was no answer.
    pub errors: Vec<Option<TruthError>>,
    /// Trials whose answer was not to be trusted.
    pub doubted: usize,
}

impl Report {
    /// Mean and standard deviation of `measure` over the trials that gave an answer.
    pub fn statistics(&self, measure: impl Fn(&TruthError) -> f64) -> (f64, f64) {
        let values: Vec<f64> = self.errors.iter().flatten().map(measure).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
        (mean, variance.sqrt())
    }

    /// Trials without an answer.
    pub fn failures(&self) -> usize {
        self.errors.iter().filter(|error| error.is_none()).count()
    }
}

/// Runs the test: both clouds of a pair are drawn from `model` independently, the target
/// is moved, `method` finds the motion. `progress` is called after every trial.
///
/// # Errors
/// [`Error::Config`] for no trials or samples below three points, those of
/// [`Model::sample`]. A trial without an answer is counted, not an error.
pub fn run(
    model: &Model,
    method: &dyn Register,
    protocol: Protocol,
    mut progress: impl FnMut(usize),
) -> Result<Report> {
    if protocol.trials == 0 {
        return Err(Error::config("trials", 0, "must be at least 1"));
    }
    if protocol.points < 3 {
        return Err(Error::config("points", protocol.points, "must be at least 3"));
    }
    let center = model.centroid();
    let mut report = Report { protocol, errors: Vec::new(), doubted: 0 };
    for trial in 0..protocol.trials as u64 {
        // A generator a trial: trial 7 is the same whether one runs 8 or 100.
        let mut rng = ChaCha8Rng::seed_from_u64(protocol.seed);
        rng.set_stream(trial);
        let truth = protocol.motion.draw(center, &mut rng);
        let mut sample = || model.sample(protocol.points, rand::Rng::next_u64(&mut rng));
        let source = sample()?;
        let target = sample()?.transformed(&truth)?;
        let answer = method.register(&source, &target).ok();
        report.doubted += usize::from(answer.as_ref().is_some_and(|answer| !answer.trusted));
        let error = answer.map(|answer| truth_error(&answer.transform, &truth, source.centroid()));
        report.errors.push(error);
        progress(report.errors.len());
    }
    Ok(report)
}
