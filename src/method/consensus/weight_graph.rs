//! The correspondences, and their inlier weights under a pose.

use super::Consensus;
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::method::registration::Timings;
use crate::method::weight_graph::WeightGraph;
use crate::par;
use crate::surface::to_local_frames;

impl Consensus {
    /// Returns the correspondences of the viewpoint trial with the best pose.
    pub(in crate::method) fn weight_graph(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pose: &Transform,
    ) -> Result<WeightGraph> {
        par::with_threads(self.threads, || {
            let search =
                self.search(source.into(), target.into(), None, &mut Timings::default())?;
            let attempt = &search.trials[search.best_trial];
            let [from, onto] = &attempt.surfaces;
            let ends = [from, onto].map(|side| side.feature_view(side.matching_descriptors()));
            let seen = to_local_frames(pose, from, onto);
            let agreement = attempt.correspondences.inlier_weights(&seen);
            let reach = attempt.correspondences.inlier_distance();
            WeightGraph::from_correspondences(
                ends,
                &attempt.correspondences.pairs,
                agreement,
                reach,
                pose,
            )
        })?
    }
}
