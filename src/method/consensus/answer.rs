//! What came out best, with the verdict on it.

use super::scan::{Scan, Surface};
use super::{Search, global};
use crate::error::Result;
use crate::method::registration::{Counts, Found, PointCounts, Timings};
use crate::method::{Method, Registration, StopReason};
use crate::pose::{self, ScaleEstimate, Solver};

impl Search<'_> {
    /// The registration by the best pose, with its verdict; seconds are added to `times`.
    pub(in crate::method) fn registration(&self, mut times: Timings) -> Result<Registration> {
        let best = &self.attempts[self.best];
        let (settled, [from, onto]) = (self.settled, &best.surfaces);
        let covariance = times.time("covariance", || self.covariance(&settled.pose));
        let verdict = self.verdict(&settled.pose, self.evidence, covariance);
        let counts = |scan: &Scan<'_>, surface: &Surface| Counts {
            dropped: scan.whole().cloud().dropped(),
            no_returns: scan.whole().cloud().no_returns(),
            used: scan.whole().cloud().len(),
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
            doubts: Vec::new(),
            config: Method::Consensus(self.config.clone()),
        };
        let [source, target] = self.clouds();
        let concluded = Registration::conclude(found, source, target)?;
        Ok(concluded.verified_by(verdict, &self.config))
    }
}
