//! A method, and refinements that start from its pose.

use serde::Serialize;

use super::clean::CleanCloud;
use super::consensus::PointPair;
use super::registration::Timings;
use super::{
    Cache, Cached, Consensus, Icp, Method, Register, Registration, WeightGraph, bounded_icp,
};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::par;
use crate::verify::{Decision, VerdictModel, Warning};

/// A method followed by refinements, each from the pose of the previous one: the pipeline of
/// `--method cf --refine icp,gicp`.
///
/// Rows that mark missing returns ([`filter::find_no_returns`](crate::filter::find_no_returns)) are
/// left out, and rows that share a position are one point. Refinements after
/// [`Consensus`](super::Consensus) leave out the same points as its search, and their ICP pairs are
/// at most two of its voxel sizes long, unless set otherwise. If the first method has a verdict,
/// the returned pose has its own verdict; poses of other methods get one by
/// [`with_verification`](Self::with_verification).
///
/// The result is the last registration; the previous ones are in its
/// [`refined_from`](Registration::refined_from), their times before its own.
///
/// ```
/// use cfreg::method::{Pipeline, Register};
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(400, 1)?, boulder().sample(400, 2)?);
/// let chain = Pipeline::new("cf".parse()?, vec!["icp".parse()?])?;
/// let refined = chain.register(&source, &target)?;
/// assert_eq!(refined.method.name, "icp");
/// assert_eq!(refined.refined_from.unwrap().method.name, "cf");
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pipeline {
    first: Method,
    refinements: Vec<Method>,
    initial: Option<Transform>,
    verdict: Option<Consensus>,
    keep_no_returns: bool,
    /// Whether results hold their weights.
    #[serde(skip)]
    weights: bool,
}

/// Most refinements: each result contains the previous ones. Chosen by hand.
const MAX_REFINEMENTS: usize = 32;

impl Pipeline {
    /// Builds a pipeline of `first`, then each of `refinements`.
    ///
    /// # Errors
    /// [`Error::Config`] for a refinement that cannot start from a pose, and for more than 32.
    pub fn new(first: Method, refinements: Vec<Method>) -> Result<Self> {
        let count = refinements.len();
        if count > MAX_REFINEMENTS {
            let rule = format!("refinements: at most {MAX_REFINEMENTS} may follow each other");
            return Err(Error::config("refine", count, rule));
        }
        match refinements.iter().find(|method| method.as_refinement().is_none()) {
            Some(method) => {
                let rule =
                    "does not start from a pose: refine by icp, plane-icp, gicp, kc, cpd or dare";
                Err(Error::config("refine", method.name(), rule))
            }
            None => {
                let (initial, verdict) = (None, None);
                Ok(Pipeline {
                    first,
                    refinements,
                    initial,
                    verdict,
                    keep_no_returns: false,
                    weights: false,
                })
            }
        }
    }

    /// Starts from this pose of the source in the target's frame, not from the identity. ICP
    /// without a `max_distance` then limits its pairs to the expected error of the pose; the limit
    /// shrinks to two voxels of 5000 points, so that clouds that overlap in part are not drawn
    /// together.
    ///
    /// # Errors
    /// [`Error::Config`] for a first method that does not start from a pose.
    pub fn with_initial(self, initial: Transform) -> Result<Self> {
        match self.first.as_refinement() {
            Some(_) => Ok(Pipeline { initial: Some(initial), ..self }),
            None => {
                let rule = "starts from no pose: leave it out";
                Err(Error::config("initial", self.first.name(), rule))
            }
        }
    }

    /// Verifies poses of methods without a verdict by a search with these settings
    /// ([`Consensus::verify`]). If the clouds are too small for a verdict, the result has a
    /// warning.
    pub fn with_verification(self, judge: Consensus) -> Self {
        Pipeline { verdict: Some(judge), ..self }
    }

    /// Ranks and verifies poses by this model instead of the built-in one.
    pub fn with_verdict_model(mut self, model: &VerdictModel) -> Self {
        if let Method::Consensus(consensus) = &mut self.first {
            consensus.model = Some(model.clone().into());
        }
        self.verdict = self.verdict.map(|verifier| verifier.model(model.clone()));
        self
    }

    /// Keeps rows that mark missing returns.
    pub fn keep_no_returns(mut self) -> Self {
        if let Method::Consensus(consensus) = &mut self.first {
            consensus.keep_no_returns = true;
        }
        Pipeline { keep_no_returns: true, ..self }
    }

    /// Adds the weights or correspondences under the returned pose to the result
    /// ([`Registration::weight_graph`]), as reports show them, of the search itself: it does not run
    /// again for them.
    pub fn with_weight_graph(self) -> Self {
        Pipeline { weights: true, ..self }
    }

    /// Returns whether [`Method::is_slower_than_verdict`] holds for the first method or a
    /// refinement.
    pub fn is_slower_than_verdict(&self) -> bool {
        self.first.is_slower_than_verdict()
            || self.refinements.iter().any(Method::is_slower_than_verdict)
    }

    /// Returns the first method.
    pub fn first(&self) -> &Method {
        &self.first
    }
}

/// Returns the refinement with a limit on its pair distance if it has none and the clouds of
/// `found` overlap in part, as after consensus: pairs of any length would draw the clouds together.
fn limit_distance(method: &Method, found: &Registration) -> Method {
    match (method, found.method.parse()) {
        (Method::Icp(icp), Some(Method::Consensus(consensus))) if icp.max_distance.is_none() => {
            let max_distance =
                consensus.voxel.map(|length| bounded_icp::MAX_REFINE_DISTANCE * length);
            Method::Icp(Icp { max_distance, ..icp.clone() })
        }
        _ => method.clone(),
    }
}

impl Register for Pipeline {
    /// Registers. A refinement without correspondences keeps the previous pose as the result, with
    /// [`Warning::NotRefined`].
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        if let Method::Consensus(consensus) = &self.first {
            let found = self.register_by_consensus(consensus, source, target, None);
            return self.first.with_advice(found);
        }
        let clean = |end| CleanCloud::new(end, self.keep_no_returns);
        let clean = par::join_pair([source, target], clean)?;
        let [source, target] = clean.each_ref().map(CleanCloud::cached);
        // Weights are those of the descriptors that the method compared.
        let caches = [Cache::default(), Cache::default()];
        let [source, target] = match self.weights {
            true => [source.or_cache(&caches[0]), target.or_cache(&caches[1])],
            false => [source, target],
        };
        let begun = self.first.with_advice(match (&self.initial, self.first.as_refinement()) {
            (Some(initial), Some(refinement)) => match &self.first {
                Method::Icp(icp) if icp.max_distance.is_none() => {
                    bounded_icp::refine_with_distance_limit(icp, source, target, initial)
                }
                _ => refinement.refine_cached(source, target, initial),
            },
            _ => self.first.register_cached(source, target),
        })?;
        let found = self.run_refinements(begun, source, target)?;
        let found = self.verify(found, source, target)?;
        self.add_weights(found, |pose| self.first.weight_graph_cached(source, target, pose))
    }
}

impl Pipeline {
    /// Adds the weights under the returned pose, if they were asked for.
    fn add_weights(
        &self,
        mut found: Registration,
        weigh: impl FnOnce(&Transform) -> Result<Option<WeightGraph>>,
    ) -> Result<Registration> {
        if self.weights {
            // A pose is worth more than the weights behind it.
            found.weight_graph = match weigh(&found.transform) {
                Err(Error::Interrupted) => return Err(Error::Interrupted),
                weighed => weighed.ok().flatten().map(Box::new),
            };
        }
        Ok(found)
    }

    /// Registers by correspondences that are given ([`Consensus::register_correspondences`],
    /// [`Teaser::register_correspondences`](super::Teaser::register_correspondences)), refines the
    /// pose and verifies it. The clouds are used unchanged.
    ///
    /// # Errors
    /// Those of these methods; [`Error::Config`] for a first method that takes no correspondences,
    /// and for `scores` with teaser, which takes none.
    pub fn register_correspondences(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pairs: &[(u32, u32)],
        scores: Option<&[f32]>,
    ) -> Result<Registration> {
        match &self.first {
            Method::Consensus(consensus) => {
                let given = PointPair::from_indices(source, target, pairs, scores)?;
                let given = Some(&given[..]);
                self.register_by_consensus(consensus, source.into(), target.into(), given)
            }
            Method::Teaser(teaser) if scores.is_none() => {
                let begun = teaser.register_correspondences(source, target, pairs)?;
                let found = self.refine_from(begun, source, target)?;
                let ends = [source, target];
                self.add_weights(found, |pose| {
                    teaser.given_weight_graph(ends, pairs, pose).map(Some)
                })
            }
            Method::Teaser(_) => {
                let rule = "takes no scores: leave them out, or register by consensus";
                Err(Error::config("scores", "teaser", rule))
            }
            other => {
                let rule = "takes no correspondences: register by consensus or teaser";
                Err(Error::config("matches", other.name(), rule))
            }
        }
    }

    /// Runs only the refinements, from the result of another method, and the verdict; see
    /// [`register`](Register::register). The clouds are used unchanged.
    ///
    /// # Errors
    /// Those of [`Refine::refine`](super::Refine::refine).
    pub fn refine_from(
        &self,
        begun: Registration,
        source: &PointCloud,
        target: &PointCloud,
    ) -> Result<Registration> {
        let (source, target) = (source.into(), target.into());
        let found = self.run_refinements(begun, source, target)?;
        self.verify(found, source, target)
    }

    /// Registers by a search whose clouds are used by the refinements, and which verifies their
    /// pose.
    fn register_by_consensus(
        &self,
        consensus: &Consensus,
        source: Cached<'_>,
        target: Cached<'_>,
        given: Option<&[PointPair]>,
    ) -> Result<Registration> {
        par::with_threads(consensus.threads, || {
            let mut times = Timings::default();
            let search = consensus.search(source, target, given, &mut times)?;
            let begun = search.to_registration(times)?;
            let [source, target] = search.clouds();
            let mut found = self.run_refinements(begun, source, target)?;
            if found.verdict.is_none() {
                let pose = found.transform;
                let verdict = found.time_s.time("verdict", || search.verify(&pose));
                let distinguishes_rotations = consensus.distinguishes_rotations();
                found = found.with_search_verdict(verdict, distinguishes_rotations);
                found = drop_worse_refinement(found);
            }
            self.add_weights(found, |pose| search.weight_graph(pose).map(Some))
        })?
    }

    fn run_refinements(
        &self,
        begun: Registration,
        source: Cached<'_>,
        target: Cached<'_>,
    ) -> Result<Registration> {
        let mut found = begun;
        for method in &self.refinements {
            let method = limit_distance(method, &found);
            let Some(refinement) = method.as_refinement() else { continue };
            match refinement.refine_cached(source, target, &found.transform) {
                Ok(mut refined) => {
                    let own = std::mem::take(&mut refined.time_s);
                    refined.time_s = found.time_s.clone();
                    own.0
                        .iter()
                        .for_each(|(stage, seconds)| refined.time_s.add(stage.clone(), *seconds));
                    refined.refined_from = Some(Box::new(found));
                    found = refined;
                }
                Err(Error::NoWeight { .. } | Error::Degenerate { .. }) => {
                    found.doubts.push(Warning::NotRefined);
                    found.trusted = false;
                    break;
                }
                Err(error) => return Err(error),
            }
        }
        Ok(found)
    }

    /// Adds a verdict on the returned pose if one was requested, or if the pose had a verdict
    /// before its refinement.
    fn verify(
        &self,
        mut found: Registration,
        source: Cached<'_>,
        target: Cached<'_>,
    ) -> Result<Registration> {
        if found.verdict.is_some() {
            return Ok(found);
        }
        let Some(judge) = self.verdict.clone().or_else(|| previous_verifier(&found)) else {
            return Ok(found);
        };
        let pose = found.transform;
        let judged = found.time_s.time("verdict", || judge.verify_cached(source, target, &pose));
        match judged {
            Ok(verdict) => Ok(found.with_search_verdict(verdict, judge.distinguishes_rotations())),
            Err(Error::TooFewPoints { .. } | Error::Degenerate { .. } | Error::NoWeight { .. }) => {
                found.doubts.push(Warning::NotVerified);
                found.trusted = false;
                Ok(found)
            }
            Err(error) => Err(error),
        }
    }
}

/// Returns the registration before its refinements if its pose was accepted, and the refined pose is
/// not.
fn drop_worse_refinement(refined: Registration) -> Registration {
    let accepted = |found: &Registration| {
        found.verdict.as_ref().is_some_and(|verdict| verdict.decision == Decision::Accept)
    };
    let mut first = &refined;
    while let Some(before) = &first.refined_from {
        first = before;
    }
    let (true, false, Some(worse)) = (accepted(first), accepted(&refined), &refined.verdict) else {
        return refined;
    };
    let mut kept = first.clone();
    let reason = format!(
        "the refinement by {} was dropped: its pose gets {} with probability {:.3}",
        refined.method.name, worse.decision, worse.probability
    );
    kept.time_s = refined.time_s.clone();
    if let Some(verdict) = &mut kept.verdict {
        verdict.reasons.push(reason);
    }
    kept
}

/// Returns the settings by which a pose was verified before `found` refined it.
fn previous_verifier(found: &Registration) -> Option<Consensus> {
    let before = found.refined_from.as_deref()?;
    match (&before.verdict, before.method.parse()) {
        (Some(_), Some(Method::Consensus(consensus))) => Some(consensus),
        (Some(_), _) => Some(Consensus::default()),
        (None, _) => previous_verifier(before),
    }
}
