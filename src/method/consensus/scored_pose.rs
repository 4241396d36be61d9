//! Every scored pose of a search, with its evidence: the data for the fit of the verdict model.

use super::Consensus;
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::method::registration::Timings;
use crate::par;
use crate::surface::to_cloud_frames;
use crate::verify::{Confidence, PoseEvidence};

/// A pose that [`Consensus`] scored, and its evidence.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ScoredPose {
    /// Source into target frame.
    pub transform: Transform,
    /// Share of a surface that overlaps the other and faces the same way, in [0, 1].
    pub overlap: f64,
    /// How much more similar than by chance the overlapping surfaces are, nats a point.
    pub descriptor_distinctiveness: f64,
    /// Sum of the inlier weights of the correspondences, at least 0.
    pub inlier_score: f64,
    /// Share of the points, summed over both directions, that are in space that the other sensor
    /// saw to be empty, in [0, 2]; `None` if no viewpoint is known.
    pub free_space_violation: Option<f64>,
    /// Refined hypotheses that converged to this pose; for the best pose alone.
    pub supporting_hypotheses: Option<usize>,
    /// Standard deviation of its translation in voxel sizes, within bounds; for the best pose
    /// alone.
    pub translation_std: Option<f64>,
    /// Whether it is the best pose, scored after its last refinement.
    pub is_best: bool,
}

impl ScoredPose {
    fn from_evidence(transform: Transform, evidence: &PoseEvidence) -> ScoredPose {
        let PoseEvidence {
            overlap,
            descriptor_distinctiveness,
            inlier_score,
            free_space_violation,
        } = *evidence;
        ScoredPose {
            transform,
            overlap,
            descriptor_distinctiveness,
            inlier_score,
            free_space_violation,
            supporting_hypotheses: None,
            translation_std: None,
            is_best: false,
        }
    }

    fn from_confidence(transform: Transform, confidence: &Confidence) -> ScoredPose {
        ScoredPose {
            supporting_hypotheses: Some(confidence.supporting_hypotheses),
            translation_std: Some(confidence.bounded_translation_std()),
            is_best: true,
            ..ScoredPose::from_evidence(transform, &confidence.evidence)
        }
    }
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
            let mut judged = Vec::new();
            for attempt in &search.trials {
                let [from, onto] = &attempt.surfaces;
                judged.extend(attempt.candidates.iter().map(|candidate| {
                    ScoredPose::from_evidence(
                        to_cloud_frames(&candidate.pose, from, onto),
                        &candidate.evidence,
                    )
                }));
            }
            let [from, onto] = &search.trials[search.best_trial].surfaces;
            let pose = &search.refined.pose;
            let covariance = search.covariance(pose);
            let standing = search.confidence(pose, search.evidence, covariance.as_ref());
            judged.push(ScoredPose::from_confidence(to_cloud_frames(pose, from, onto), &standing));
            Ok(judged)
        })?
    }
}
