//! The verdict on a pose, whoever found it, beside all poses that were tried.

use super::evidence::Evidence;
use super::scan::REACH;
use super::settle::settle;
use super::standing::Standing;
use super::{
    ANSWER, Candidate, Consensus, LOOK, NEAR, OTHER, Search, apart, corners, global, local,
};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::method::Cached;
use crate::method::registration::Timings;
use crate::par;
use crate::quality::{Decision, PoseCovariance, RunnerUp, Verdict};

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
    /// use cfreg::quality::Decision;
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
    pub fn judge(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pose: &Transform,
    ) -> Result<Verdict> {
        self.judge_cached(source.into(), target.into(), pose)
    }

    /// The same of clouds of many pairs.
    pub(in crate::method) fn judge_cached(
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
            let search = self.search_whole(source, target, times)?;
            Ok::<_, Error>(search.without_carriers(&rigid, times).verify(&rigid))
        })??;
        if let Some(other) = &mut verdict.runner_up {
            other.transform.scale = pose.scale;
        }
        Ok(verdict)
    }
}

impl Search<'_> {
    /// The verdict on a pose between the clouds' own frames.
    pub(in crate::method) fn verify(&self, pose: &Transform) -> Verdict {
        let best = &self.attempts[self.best];
        let (ends, matches) = (best.ends(), &best.matches);
        let corners = corners(ends[0]);
        let pose = local(pose, ends[0], ends[1]);
        let settled = settle(ends, &pose, REACH * self.length, ANSWER, &self.config.prior).pose;
        let away = apart(&settled, &pose, &corners);
        let held = if away <= NEAR * self.length { settled } else { pose };
        let evidence = Evidence::of(ends, matches, &held, LOOK.most);
        let mut verdict = self.verdict(&held, evidence, self.covariance(&held));
        let degrees = settled.after(&pose.inverse()).angle().to_degrees();
        verdict.reasons.push(format!(
            "the surfaces settle {degrees:.2} degrees away, {away:.3e} in the mean of their points"
        ));
        verdict
    }

    /// On a pose between the local frames, for which `evidence` speaks.
    pub(super) fn verdict(
        &self,
        pose: &Transform,
        evidence: Evidence,
        covariance: Option<PoseCovariance>,
    ) -> Verdict {
        let standing = self.standing(pose, evidence, covariance.as_ref());
        let mut reasons = vec![
            format!(
                "{:.0} % of a surface lies on the other and faces alike",
                100.0 * evidence.overlap
            ),
            format!("surfaces that lie on each other look alike by {:.2} nats", evidence.likeness),
            format!("{:.1} matches agree", evidence.support),
            format!("{} of the poses that were settled are this one", standing.votes),
        ];
        if let Some(share) = evidence.contradicted {
            let percent = 100.0 * share;
            reasons.push(format!("{percent:.1} % stand where a sensor looked through"));
        }
        if let Some(loose) = covariance.as_ref().map(|it| it.undetermined.len()).filter(|&n| n > 0)
        {
            reasons.push(format!("nothing holds the pose along {loose} of 6 motions"));
        }
        for (scan, name) in self.scans.iter().zip(["source", "target"]) {
            if let Some(limit) = scan.whole().limit() {
                let (points, range) = (limit.points, limit.range);
                let rest = "at the limit of its sensor's range, are left out (range_limit=false \
                            keeps them)";
                reasons.push(format!("{points} points of the {name} {range:.1} away, {rest}"));
            }
            if scan.whole().nearest() > 0.0 {
                let nearest = scan.whole().nearest();
                reasons.push(format!(
                    "what of the {name} is within {nearest:.3e} of its sensor, and may travel \
                     with it, is left out: sensor lies on sensor"
                ));
            }
        }
        let runner_up = self.runner_up(pose, &standing);
        let told = standing.probability();
        let verdict = Verdict::new(told, evidence.overlap, reasons, runner_up, covariance);
        if verdict.decision == Decision::Accept
            && let Some(other) = self.other_scale(pose, &evidence)
        {
            return verdict.of_two_scales(other.scale, other.overlap);
        }
        verdict
    }

    /// The most probable pose that is another than `pose`, of all that was tried; held as
    /// well as that is.
    fn runner_up(&self, pose: &Transform, standing: &Standing) -> Option<RunnerUp> {
        let [from, onto] = &self.attempts[self.best].surfaces;
        let corners = corners(from);
        let answer = Candidate { pose: self.settled.pose, evidence: self.evidence };
        let all = self.attempts.iter().flat_map(|attempt| &attempt.candidates);
        all.chain([&answer])
            .filter(|other| apart(&other.pose, pose, &corners) > OTHER * self.length)
            .max_by(|a, b| a.evidence.log_odds().total_cmp(&b.evidence.log_odds()))
            .map(|other| {
                let votes = self.votes(&other.pose);
                let standing = Standing { evidence: other.evidence, votes, ..*standing };
                RunnerUp {
                    transform: global(&other.pose, from, onto),
                    probability: standing.probability(),
                }
            })
    }
}
