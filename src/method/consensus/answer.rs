//! What came out best, with the verdict on it.

use super::scan::{Scan, Surface};
use super::standing::Standing;
use super::{OTHER, Search, apart, corners, global};
use crate::error::Result;
use crate::method::registration::{Counts, Found, PointCounts, Timings};
use crate::method::{Method, Registration, StopReason};
use crate::pose::{self, ScaleEstimate, Solver};
use crate::quality::{Doubt, PoseCovariance, RunnerUp, Verdict};

impl Search<'_> {
    pub(super) fn answer(self, mut times: Timings) -> Result<Registration> {
        let best = &self.attempts[self.best];
        let (settled, [from, onto]) = (self.settled, &best.surfaces);
        let covariance = times.time("covariance", || self.covariance());
        let standing = self.standing(covariance.as_ref());
        let mut verdict = verdict(&standing, self.runner_up(&standing), covariance);
        for (scan, name) in self.scans.iter().zip(["source", "target"]) {
            if let Some(limit) = scan.limit() {
                let (points, range) = (limit.points, limit.range);
                let rest = "at the limit of its sensor's range, are left out";
                verdict
                    .reasons
                    .push(format!("{points} points of the {name} {range:.1} away, {rest}"));
            }
        }
        let counts = |scan: &Scan<'_>, surface: &Surface| Counts {
            dropped: scan.whole().dropped(),
            used: scan.whole().len(),
            keypoints: None,
            described: surface.len(),
            neighbors: Some(scan.neighbors()),
            oriented_by: Some(surface.oriented_by),
        };
        let [source, target] = &self.scans;
        let solution = pose::solve(&settled.moments, Solver::Arun, ScaleEstimate::Fixed);
        let found = Found {
            transform: global(&settled.pose, from, onto),
            moments: settled.moments,
            singular_values: solution.map_or([0.0; 3], |solution| solution.singular_values),
            connections: from.len() as u64 * onto.len() as u64,
            iterations: settled.steps,
            stop: StopReason::PoseSettled,
            trace: Vec::new(),
            points: PointCounts { source: counts(source, from), target: counts(target, onto) },
            times,
            doubts: Doubt::of_verdict(&verdict),
            config: Method::Consensus(self.config),
        };
        let concluded = Registration::conclude(found, source.whole(), target.whole())?;
        Ok(Registration { verdict: Some(verdict), ..concluded })
    }
}

impl Search<'_> {
    /// The most probable pose that is another than the answer, of all that was tried; held as
    /// well as that is.
    fn runner_up(&self, answer: &Standing) -> Option<RunnerUp> {
        let [from, onto] = &self.attempts[self.best].surfaces;
        let corners = corners(from);
        let others = self.attempts.iter().flat_map(|attempt| &attempt.candidates);
        others
            .filter(|other| apart(&other.pose, &self.settled.pose, &corners) > OTHER * self.length)
            .max_by(|a, b| a.evidence.log_odds().total_cmp(&b.evidence.log_odds()))
            .map(|other| {
                let votes = self.votes(&other.pose);
                let standing = Standing { evidence: other.evidence, votes, ..*answer };
                RunnerUp {
                    transform: global(&other.pose, from, onto),
                    probability: standing.probability(),
                }
            })
    }
}

fn verdict(
    standing: &Standing,
    runner_up: Option<RunnerUp>,
    covariance: Option<PoseCovariance>,
) -> Verdict {
    let evidence = &standing.evidence;
    let mut reasons = vec![
        format!("{:.0} % of a surface lies on the other and faces alike", 100.0 * evidence.overlap),
        format!("surfaces that lie on each other look alike by {:.2} nats", evidence.likeness),
        format!("{:.1} matches agree", evidence.support),
        format!("{} of the poses that were settled are this one", standing.votes),
    ];
    if let Some(share) = evidence.contradicted {
        let percent = 100.0 * share;
        reasons.push(format!("{percent:.1} % stand where a sensor looked through"));
    }
    if let Some(loose) = covariance.as_ref().map(|it| it.undetermined.len()).filter(|&n| n > 0) {
        reasons.push(format!("nothing holds the pose along {loose} of 6 motions"));
    }
    Verdict::new(standing.probability(), evidence.overlap, reasons, runner_up, covariance)
}
