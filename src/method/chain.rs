//! A method, and refinements that start from its pose.

use serde::Serialize;

use super::{Cached, Icp, Method, Register, Registration};
use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::quality::Doubt;

/// A method followed by refinements, each from the pose of the one before: what
/// `--method cf --refine icp,gicp` is.
///
/// After [`Consensus`](super::Consensus) pairs of ICP are at most two of its lengths long, unless
/// they are told otherwise. The answer is the last registration; the ones before are in its
/// [`refined_from`](Registration::refined_from), their times in front of its own.
///
/// ```
/// use cfreg::method::{Chain, Register};
/// # use cfreg::experiment::shape::boulder;
/// # let (source, target) = (boulder().sample(400, 1)?, boulder().sample(400, 2)?);
/// let chain = Chain::new("cf".parse()?, vec!["icp".parse()?])?;
/// let refined = chain.register(&source, &target)?;
/// assert_eq!((refined.method, refined.refined_from.unwrap().method), ("icp", "cf"));
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Chain {
    first: Method,
    refinements: Vec<Method>,
}

/// Most refinements: each carries the answers before it.
const MOST_REFINEMENTS: usize = 32;

impl Chain {
    /// `first`, then each of `refinements`.
    ///
    /// # Errors
    /// [`Error::Config`] for a refinement that cannot start from a pose, and for more than 32.
    pub fn new(first: Method, refinements: Vec<Method>) -> Result<Self> {
        let count = refinements.len();
        if count > MOST_REFINEMENTS {
            let rule = format!("refinements: at most {MOST_REFINEMENTS} may follow each other");
            return Err(Error::config("refine", count, rule));
        }
        match refinements.iter().find(|method| method.as_refinement().is_none()) {
            Some(method) => {
                let rule =
                    "does not start from a pose: refine by icp, plane-icp, gicp, kc, cpd or dare";
                Err(Error::config("refine", method.name(), rule))
            }
            None => Ok(Chain { first, refinements }),
        }
    }
}

/// Longest pairs of ICP after [`Consensus`], in its lengths.
///
/// [`Consensus`]: super::Consensus
const BOUND: f64 = 2.0;

/// The refinement, its pairs bounded where nothing else was said and the clouds that `found`
/// registers overlap in part, as after consensus: pairs of any length would draw them together.
fn bounded(method: &Method, found: &Registration) -> Method {
    match (method, &found.config) {
        (Method::Icp(icp), Method::Consensus(consensus)) if icp.max_distance.is_none() => {
            let max_distance = consensus.voxel.map(|length| BOUND * length);
            Method::Icp(Icp { max_distance, ..icp.clone() })
        }
        _ => method.clone(),
    }
}

impl Register for Chain {
    /// A refinement that finds nothing to hold on to leaves the pose before it as the
    /// answer, with [`Doubt::NotRefined`].
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        self.refined(self.first.register_cached(source, target)?, source, target)
    }
}

impl Chain {
    /// The refinements alone, from an answer that was found otherwise; see
    /// [`register`](Register::register).
    ///
    /// # Errors
    /// Those of [`Refine::refine`](super::Refine::refine).
    pub fn go_on(
        &self,
        begun: Registration,
        source: &PointCloud,
        target: &PointCloud,
    ) -> Result<Registration> {
        self.refined(begun, source.into(), target.into())
    }

    fn refined(
        &self,
        begun: Registration,
        source: Cached<'_>,
        target: Cached<'_>,
    ) -> Result<Registration> {
        let mut found = begun;
        for method in &self.refinements {
            let method = bounded(method, &found);
            let Some(refinement) = method.as_refinement() else { continue };
            match refinement.refine_cached(source, target, &found.transform) {
                Ok(mut refined) => {
                    let own = std::mem::take(&mut refined.time_s);
                    refined.time_s = found.time_s.clone();
                    own.0.iter().for_each(|&(stage, seconds)| refined.time_s.add(stage, seconds));
                    refined = refined.keep_verdict(&found, source.cloud);
                    refined.refined_from = Some(Box::new(found));
                    found = refined;
                }
                Err(Error::NoWeight { .. } | Error::Degenerate { .. }) => {
                    found.doubts.push(Doubt::NotRefined);
                    found.trusted = false;
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(found)
    }
}
