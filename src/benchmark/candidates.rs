//! The poses that `consensus` evaluates before each result, as a table: the training data of its
//! verdict model.

use std::path::Path;

use serde::Serialize;

use super::{Pair, PairClouds, PreparedPair, Settings};
use crate::error::{Error, Result};
use crate::io::outputs;
use crate::method::Consensus;
use crate::verify::Decision;
#[cfg(doc)]
use crate::verify::Evidence;

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
    /// [`Evidence::overlap`].
    pub overlap: f64,
    /// [`Evidence::surface_conflict`].
    pub surface_conflict: f64,
    /// [`Evidence::residual_std`].
    pub residual_std: f64,
    /// [`Evidence::surface_patches`].
    pub surface_patches: f64,
    /// [`Evidence::descriptor_distinctiveness`].
    pub descriptor_distinctiveness: f64,
    /// [`Evidence::inlier_score`].
    pub inlier_score: f64,
    /// [`Evidence::free_space_violation`]; empty without known viewpoints.
    pub free_space_violation: Option<f64>,
    /// Refined hypotheses that converged to this pose; for final poses alone.
    pub supporting_hypotheses: Option<usize>,
    /// Standard deviation of the translation, in voxel sizes of the downsampled clouds, from 0.02
    /// to 10; for final poses alone.
    pub translation_std: Option<f64>,
    /// Difference of the ranking from that of the best other pose, from -8 to 8; for final poses
    /// alone.
    pub margin: Option<f64>,
    /// Degrees of freedom that the surfaces leave unconstrained: such a pose is not accepted; for final
    /// poses alone.
    pub unconstrained: Option<usize>,
    /// Decision of the verdict; for final poses alone.
    pub decision: Option<Decision>,
    /// Rotation error, in degrees; empty without a true pose.
    pub rotation_error_deg: Option<f64>,
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
        let scored = Consensus::default().scored_poses(&posed.moved, &posed.target);
        for scored in scored.unwrap_or_default() {
            let found = scored.transform.after(&posed.motion);
            let error = pair.truth.as_ref().map(|truth| {
                let error = posed.rule.error(&found, truth, &posed.source);
                let right = posed.rule.is_met(error, &posed.source, pair.unit);
                (right, found.after(&truth.inverse()).angle().to_degrees())
            });
            let evidence = scored.evidence;
            table
                .serialize(CandidateRow {
                    dataset: pair.dataset.clone(),
                    source: pair.source.display().to_string(),
                    target: pair.target.display().to_string(),
                    overlap: evidence.overlap,
                    surface_conflict: evidence.surface_conflict,
                    residual_std: evidence.residual_std,
                    surface_patches: evidence.surface_patches,
                    descriptor_distinctiveness: evidence.descriptor_distinctiveness,
                    inlier_score: evidence.inlier_score,
                    free_space_violation: evidence.free_space_violation,
                    supporting_hypotheses: scored.supporting_hypotheses,
                    translation_std: scored.translation_std,
                    margin: scored.margin,
                    unconstrained: scored.unconstrained,
                    decision: scored.decision,
                    rotation_error_deg: error.map(|(_, degrees)| degrees),
                    right: error.is_some_and(|(right, _)| right),
                    answer: scored.is_best,
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
