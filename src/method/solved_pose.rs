//! From a solved pose to an evaluated registration.

use super::position_problem::PositionProblem;
use super::registration::{CloudCounts, PointCounts, Registration, Timings};
use super::{Cached, IterationRecord, MethodRecord, StopReason};
use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::moments::{self, Moments, WeightedPair};
use crate::normals::OrientedBy;
use crate::par;
use crate::pose::{self, ScaleEstimate, Solver};
use crate::verify::{self, FitnessRule, Warning};

/// A pose that a method has found, and the data behind it; [`finish`](Self::finish) returns the
/// [`Registration`].
///
/// Methods outside this crate start with [`SolvedPose::new`] and set the fields they know:
///
/// ```
/// use cfreg::method::{MethodRecord, Register, Registration, SolvedPose};
/// use cfreg::{PointCloud, Result, Transform};
/// # use cfreg::cloud::shape::boulder;
///
/// /// Moves centroid onto centroid.
/// struct Centroids;
///
/// impl Register for Centroids {
///     fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
///         let (from, onto) = (source.centroid(), target.centroid());
///         let translation = [0, 1, 2].map(|axis| onto[axis] - from[axis]);
///         let pose = Transform { translation, ..Transform::IDENTITY };
///         SolvedPose::new(pose, MethodRecord::new("centroids", &())).finish(source, target)
///     }
/// }
///
/// # let (source, target) = (boulder().sample(500, 1)?, boulder().sample(500, 2)?);
/// let found = Centroids.register(&source, &target)?;
/// assert_eq!(found.method.name, "centroids");
/// assert!(found.evaluation.fitness > 0.9);
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SolvedPose {
    /// `T_target_source`: maps source points into the target's frame.
    pub transform: Transform,
    /// The method and its settings.
    pub method: MethodRecord,
    /// Moments of the weights of the last solve. If `None`, those of every moved source point with
    /// its nearest target point within the distance of the evaluation.
    pub moments: Option<Moments>,
    /// Relative singular values of the solution ([`pose::Solution`]); if `None`, those of the
    /// moments.
    pub singular_values: Option<[f64; 3]>,
    /// Number of weighted connections; 0 if the method does not count them.
    pub connections: u64,
    /// Number of solves, each with new weights.
    pub iterations: u32,
    /// The reason why the iterations ended.
    pub stop: StopReason,
    /// Every iteration, if it was recorded.
    pub trace: Vec<IterationRecord>,
    /// Points of the clouds, from file to solve; `None` if all points were used.
    pub points: Option<PointCounts>,
    /// Seconds of the stages so far.
    pub time_s: Timings,
    /// Warnings of the method itself; those of every pose are added.
    pub warnings: Vec<Warning>,
    /// The required fitness.
    pub fitness: FitnessRule,
}

impl SolvedPose {
    /// Returns the pose of a method that solves once and reports nothing else.
    pub fn new(transform: Transform, method: MethodRecord) -> SolvedPose {
        SolvedPose {
            transform,
            method,
            moments: None,
            singular_values: None,
            connections: 0,
            iterations: 1,
            stop: StopReason::OneStep,
            trace: Vec::new(),
            points: None,
            time_s: Timings::default(),
            warnings: Vec::new(),
            fitness: FitnessRule::GLOBAL,
        }
    }

    /// Returns the registration: the pose evaluated on both clouds, with all warnings.
    ///
    /// # Errors
    /// Those of [`verify::evaluate`].
    pub fn finish(self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.finish_cached(source.into(), target.into())
    }

    pub(super) fn finish_cached(
        self,
        source: Cached<'_>,
        target: Cached<'_>,
    ) -> Result<Registration> {
        let SolvedPose { transform, mut time_s, mut warnings, fitness, .. } = self;
        let evaluation = time_s.time("evaluate", || {
            let [from, onto] = par::join_pair([source, target], |side| side.resolution())?;
            let distance = verify::default_distance_from_resolutions(from, onto, transform.scale);
            verify::evaluate(source.cloud, target.cloud, &transform, distance)
        })?;
        let moments = match self.moments {
            Some(moments) => moments,
            None => nearest_moments(source, target, &transform, evaluation.max_distance)?,
        };
        let singular_values = self.singular_values.unwrap_or_else(|| {
            pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed)
                .map_or([0.0; 3], |solution| solution.singular_values)
        });
        if self.stop == StopReason::IterationLimit {
            warnings.push(Warning::NotConverged { iterations: self.iterations });
        }
        warnings.extend(fitness.check(&evaluation));
        warnings.extend(verify::check_singular_values(singular_values));
        let points =
            self.points.unwrap_or_else(|| PointCounts::from_clouds(source.cloud, target.cloud));
        let low = warnings.iter().any(|warning| matches!(warning, Warning::LowFitness { .. }));
        let by_origin = |counts: &CloudCounts| counts.oriented_by == Some(OrientedBy::FrameOrigin);
        if low && (by_origin(&points.source) || by_origin(&points.target)) {
            warnings.push(Warning::NoViewpoint);
        }
        Ok(Registration {
            transform,
            method: self.method,
            trusted: warnings.is_empty(),
            doubts: warnings,
            verdict: None,
            evaluation,
            weighted_rms: (moments.residual(&transform) / moments.weight).max(0.0).sqrt(),
            beta: None,
            eigenvalue_ratio: None,
            connections: self.connections,
            effective_connections: moments.effective_connections(),
            singular_values,
            moments,
            iterations: self.iterations,
            stop: self.stop,
            trace: self.trace,
            points,
            time_s,
            certificate: None,
            refined_from: None,
            weight_graph: None,
        })
    }
}

/// Returns the moments of the pairs of every moved source point with its nearest target point at
/// most `max_distance` away.
fn nearest_moments(
    source: Cached<'_>,
    target: Cached<'_>,
    pose: &Transform,
    max_distance: f64,
) -> Result<Moments> {
    let positions = PositionProblem::new(source, target)?;
    let nearest = positions.nearest_targets(&positions.transform_source(pose)?);
    let limit = max_distance * max_distance;
    let pairs: Vec<WeightedPair> = (0..)
        .zip(&nearest)
        .filter(|(_, near)| f64::from(near.squared_distance) <= limit)
        .map(|(i, near)| WeightedPair {
            source: i,
            target: near.index,
            weight: positions.pair_weight(i as usize, near.index as usize),
        })
        .collect();
    moments::moments_of_pairs(source.cloud, target.cloud, &pairs)
}
