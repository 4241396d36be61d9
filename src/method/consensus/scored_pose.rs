//! Every scored pose of a search, with its evidence: the data for the fit of the verdict model.

use super::Consensus;
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::method::registration::Timings;
use crate::par;
use crate::surface::to_cloud_frames;
use crate::verify::{Decision, Evidence};

/// A pose that [`Consensus`] scored, and its evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ScoredPose {
    /// Source into target frame.
    pub transform: Transform,
    /// Measurements for and against the pose.
    pub evidence: Evidence,
    /// Refined hypotheses that converged to this pose; for the best pose alone.
    pub supporting_hypotheses: Option<usize>,
    /// Standard deviation of its translation in voxel sizes, within bounds; for the best pose
    /// alone.
    pub translation_std: Option<f64>,
    /// Difference of its ranking from that of the best other pose, within bounds; for the best pose
    /// alone.
    pub margin: Option<f64>,
    /// Degrees of freedom that the surfaces leave unconstrained; for the best pose alone.
    pub unconstrained: Option<usize>,
    /// Decision of the verdict; for the best pose alone.
    pub decision: Option<Decision>,
    /// Whether it is the best pose, scored after its last refinement.
    pub is_best: bool,
}

impl Consensus {
    /// Returns every refined pose of every viewpoint trial, trial by trial and the most probable of
    /// each first, and last the best pose, that of [`register`](crate::method::Register::register).
    ///
    /// # Errors
    /// Those of `register`.
    pub fn scored_poses(
        &self,
        source: &PointCloud,
        target: &PointCloud,
    ) -> Result<Vec<ScoredPose>> {
        par::with_threads(self.threads, || {
            let search =
                self.search(source.into(), target.into(), None, &mut Timings::default())?;
            let mut scored = Vec::new();
            for trial in &search.trials {
                let [from, onto] = &trial.surfaces;
                scored.extend(trial.candidates.iter().map(|candidate| ScoredPose {
                    transform: to_cloud_frames(&candidate.pose, from, onto),
                    evidence: candidate.evidence,
                    supporting_hypotheses: None,
                    translation_std: None,
                    margin: None,
                    unconstrained: None,
                    decision: None,
                    is_best: false,
                }));
            }
            let (best, alternatives) = (&search.best, &search.alternatives);
            let covariance = search.covariance(&best.pose);
            let confidence =
                search.confidence(&best.pose, best.evidence, alternatives, covariance.as_ref());
            let unconstrained = covariance.as_ref().map_or(0, |known| known.unobservable.len());
            let verdict = search.build_verdict(best, alternatives, covariance);
            scored.push(ScoredPose {
                transform: search.best_pose(),
                evidence: best.evidence,
                supporting_hypotheses: Some(confidence.supporting_hypotheses),
                translation_std: Some(confidence.bounded_translation_std()),
                margin: Some(confidence.bounded_margin()),
                unconstrained: Some(unconstrained),
                decision: Some(verdict.decision),
                is_best: true,
            });
            Ok(scored)
        })?
    }
}
