//! The poses that `consensus` evaluates before each result, as a table: the training data of its
//! verdict model.

use std::path::Path;

use serde::Serialize;

use super::{Pair, PairClouds, PreparedPair, Settings};
use crate::error::{Error, Result};
use crate::io::outputs;
use crate::method::Consensus;

/// One verified pose of one pair.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct CandidateRow {
    /// The pair's set.
    pub dataset: String,
    /// File of the source, as in the list.
    pub source: String,
    /// File of the target.
    pub target: String,
    /// Overlap: share of a surface that coincides with the other and has similar normals.
    pub overlap: f64,
    /// Descriptor similarity of the overlapping surfaces beyond chance, nats a point.
    pub likeness: f64,
    /// Inlier score of the correspondences.
    pub support: f64,
    /// Share of the points in space that the other sensor saw to be empty; empty without a known
    /// viewpoint.
    pub contradicted: Option<f64>,
    /// Refined hypotheses that converged to this pose; for final poses alone.
    pub votes: Option<usize>,
    /// Standard deviation of the translation, in voxel sizes of the downsampled clouds, from 0.02
    /// to 10; for final poses alone.
    pub spread: Option<f64>,
    /// Whether the pose is correct; false for unrelated clouds.
    pub right: bool,
    /// Whether it is the final pose, the last row of its pair.
    pub answer: bool,
}

/// Writes to `output` every pose that [`Consensus`] refines for each of `pairs`, moved as
/// [`run`](super::run) moves them, and returns their number. `progress` is called with the numbers
/// of pairs done and of all pairs. A pair without a pose has no rows.
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
