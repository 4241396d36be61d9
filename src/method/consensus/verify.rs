//! The verdict on a pose, whoever found it, beside all poses that were tried.

use super::confidence::Confidence;
use super::evidence::PoseEvidence;
use super::refine::refine;
use super::scan::INLIER_DISTANCE;
use super::{
    COARSE_REFINEMENT, Consensus, ConsensusSearch, DISTINCT_POSE, FINE_REFINEMENT, LocalScoredPose,
    MAX_REFINE_SHIFT, mean_displacement, probe_points, to_cloud_frames, to_local_frames,
};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::method::Cached;
use crate::method::registration::Timings;
use crate::par;
use crate::verify::{Decision, PoseCovariance, RunnerUp, Verdict};

impl Consensus {
    /// The verdict on a `pose` that another method or program found: what a search of this
    /// method's own says of it, and which other pose is more probable, if one is.
    ///
    /// A pose is as good as the one that it settles on, if that is the same to within a
    /// [length](Self::voxel); the reasons say how far away that is. Where it has a scale other
    /// than 1, the source is scaled first. Clouds that differ in scale by some percent have a pose
    /// on which much of them lies on each other: that is ambiguous, and the reasons name the scale.
    ///
    /// # Errors
    /// Those of [`register`](crate::method::Register::register).
    ///
    /// ```
    /// use cfreg::method::Consensus;
    /// use cfreg::verify::Decision;
    /// # use cfreg::experiment::shape::boulder;
    /// # use cfreg::Transform;
    /// # let (source, target) = (boulder().sample(2000, 1)?, boulder().sample(2000, 2)?);
    /// let wrong = Transform::from_rotation_vector([0.0, 0.0, 1.0]);
    /// let [right, wrong] = [Transform::IDENTITY, wrong]
    ///     .map(|pose| Consensus::default().judge(&source, &target, &pose));
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

    /// The same of clouds of many pairs.
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
            let search = self.filter_and_search(source, target, times)?;
            Ok::<_, Error>(search.remove_ego_vehicle(&rigid, times).verify(&rigid))
        })??;
        if let Some(other) = &mut verdict.runner_up {
            other.transform.scale = pose.scale;
        }
        Ok(verdict)
    }
}

impl ConsensusSearch<'_> {
    /// The verdict on a pose between the clouds' own frames.
    pub(in crate::method) fn verify(&self, pose: &Transform) -> Verdict {
        let best = &self.trials[self.best_trial];
        let (ends, matches) = (best.surface_refs(), &best.correspondences);
        let corners = probe_points(ends[0]);
        let pose = to_local_frames(pose, ends[0], ends[1]);
        let settled = refine(
            ends,
            &pose,
            INLIER_DISTANCE * self.voxel_size,
            FINE_REFINEMENT,
            &self.config.prior,
        )
        .pose;
        let away = mean_displacement(&settled, &pose, &corners);
        let held = if away <= MAX_REFINE_SHIFT * self.voxel_size { settled } else { pose };
        let evidence = PoseEvidence::compute(ends, matches, &held, COARSE_REFINEMENT.max_points);
        let mut verdict = self.build_verdict(&held, evidence, self.covariance(&held));
        let degrees = settled.after(&pose.inverse()).angle().to_degrees();
        verdict.reasons.push(format!(
            "the surfaces settle {degrees:.2} degrees away, {away:.3e} in the mean of their points"
        ));
        verdict
    }

    /// On a pose between the local frames, for which `evidence` speaks.
    pub(super) fn build_verdict(
        &self,
        pose: &Transform,
        evidence: PoseEvidence,
        covariance: Option<PoseCovariance>,
    ) -> Verdict {
        let standing = self.compute_confidence(pose, evidence, covariance.as_ref());
        let mut reasons = vec![
            format!(
                "{:.0} % of a surface lies on the other and faces alike",
                100.0 * evidence.overlap
            ),
            format!(
                "surfaces that lie on each other look alike by {:.2} nats",
                evidence.descriptor_distinctiveness
            ),
            format!("{:.1} matches agree", evidence.inlier_score),
            format!(
                "{} of the poses that were settled are this one",
                standing.supporting_hypotheses
            ),
        ];
        if let Some(share) = evidence.free_space_violation {
            let percent = 100.0 * share;
            reasons.push(format!("{percent:.1} % stand where a sensor looked through"));
        }
        if let Some(loose) = covariance.as_ref().map(|it| it.unobservable.len()).filter(|&n| n > 0)
        {
            reasons.push(format!("nothing holds the pose along {loose} of 6 motions"));
        }
        for (scan, name) in self.scans.iter().zip(["source", "target"]) {
            if let Some(limit) = scan.filtered_cloud().range_limit() {
                let (points, range) = (limit.points, limit.range);
                let rest = "at the limit of its sensor's range, are left out (range_limit=false \
                            keeps them)";
                reasons.push(format!("{points} points of the {name} {range:.1} away, {rest}"));
            }
            if scan.filtered_cloud().min_range() > 0.0 {
                let nearest = scan.filtered_cloud().min_range();
                reasons.push(format!(
                    "what of the {name} is within {nearest:.3e} of its sensor, and may travel \
                     with it, is left out: sensor lies on sensor"
                ));
            }
        }
        let runner_up = self.find_runner_up(pose, &standing);
        let told = standing.probability();
        let verdict = Verdict::new(told, evidence.overlap, reasons, runner_up, covariance);
        if verdict.decision == Decision::Accept
            && let Some(other) = self.find_scale_mismatch(pose, &evidence)
        {
            return verdict.with_scale_mismatch(other.scale, other.overlap);
        }
        verdict
    }

    /// The most probable pose that is another than `pose`, of all that was tried; held as
    /// well as that is.
    fn find_runner_up(&self, pose: &Transform, standing: &Confidence) -> Option<RunnerUp> {
        let [from, onto] = &self.trials[self.best_trial].surfaces;
        let corners = probe_points(from);
        let answer = LocalScoredPose { pose: self.refined.pose, evidence: self.evidence };
        let all = self.trials.iter().flat_map(|attempt| &attempt.candidates);
        all.chain([&answer])
            .filter(|other| {
                mean_displacement(&other.pose, pose, &corners) > DISTINCT_POSE * self.voxel_size
            })
            .max_by(|a, b| a.evidence.log_odds().total_cmp(&b.evidence.log_odds()))
            .map(|other| {
                let votes = self.count_supporting_hypotheses(&other.pose);
                let standing = Confidence {
                    evidence: other.evidence,
                    supporting_hypotheses: votes,
                    ..*standing
                };
                RunnerUp {
                    transform: to_cloud_frames(&other.pose, from, onto),
                    probability: standing.probability(),
                }
            })
    }
}
