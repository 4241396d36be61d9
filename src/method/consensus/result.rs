//! The best pose, with its verdict.

use super::ConsensusSearch;
use super::scan::Scan;
use crate::error::Result;
use crate::method::registration::{CloudCounts, PointCounts, Timings};
use crate::method::{MethodRecord, Registration, SolvedPose, StopReason};
use crate::pose::{self, ScaleEstimate, Solver};
use crate::surface::{Surface, to_cloud_frames};
use crate::verify::FitnessRule;

impl ConsensusSearch<'_> {
    /// Returns the registration by the best pose, with its verdict; seconds are added to `times`.
    pub(in crate::method) fn to_registration(&self, mut times: Timings) -> Result<Registration> {
        let best = &self.trials[self.best_trial];
        let (settled, [from, onto]) = (self.refined, &best.surfaces);
        let covariance = times.time("covariance", || self.covariance(&settled.pose));
        let verdict =
            times.time("verify", || self.build_verdict(&self.best, &self.alternatives, covariance));
        let counts = |scan: &Scan<'_>, surface: &Surface| CloudCounts {
            dropped: scan.filtered_cloud().cloud().dropped(),
            no_returns: scan.filtered_cloud().cloud().no_returns(),
            used: scan.filtered_cloud().cloud().len(),
            keypoints: None,
            described: surface.len(),
            neighbors: Some(scan.descriptor_neighbors()),
            oriented_by: Some(surface.oriented_by),
        };
        let [source, target] = &self.scans;
        let solution = pose::solve(&settled.moments, Solver::Arun, ScaleEstimate::Fixed);
        let solved = SolvedPose {
            transform: to_cloud_frames(&settled.pose, from, onto),
            moments: Some(settled.moments),
            singular_values: Some(solution.map_or([0.0; 3], |solution| solution.singular_values)),
            connections: from.len() as u64 * onto.len() as u64,
            iterations: settled.iterations,
            stop: StopReason::PoseSettled,
            trace: Vec::new(),
            points: Some(PointCounts {
                source: counts(source, from),
                target: counts(target, onto),
            }),
            time_s: times,
            warnings: Vec::new(),
            method: MethodRecord::new("consensus", &self.config)
                .with_given_correspondences(self.given.map(<[_]>::len)),
            fitness: FitnessRule::NONE,
        };
        let [source, target] = self.clouds();
        let concluded = solved.finish_cached(source, target)?;
        Ok(concluded.with_search_verdict(verdict, self.config.distinguishes_rotations()))
    }
}
