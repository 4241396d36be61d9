//! The part of a result that a page shows: that of a registration, or of a row of a list.

use crate::batch::{Row, symmetric_from_triangle};
use crate::cloud::Transform;
use crate::error::Result;
use crate::method::Registration;
use crate::verify::{Decision, Evaluation, PoseCovariance, Verdict};

/// A result, whole or in part.
#[derive(Debug, Clone)]
pub(super) struct PairResult<'a> {
    pub(super) pose: Transform,
    pub(super) trusted: bool,
    /// Warnings in words.
    pub(super) warnings: Vec<String>,
    pub(super) verdict: Option<Verdict>,
    pub(super) evaluation: Option<Evaluation>,
    /// The whole result; `None` for a row, which has no more than the fields above.
    pub(super) registration: Option<&'a Registration>,
}

impl<'a> PairResult<'a> {
    pub(super) fn from_registration(found: &'a Registration) -> PairResult<'a> {
        PairResult {
            pose: found.transform,
            trusted: found.trusted,
            warnings: found.doubts.iter().map(ToString::to_string).collect(),
            verdict: found.verdict.clone(),
            evaluation: Some(found.evaluation),
            registration: Some(found),
        }
    }

    /// Converts a row; `None` without a pose.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) for an invalid pose or decision.
    pub(super) fn from_row(row: &Row) -> Result<Option<PairResult<'static>>> {
        let Some(pose) = row.pose else { return Ok(None) };
        let rows = [0, 1, 2, 3].map(|i| [0, 1, 2, 3].map(|j| pose[4 * i + j]));
        Ok(Some(PairResult {
            pose: Transform::from_matrix(rows)?,
            trusted: row.is_usable(),
            warnings: split_words(&row.doubts),
            verdict: verdict_of_row(row)?,
            evaluation: row.fitness.zip(row.max_distance).map(|(fitness, max_distance)| {
                let beyond = row.agreement.unwrap_or(0.0);
                Evaluation {
                    fitness,
                    target_fitness: row.target_fitness.unwrap_or(0.0),
                    inlier_rmse: row.inlier_rmse.unwrap_or(f64::NAN),
                    max_distance,
                    // From which `beyond` follows: (fitness − chance)/(1 − chance).
                    chance_fitness: match beyond < 1.0 {
                        true => (fitness - beyond) / (1.0 - beyond),
                        false => 0.0,
                    },
                }
            }),
            registration: None,
        }))
    }

    /// Returns the names of the methods in order, `+` between them.
    pub(super) fn method_names(&self) -> String {
        self.registration.map_or_else(|| "a list".into(), Registration::method_names)
    }
}

/// Returns the verdict of a row; a row has the number of unobservable motions alone, and its
/// covariance is complete only without one.
fn verdict_of_row(row: &Row) -> Result<Option<Verdict>> {
    let Some(decision) = &row.decision else { return Ok(None) };
    let covariance = row.covariance.zip(row.center).filter(|_| row.undetermined == Some(0));
    Ok(Some(Verdict {
        decision: decision.parse::<Decision>()?,
        probability: row.probability.unwrap_or(0.0),
        reasons: split_words(&row.reasons),
        overlap: row.overlap.unwrap_or(0.0),
        evidence: None,
        runner_up: None,
        covariance: covariance.map(|(triangle, center)| PoseCovariance {
            matrix: symmetric_from_triangle(&triangle),
            center,
            unobservable: Vec::new(),
        }),
        other_scale: None,
        mirrored: false,
        model: String::new(),
        thresholds: Default::default(),
    }))
}

/// Splits texts that a row has joined.
fn split_words(words: &Option<String>) -> Vec<String> {
    words.iter().flat_map(|words| words.split("; ")).map(String::from).collect()
}
