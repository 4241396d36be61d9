//! The correspondences, and their inlier weights under a pose.

use super::{Consensus, ConsensusSearch};
use crate::cloud::Transform;
use crate::error::Result;
use crate::method::Cached;
use crate::method::WeightGraph;
use crate::method::registration::Timings;
use crate::par;
use crate::surface::to_local_frames;

impl Consensus {
    /// Returns the correspondences of the viewpoint trial with the best pose, of a new search.
    pub(in crate::method) fn weight_graph(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        pose: &Transform,
    ) -> Result<WeightGraph> {
        par::with_threads(self.threads, || {
            self.search(source, target, None, &mut Timings::default())?.weight_graph(pose)
        })?
    }
}

impl ConsensusSearch<'_> {
    /// Returns the correspondences of the viewpoint trial with the best pose.
    pub(in crate::method) fn weight_graph(&self, pose: &Transform) -> Result<WeightGraph> {
        let trial = &self.trials[self.best_trial];
        let [from, onto] = trial.surface_refs();
        let ends = [from, onto].map(|side| side.feature_view(side.matching_descriptors()));
        let local = to_local_frames(pose, from, onto);
        WeightGraph::from_correspondences(
            ends,
            &trial.correspondences.pairs,
            trial.correspondences.inlier_weights(&local),
            trial.correspondences.inlier_distance(),
            pose,
        )
    }
}
