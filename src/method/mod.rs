//! Registration methods: weights on the full connection, one closed-form solve.
//!
//! Every registration method implements [`Register`]; methods that start from a pose implement
//! [`Refine`] too; named methods are in the catalogue [`Method`]. The result is a [`Registration`].
//! For clouds of many pairs a [`Cache`] keeps values computed from one cloud alone.

mod bounded_icp;
mod cache;
mod catalogue;
mod cf;
mod cf_spectral;
mod cfk;
mod channels;
mod clean;
mod compatibility_graph;
mod consensus;
mod cpd;
mod dare;
mod features;
mod given_descriptors;
mod icp;
mod iterate;
mod kernel_correlation;
mod pipeline;
mod position_problem;
mod record;
mod registration;
mod settings;
mod solved_pose;
mod teaser;
mod termination;
mod viewpoint_choice;
mod weight_graph;
mod weight_links;

pub use cache::{Cache, Cached};
pub use catalogue::Method;
pub use cf::Cf;
pub use cf_spectral::CfSpectral;
pub use cfk::Cfk;
pub use channels::Channel;
pub use consensus::{Consensus, ScoredPose};
pub use cpd::Cpd;
pub use dare::Dare;
pub use features::{DescriptorScale, FeatureCloud, FeatureConfig};
pub use given_descriptors::{DescriptorDistance, DescriptorRole, GivenDescriptors};
pub use icp::{Icp, Metric};
pub use kernel_correlation::KernelCorrelation;
pub use pipeline::Pipeline;
pub use record::MethodRecord;
pub use registration::{Certificate, CloudCounts, PointCounts, Registration, Timings};
pub use solved_pose::SolvedPose;
pub use teaser::Teaser;
pub use termination::{IterationRecord, StopReason};
pub use weight_links::{WeightBlock, WeightGraph, WeightedLink};

use crate::cloud::{PointCloud, Transform};
use crate::error::Result;

/// A method that finds the pose of one cloud in another.
///
/// Object safe, so that batches and pipelines take any method, also yours.
pub trait Register: Send + Sync {
    /// Returns the pose that maps `source` into the frame of `target`.
    ///
    /// # Errors
    /// When no pose can be computed; a pose that cannot be trusted is `Ok` with its warnings,
    /// [`doubts`](Registration::doubts).
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration>;

    /// Registers as [`register`](Self::register), with the same bits, for clouds of many pairs:
    /// values that depend on one cloud alone are computed once and cached. Methods without cached
    /// values need no implementation of their own.
    ///
    /// ```
    /// use cfreg::method::{Cache, Cached, Cf, Register};
    /// # use cfreg::cloud::shape::boulder;
    /// let map = boulder().sample(400, 0)?;
    /// let cache = Cache::default();
    /// let target = Cached { cloud: &map, cache: Some(&cache) };
    /// for seed in 1..3 {
    ///     let scan = boulder().sample(400, seed)?;
    ///     let found = Cf::default().register_cached((&scan).into(), target)?;
    ///     assert_eq!(found.transform, Cf::default().register(&scan, &map)?.transform);
    /// }
    /// assert!(cache.bytes() > 400 * 33 * 4);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`register`](Self::register).
    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        self.register(source.cloud, target.cloud)
    }
}

/// A method that improves a pose: it computes weights by position under the current pose and
/// solves, repeatedly. It also implements [`Register`], from the identity.
pub trait Refine: Send + Sync {
    /// Returns the pose that maps `source` into the frame of `target`, from the initial pose
    /// `initial`.
    ///
    /// # Errors
    /// As [`Register::register`].
    fn refine(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        initial: &Transform,
    ) -> Result<Registration>;

    /// Refines with caches for clouds of many pairs, as [`Register::register_cached`].
    ///
    /// # Errors
    /// As [`refine`](Self::refine).
    fn refine_cached(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        initial: &Transform,
    ) -> Result<Registration> {
        self.refine(source.cloud, target.cloud, initial)
    }
}

impl<R: Refine> Register for R {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.refine(source, target, &Transform::IDENTITY)
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        self.refine_cached(source, target, &Transform::IDENTITY)
    }
}
