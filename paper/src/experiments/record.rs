//! Trials of a cell: run, written, read again.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::cell::ExperimentCell;
use super::models::Source;
use crate::protocol::{Draw, REVISION, Trial};
use crate::{MeanStd, Model, csv_cache};
use cfreg::error::Result;
use cfreg::method::{Method, Register};
use cfreg::par;

/// One trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Number of the trial.
    pub trial: u64,
    /// Rotation error, degrees; these four are empty without a pose.
    pub rotation_deg: Option<f64>,
    /// ‖I − R R_gtᵀ‖_F.
    pub frobenius: Option<f64>,
    /// Error of the centroid's position, in the model's unit.
    pub translation: Option<f64>,
    /// The paper's average shift, in the model's unit.
    pub average_shift: Option<f64>,
    /// Whether the pose has no warning.
    pub trusted: bool,
    /// Number of times that weights were computed.
    pub iterations: u32,
    /// Why there is no pose; empty with one.
    pub error: String,
    /// Number of source points used: all, those with a descriptor, or keypoints.
    pub described: Option<u32>,
}

/// The trials of a cell.
#[derive(Debug, Clone, PartialEq)]
pub struct Trials {
    /// One record a trial, in order.
    pub records: Vec<Record>,
}

/// Everything that the trials of a cell depend on: its first line in a file.
#[derive(Serialize)]
struct Configuration<'a> {
    cell: ExperimentCell,
    points: usize,
    seed: u64,
    revision: u32,
    version: &'static str,
    method: Method,
    model: &'a str,
    /// The replacement of the paper's model; empty for the paper's own.
    #[serde(skip_serializing_if = "str::is_empty")]
    stand_in: &'a str,
}

impl<'a> Configuration<'a> {
    fn new(cell: &ExperimentCell, source: &'a Source) -> Self {
        Configuration {
            cell: *cell,
            points: POINTS,
            seed: SEED,
            revision: REVISION,
            version: env!("CARGO_PKG_VERSION"),
            method: cell.method(),
            model: &source.digest,
            stand_in: &source.remark,
        }
    }
}

/// Number of points of each sample (section IV).
pub(super) const POINTS: usize = 500;
/// Seed of all trials.
pub(super) const SEED: u64 = 2020;

/// Generates the pair of a trial of `cell`, the same for every contender.
///
/// # Errors
/// Those of [`Protocol::trial`](crate::protocol::Protocol::trial).
pub(super) fn trial(cell: &ExperimentCell, model: &Model, number: usize) -> Result<Trial> {
    let draw = Draw {
        motion: cell.motion,
        viewpoint: cell.viewpoint(),
        points: POINTS,
        seed: SEED,
        number: number as u64,
    };
    let trial = cell.protocol().trial(model, draw)?;
    match cell.variation {
        Some(variation) => variation.trial(trial),
        None => Ok(trial),
    }
}

impl Trials {
    /// Runs the trials of `cell` on `model`, several at a time.
    ///
    /// # Errors
    /// Those of [`Protocol::trial`](crate::protocol::Protocol::trial); a trial
    /// without a pose is a record.
    pub fn run(cell: &ExperimentCell, model: &Model) -> Result<Self> {
        let method = cell.method();
        let one = |number: usize| {
            let trial = trial(cell, model, number)?;
            let (trial_number, found) =
                (number as u64, method.register(&trial.source, &trial.target));
            Ok(match found {
                Ok(found) => {
                    let error = trial.error(&found.transform);
                    Record {
                        trial: trial_number,
                        rotation_deg: Some(error.rotation_deg),
                        frobenius: Some(error.rotation_frobenius),
                        translation: Some(error.translation),
                        average_shift: Some(trial.average_shift(&found.transform)),
                        trusted: found.trusted,
                        iterations: found.iterations,
                        error: String::new(),
                        described: Some(found.points.source.described as u32),
                    }
                }
                Err(error) => Record {
                    trial: trial_number,
                    rotation_deg: None,
                    frobenius: None,
                    translation: None,
                    average_shift: None,
                    trusted: false,
                    iterations: 0,
                    error: error.to_string(),
                    described: None,
                },
            })
        };
        let records = par::map(cell.trials, || (), |_, number| one(number));
        Ok(Trials { records: records.into_iter().collect::<Result<_>>()? })
    }

    /// Writes the trials of `cell` on `source` as CSV, after a comment with everything that they
    /// depend on.
    ///
    /// # Errors
    /// [`Error::Io`](cfreg::Error::Io).
    pub fn write(&self, cell: &ExperimentCell, source: &Source, path: &Path) -> Result<()> {
        csv_cache::write(path, &Configuration::new(cell, source), &self.records)
    }

    /// Reads what [`write`](Self::write) wrote, if it is there, whole and of this very cell.
    pub fn read(cell: &ExperimentCell, source: &Source, path: &Path) -> Option<Self> {
        let records = csv_cache::read(path, &Configuration::new(cell, source))?;
        Some(Trials { records })
    }

    /// Mean and standard deviation of `measure` over the trials that gave an answer; `None`
    /// where none did.
    pub fn spread(&self, measure: impl Fn(&Record) -> Option<f64>) -> Option<MeanStd> {
        let values: Vec<f64> = self.records.iter().filter_map(measure).collect();
        MeanStd::from_values(&values)
    }

    /// Returns the number of trials without a pose.
    pub fn failures(&self) -> usize {
        self.records.iter().filter(|record| !record.error.is_empty()).count()
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell::{Contender, Interpretation, Shape, Test};
    use super::*;
    use crate::Motion;
    use cfreg::cloud::shape::boulder;

    fn cell(trials: usize) -> ExperimentCell {
        ExperimentCell {
            test: Test::Accuracy,
            reading: Interpretation::Fitting,
            shape: Shape::Bunny,
            motion: Motion::Large,
            contender: Contender::Cf,
            noise: 0,
            trials,
            variation: None,
        }
    }

    #[test]
    fn trials_come_back_and_others_are_not_taken_for_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cell.csv");
        let source = |remark: &str, digest: &str| Source {
            model: boulder().into(),
            path: "boulder".into(),
            remark: remark.into(),
            digest: digest.into(),
        };
        let own = source("", "1");
        let trials = Trials::run(&cell(3), &own.model).unwrap();
        assert_eq!(trials, Trials::run(&cell(3), &own.model).unwrap());
        trials.write(&cell(3), &own, &path).unwrap();
        assert_eq!(Trials::read(&cell(3), &own, &path), Some(trials.clone()));
        let other = ExperimentCell { contender: Contender::Cpd, ..cell(3) };
        assert_eq!(Trials::read(&other, &own, &path), None);
        assert_eq!(Trials::read(&cell(4), &own, &path), None);
        for another in [source("a model of clay", "1"), source("", "2")] {
            assert_eq!(Trials::read(&cell(3), &another, &path), None);
        }
        // Truncated, as by a crash.
        let text = std::fs::read(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 30]).unwrap();
        assert_eq!(Trials::read(&cell(3), &own, &path), None);
    }
}
