//! What `consensus` weighed before each answer, as a table: the data its verdict is fitted on.

use std::path::Path;

use serde::Serialize;

use super::{Pair, PairClouds, PreparedPair, Settings};
use crate::error::{Error, Result};
use crate::io::outputs;
use crate::method::Consensus;

/// One judged pose of one pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CandidateRow {
    /// The pair's set.
    pub dataset: String,
    /// File of the source, as in the list.
    pub source: String,
    /// File of the target.
    pub target: String,
    /// Share of a surface that lies on the other and faces alike.
    pub overlap: f64,
    /// How much more alike than chance the surfaces look there, nats a point.
    pub likeness: f64,
    /// Matches that agree.
    pub support: f64,
    /// Share of the points that stand where the other's sensor looked through; empty where no
    /// sensor's place is known.
    pub contradicted: Option<f64>,
    /// Settled poses that are this one; of answers alone.
    pub votes: Option<usize>,
    /// Standard deviation of the shift, in lengths that clouds are thinned to, from 0.02 to 10;
    /// of answers alone.
    pub spread: Option<f64>,
    /// Whether the pose is right; false for clouds with nothing in common.
    pub right: bool,
    /// Whether it is the answer, the last row of its pair.
    pub answer: bool,
}

/// Writes to `output` every pose that [`Consensus`] settles for each of `pairs`, moved as
/// [`run`](super::run) moves them, and gives their number. `progress` is called with the pairs
/// done and all of them. A pair without an answer has no rows.
///
/// # Errors
/// Those of reading clouds, and [`Error::Io`] of `output`.
pub fn write(
    pairs: &[Pair],
    settings: Settings,
    output: &Path,
    mut progress: impl FnMut(usize, usize),
) -> Result<usize> {
    let failed = |error: csv::Error| Error::io(output, std::io::Error::other(error));
    let system = |error| Error::io(output, error);
    let file = outputs::create_temporary(output).map_err(system)?;
    let mut table = csv::Writer::from_writer(file.as_file());
    let (mut clouds, mut written) = (PairClouds::default(), 0);
    for (number, pair) in pairs.iter().enumerate() {
        let posed = PreparedPair::new(pair, number, settings, &mut clouds)?;
        let judged = Consensus::default().scored_poses(&posed.moved, &posed.target);
        for judged in judged.unwrap_or_default() {
            let found = judged.transform.after(&posed.motion);
            let right = pair.truth.as_ref().is_some_and(|truth| {
                let error = posed.rule.error(&found, truth, &posed.source);
                posed.rule.is_met(error, &posed.source, pair.unit)
            });
            table
                .serialize(CandidateRow {
                    dataset: pair.dataset.clone(),
                    source: pair.source.display().to_string(),
                    target: pair.target.display().to_string(),
                    overlap: judged.overlap,
                    likeness: judged.descriptor_distinctiveness,
                    support: judged.inlier_score,
                    contradicted: judged.free_space_violation,
                    votes: judged.supporting_hypotheses,
                    spread: judged.translation_std,
                    right,
                    answer: judged.is_best,
                })
                .map_err(failed)?;
            written += 1;
        }
        progress(number + 1, pairs.len());
    }
    table.flush().map_err(system)?;
    drop(table);
    file.persist(output).map_err(|error| system(error.error))?;
    Ok(written)
}
