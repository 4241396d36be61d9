//! The verdict on a pose from any source, compared with all poses of a search.

use super::trial::LocalScoredPose;
use super::{
    Consensus, ConsensusSearch, DISTINCT_POSE, DUPLICATE_POSE, FINE_REFINEMENT, MAX_REFINE_SHIFT,
    mean_displacement, probe_points,
};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::method::Cached;
use crate::method::registration::Timings;
use crate::par;
use crate::surface::{
    INLIER_DISTANCE, SurfacePair, refine, surface_pairs, to_cloud_frames, to_local_frames,
};
use crate::verify::{Confidence, Decision, Evidence, PoseCovariance, RunnerUp, Verdict};

impl Consensus {
    /// Verifies a `pose` from another method or program: runs a search of this method, evaluates
    /// the pose with it, and names a more probable pose, if there is one.
    ///
    /// A pose is scored as its refined pose, if the two are the same to within a [voxel
    /// size](Self::voxel); the reasons give the distance between them. For a scale other than 1,
    /// the source is scaled first. Clouds that differ in scale by some percent have a pose with a
    /// large overlap: it is ambiguous, and the reasons name the scale.
    ///
    /// # Errors
    /// Those of [`register`](crate::method::Register::register).
    ///
    /// ```
    /// use cfreg::method::Consensus;
    /// use cfreg::verify::Decision;
    /// # use cfreg::cloud::shape::boulder;
    /// # use cfreg::Transform;
    /// # let (source, target) = (boulder().sample(2000, 1)?, boulder().sample(2000, 2)?);
    /// let wrong = Transform::from_rotation_vector([0.0, 0.0, 1.0]);
    /// let [right, wrong] = [Transform::IDENTITY, wrong]
    ///     .map(|pose| Consensus::default().verify(&source, &target, &pose));
    /// assert_eq!(right?.decision, Decision::Accept);
    /// let wrong = wrong?;
    /// assert_eq!(wrong.decision, Decision::Reject);
    /// assert!(wrong.runner_up.unwrap().transform.angle() < 0.03);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn verify(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pose: &Transform,
    ) -> Result<Verdict> {
        self.verify_cached(source.into(), target.into(), pose)
    }

    /// Verifies with caches, for clouds of many pairs.
    pub(in crate::method) fn verify_cached(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        pose: &Transform,
    ) -> Result<Verdict> {
        let scaled = match pose.scale {
            1.0 => None,
            scale => Some(source.cloud.transformed(&Transform { scale, ..Transform::IDENTITY })?),
        };
        let source = scaled.as_ref().map_or(source, Cached::from);
        let rigid = Transform { scale: 1.0, ..*pose };
        let mut verdict = par::with_threads(self.threads, || {
            let times = &mut Timings::default();
            let search = self.filter_and_search(source, target, None, times)?;
            Ok::<_, Error>(search.remove_ego_vehicle(&rigid, times).verify(&rigid))
        })??;
        if let Some(other) = &mut verdict.runner_up {
            other.transform.scale = pose.scale;
        }
        Ok(verdict)
    }
}

impl ConsensusSearch<'_> {
    /// Returns the verdict on a pose between the clouds' own frames.
    pub(in crate::method) fn verify(&self, pose: &Transform) -> Verdict {
        let best = &self.trials[self.best_trial];
        let surfaces = best.surface_refs();
        let probes = probe_points(surfaces[0]);
        let pose = to_local_frames(pose, surfaces[0], surfaces[1]);
        let max_distance = INLIER_DISTANCE * self.voxel_size;
        let refined = refine(surfaces, &pose, max_distance, FINE_REFINEMENT, &self.config.prior);
        let shift = mean_displacement(&refined.pose, &pose, &probes);
        let is_near = shift <= MAX_REFINE_SHIFT * self.voxel_size;
        let near = if is_near { refined.pose } else { pose };
        let scored = best.score(&near, &self.config);
        let mut alternatives = self.config.alternatives(best, &near, self.voxel_size);
        alternatives.extend(&self.alternatives);
        if !is_near {
            alternatives.push(best.score(&refined.pose, &self.config));
        }
        let covariance = self.covariance(&near);
        let mut verdict = self.build_verdict(&scored, &alternatives, covariance);
        let degrees = refined.pose.after(&pose.inverse()).angle().to_degrees();
        verdict.reasons.push(format!(
            "refinement on the surfaces moves the pose by {degrees:.2} degrees, and its points by \
             {shift:.3e} on average"
        ));
        verdict
    }

    /// Returns the verdict on a pose between the local frames, beside poses that could rival it.
    pub(super) fn build_verdict(
        &self,
        LocalScoredPose { pose, evidence, .. }: &LocalScoredPose,
        alternatives: &[LocalScoredPose],
        covariance: Option<PoseCovariance>,
    ) -> Verdict {
        let confidence = self.confidence(pose, *evidence, alternatives, covariance.as_ref());
        let mut reasons = self.reasons(&confidence);
        let unconstrained = covariance.as_ref().map_or(0, |known| known.unobservable.len());
        if unconstrained > 0 {
            reasons.push(format!(
                "{unconstrained} of 6 degrees of freedom are unconstrained (planar, cylindrical or \
                 spherical geometry)"
            ));
        }
        reasons.extend(self.excluded_points());
        let runner_up = self.find_runner_up(pose, &confidence, alternatives);
        let model = self.config.verdict_model();
        let probability = model.probability(&confidence);
        let verdict = Verdict::new(model, probability, *evidence, reasons, runner_up, covariance);
        if verdict.decision == Decision::Reject {
            return verdict;
        }
        if let Some(overlap) = self.find_mirrored(evidence) {
            return verdict.with_mirrored(overlap);
        }
        match self.find_scale_mismatch(pose, evidence) {
            Some(other) => verdict.with_scale_mismatch(other.scale, other.overlap),
            None => verdict,
        }
    }

    /// Describes the evidence in words.
    fn reasons(
        &self,
        Confidence { evidence, supporting_hypotheses, .. }: &Confidence,
    ) -> Vec<String> {
        let mut reasons = vec![
            format!(
                "{:.0} % of the surface overlaps, with normals that agree",
                100.0 * evidence.overlap
            ),
            format!(
                "local shape where the surfaces overlap matches with a score of {:.1} (unrelated \
                 surfaces score about 0)",
                evidence.descriptor_distinctiveness
            ),
            format!("the inlier score of the correspondences is {:.1}", evidence.inlier_score),
            match supporting_hypotheses {
                0 => "none of the hypotheses converged to this pose".into(),
                1 => "only one of the hypotheses converged to this pose".into(),
                many => format!("{many} of the hypotheses converged to this pose"),
            },
        ];
        let percent = 100.0 * evidence.surface_conflict;
        reasons.push(format!(
            "{percent:.1} % of the points that face the other surface miss it (correct poses have \
             less than 15 %)"
        ));
        if let Some(share) = evidence.free_space_violation {
            let percent = 100.0 * share;
            reasons.push(format!(
                "{percent:.1} % of the points lie in space that the other sensor saw to be empty"
            ));
        }
        reasons
    }

    /// Describes the points excluded from the search, in words.
    fn excluded_points(&self) -> Vec<String> {
        let mut reasons = Vec::new();
        for (scan, name) in self.scans.iter().zip(["source", "target"]) {
            if let Some(limit) = scan.filtered_cloud().range_limit() {
                let (points, range) = (limit.points, limit.range);
                reasons.push(format!(
                    "{points} points at the maximum range of the {name} sensor ({range:.1}) were \
                     excluded (range_limit=false keeps them)"
                ));
            }
            let min_range = scan.filtered_cloud().min_range();
            if min_range > 0.0 {
                reasons.push(format!(
                    "points within {min_range:.3e} of the {name} sensor were excluded as \
                     ego-vehicle (the pose aligns both sensors)"
                ));
            }
        }
        reasons
    }

    /// Returns the confidence in `pose`, with its `evidence`, beside the poses of the search and the
    /// `alternatives`.
    pub(super) fn confidence(
        &self,
        pose: &Transform,
        evidence: Evidence,
        alternatives: &[LocalScoredPose],
        covariance: Option<&PoseCovariance>,
    ) -> Confidence {
        let std = |known: &PoseCovariance| {
            let variance: f64 = (3..6).map(|i| known.matrix[i][i]).sum();
            variance.sqrt() / self.voxel_size
        };
        Confidence {
            evidence,
            supporting_hypotheses: self.count_supporting_hypotheses(pose),
            translation_std: covariance.map(std),
            margin: self.margin(pose, &evidence, alternatives),
        }
    }

    /// Returns the log odds of `pose` minus those of the best pose of the search or of the
    /// `alternatives` that differs.
    fn margin(
        &self,
        pose: &Transform,
        evidence: &Evidence,
        alternatives: &[LocalScoredPose],
    ) -> Option<f64> {
        let others = self.other_poses(pose).chain(self.rivals(alternatives, pose));
        let best = others.map(|other| other.log_odds).max_by(f64::total_cmp);
        best.map(|best| self.config.pose_log_odds(evidence) - best)
    }

    /// Counts the refined hypotheses that converged to `pose`.
    fn count_supporting_hypotheses(&self, pose: &Transform) -> usize {
        let is_apart = self.is_apart_from(pose, DUPLICATE_POSE);
        self.trials
            .iter()
            .flat_map(|trial| &trial.candidates)
            .filter(|other| !is_apart(other))
            .count()
    }

    /// Returns a test whether the mean displacement between a pose and `pose` is above `voxels` voxel
    /// sizes.
    fn is_apart_from(
        &self,
        pose: &Transform,
        voxels: f64,
    ) -> impl Fn(&LocalScoredPose) -> bool + use<> {
        let probes = probe_points(&self.trials[self.best_trial].surfaces[0]);
        let (pose, most) = (*pose, voxels * self.voxel_size);
        move |other| mean_displacement(&other.pose, &pose, &probes) > most
    }

    /// Returns the poses of the search that differ from `pose`.
    fn other_poses(&self, pose: &Transform) -> impl Iterator<Item = &LocalScoredPose> {
        let is_apart = self.is_apart_from(pose, DISTINCT_POSE);
        let all = self.trials.iter().flat_map(|trial| &trial.candidates).chain([&self.best]);
        all.filter(move |other| is_apart(other))
    }

    /// Returns the proposed `alternatives` that have an optimum of their own beside `pose`.
    fn rivals<'a>(
        &self,
        alternatives: &'a [LocalScoredPose],
        pose: &Transform,
    ) -> impl Iterator<Item = &'a LocalScoredPose> + use<'a> {
        let is_apart = self.is_apart_from(pose, MAX_REFINE_SHIFT);
        alternatives.iter().filter(move |other| is_apart(other))
    }

    /// Estimates the covariance of `pose`, if the pose is correct.
    pub(super) fn covariance(&self, pose: &Transform) -> Option<PoseCovariance> {
        let surfaces = self.trials[self.best_trial].surface_refs();
        let max_distance = INLIER_DISTANCE * self.voxel_size;
        let pairs = |pose: &Transform, max_points: usize| -> Vec<SurfacePair> {
            let stride = surfaces[0].len().div_ceil(max_points).max(1);
            surface_pairs(surfaces, pose, max_distance, stride).map(|(.., pair)| pair).collect()
        };
        PoseCovariance::estimate(pairs, pose, surfaces[1].origin, self.voxel_size)
    }

    /// Returns the most probable of the poses of the search and the `alternatives` that differs from
    /// `pose`, assumed to be as well constrained. Alternatives were not searched for by
    /// correspondences: as many hypotheses are assumed to support them as the pose.
    fn find_runner_up(
        &self,
        pose: &Transform,
        confidence: &Confidence,
        alternatives: &[LocalScoredPose],
    ) -> Option<RunnerUp> {
        let model = self.config.verdict_model();
        let [from, onto] = &self.trials[self.best_trial].surfaces;
        let found = self.other_poses(pose).map(|other| (other, None));
        let proposed = self.rivals(alternatives, pose);
        let proposed = proposed.map(|other| (other, Some(confidence.supporting_hypotheses)));
        let most_probable =
            found.chain(proposed).max_by(|(a, _), (b, _)| a.log_odds.total_cmp(&b.log_odds));
        most_probable.map(|(other, assumed)| {
            let ranked = self.config.pose_log_odds(&confidence.evidence);
            let confidence = Confidence {
                evidence: other.evidence,
                supporting_hypotheses: assumed
                    .unwrap_or_else(|| self.count_supporting_hypotheses(&other.pose)),
                margin: Some(other.log_odds - ranked),
                ..*confidence
            };
            RunnerUp {
                transform: to_cloud_frames(&other.pose, from, onto),
                probability: model.probability(&confidence),
            }
        })
    }
}
