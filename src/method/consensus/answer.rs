//! What came out best, with the verdict on it.

use super::evidence::{Evidence, REACH};
use super::scan::{Scan, Surface};
use super::settle::covariance;
use super::{Attempt, OTHER, Search, apart, corners, global};
use crate::cloud::Transform;
use crate::error::Result;
use crate::method::registration::{Counts, Found, PointCounts, Timings};
use crate::method::{Method, Registration, StopReason};
use crate::pose::{self, ScaleEstimate, Solver};
use crate::quality::{Doubt, PoseCovariance, RunnerUp, Verdict};

impl Search<'_> {
    pub(super) fn answer(self, mut times: Timings) -> Result<Registration> {
        let best = &self.attempts[self.best];
        let (settled, [from, onto]) = (self.settled, &best.surfaces);
        let runner_up = runner_up(&self.attempts, &best.surfaces, &settled.pose, self.length);
        let reach = REACH * self.length;
        let covariance = times
            .time("covariance", || covariance([from, onto], &settled.pose, reach, self.length));
        let verdict = verdict(&self.evidence, runner_up, covariance);
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
            doubts: Doubt::of_verdict(&verdict).into_iter().collect(),
            config: Method::Consensus(self.config),
        };
        let concluded = Registration::conclude(found, source.whole(), target.whole())?;
        Ok(Registration { verdict: Some(verdict), ..concluded })
    }
}

/// The most probable pose that is another than `pose`, of all attempts.
fn runner_up(
    attempts: &[Attempt],
    [from, onto]: &[Surface; 2],
    pose: &Transform,
    length: f64,
) -> Option<RunnerUp> {
    let corners = corners(from);
    let others = attempts.iter().flat_map(|attempt| &attempt.candidates);
    others
        .filter(|other| apart(&other.pose, pose, &corners) > OTHER * length)
        .max_by(|a, b| a.evidence.log_odds().total_cmp(&b.evidence.log_odds()))
        .map(|other| RunnerUp {
            transform: global(&other.pose, from, onto),
            probability: probability(&other.evidence),
        })
}

fn probability(evidence: &Evidence) -> f64 {
    // Nothing is certain: odds stay finite.
    1.0 / (1.0 + (-evidence.log_odds().clamp(-30.0, 30.0)).exp())
}

fn verdict(
    evidence: &Evidence,
    runner_up: Option<RunnerUp>,
    covariance: Option<PoseCovariance>,
) -> Verdict {
    let mut reasons = vec![
        format!("{:.0} % of a surface lies on the other and faces alike", 100.0 * evidence.overlap),
        format!("surfaces that lie on each other look alike by {:.2} nats", evidence.likeness),
        format!("{:.1} matches agree", evidence.support),
    ];
    if let Some(share) = evidence.contradicted {
        let percent = 100.0 * share;
        reasons.push(format!("{percent:.1} % stand where a sensor looked through"));
    }
    if let Some(loose) = covariance.as_ref().map(|it| it.undetermined.len()).filter(|&n| n > 0) {
        reasons.push(format!("nothing holds the pose along {loose} of 6 motions"));
    }
    Verdict::new(probability(evidence), evidence.overlap, reasons, runner_up, covariance)
}
