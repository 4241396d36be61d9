//! The matches, and how they agree with a pose.

use super::{Consensus, local};
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::method::connections::Connections;
use crate::method::registration::Timings;
use crate::par;

impl Consensus {
    /// The matches of the view of both clouds that the answer is from.
    pub(in crate::method) fn connections(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pose: &Transform,
    ) -> Result<Connections> {
        par::with_threads(self.threads, || {
            let search = self.search(source.into(), target.into(), &mut Timings::default())?;
            let attempt = &search.attempts[search.best];
            let [from, onto] = &attempt.surfaces;
            let ends = [from.described(), onto.described()];
            let seen = local(pose, from, onto);
            let agreement = attempt.matches.agreement(&seen);
            let reach = attempt.matches.reach();
            Connections::of_matches(ends, &attempt.matches.pairs, agreement, reach, pose)
        })?
    }
}
