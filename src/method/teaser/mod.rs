//! TEASER (Yang, Shi and Carlone 2021).

mod certificate;
mod clique;
pub(super) mod correspondences;
mod inliers;
mod rotation;
mod voting;

use serde::{Deserialize, Serialize};

use super::features::FeatureConfig;
use super::registration::{Certificate, PointCounts, Registration, Timings};
use super::termination::{IterationRecord, StopReason};
use super::{Cached, MethodRecord, Register, SolvedPose};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::method::compatibility_graph::CompatibilityGraph;
use crate::moments::{FullConnection, Moments, check_indices};
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::verify::{FitnessRule, Warning};
use clique::Clique;
use correspondences::CenteredCorrespondences;
use rotation::{GncIteration, GncOptions};

/// Fitness below which a pose gets a warning; its chance fitness has no limit.
const FITNESS_RULE: FitnessRule =
    FitnessRule { max_chance_fitness: f64::INFINITY, ..FitnessRule::GLOBAL };

/// TEASER (Yang, Shi and Carlone 2021): correspondences by descriptor, the largest subset that
/// keeps distances, then rotation and translation by truncated least squares.
///
/// Stands most matches being wrong, without an initial guess. The answer is judged by how
/// the clouds lie on each other, as every other; on request there is a [`Certificate`](super::Certificate) of
/// the rotation too.
///
/// Weights of points ([`PointCloud::with_weights`]): those of weight 0 have no correspondence. The
/// size of other weights has no effect here: a correspondence is consistent with others or not.
///
/// ```
/// use cfreg::method::{Register, Teaser};
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(400, 1)?, boulder().sample(400, 2)?);
/// let registration = Teaser::default().register(&source, &target)?;
/// println!("{} inliers", registration.effective_connections);
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Teaser {
    /// Settings of the descriptors.
    #[serde(flatten)]
    pub features: FeatureConfig,
    /// Whether a correspondence must be nearest by descriptor both ways; default yes (the paper,
    /// section IV-B). No gives more correspondences, most of them wrong.
    pub cross_check: bool,
    /// Largest error β of a correct correspondence, in the target's unit, above 0. Default four
    /// resolutions of the coarser cloud: the two points of a correspondence are samples of one
    /// surface, not one point. Lower it for exact correspondences, raise it when there are few
    /// inliers.
    pub noise_bound: Option<f64>,
    /// Whether the clouds may differ in scale; default no. The scale is then estimated by voting on
    /// ratios of distances (TEASER's adaptive voting).
    pub estimate_scale: bool,
    /// Factor of the control parameter from one solve to the next, above 1 to 100; default 1.4 (the
    /// paper, section IV-B). A smaller factor follows the optimum more closely, in more iterations.
    pub gnc_factor: f64,
    /// Change of the rotation's cost at which the iterations end, in squared bounds, above 0;
    /// default 0.005 (the paper, section IV-B).
    pub cost_threshold: f64,
    /// Most solves for the rotation, at least 1; default 1000 (the paper, section IV-B).
    pub max_iterations: u32,
    /// Most steps of the search for the largest set of consistent correspondences, in thousands of
    /// machine words, at least 1; default 5,000,000, about ten seconds. A count and not a time, so
    /// that the result is the same on every machine; at the limit the best set so far is used, with
    /// a warning.
    pub clique_steps: u64,
    /// Whether to bound how much better than the rotation found any other could be; default
    /// no. Takes seconds, where it fails half a minute, and changes nothing else: see [`Certificate`](super::Certificate).
    pub certify: bool,
    /// Constraints on the pose ([`Prior`]), except on its scale; default none. The certificate is
    /// about the rotation alone: it cannot be combined with a prior.
    pub prior: Prior,
    /// Whether to record every iteration of the rotation: its objective is the truncated cost Σ w
    /// r²/(2β)² to which `cost_threshold` applies.
    pub trace: bool,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for Teaser {
    fn default() -> Self {
        Teaser {
            features: FeatureConfig::default(),
            cross_check: true,
            noise_bound: None,
            estimate_scale: false,
            gnc_factor: 1.4,
            cost_threshold: 0.005,
            max_iterations: 1000,
            clique_steps: 5_000_000,
            certify: false,
            prior: Prior::default(),
            trace: false,
            threads: 0,
        }
    }
}

/// Default noise bound, in resolutions of the coarser cloud.
///
/// Measured on three choices of 37, 47 and 20 real pairs of seven kinds (2,000 points; 50
/// neighbours, then 150; overlap from 0.3, then any) and on the paper's protocols with the
/// bunny (100 trials each: accuracy with small and large rotations, then robustness): poses
/// within 10°, and on the protocols the median of ‖I − R Rᵀ‖.
///
/// | bound | real pairs | protocols | median on them |
/// |---|---|---|---|
/// | 0.5 | 18, -, - | 34, 54, 100, 100 | 0.307, 0.229, 0.012, 0.007 |
/// | 1 | 27, -, - | 55, 71, 100, 100 | 0.217, 0.201, 0.036, 0.022 |
/// | 2 | 27, 33, 10 | 62, 83, 99, 100 | 0.207, 0.157, 0.086, 0.048 |
/// | 3 | 29, 29, - | - | - |
/// | 4 | 33, 32, 14 | 68, 81, 94, 100 | 0.199, 0.171, 0.120, 0.074 |
/// | 6 | 30, 35, - | - | - |
/// | 8 | 30, -, - | - | - |
/// | 0.05 (some 10) | - | 53, 64, 79, 98 | 0.226, 0.188, 0.159, 0.093 |
///
/// Robustness has the same points twice, which favours small bounds; scans do not.
const NOISE_BOUND_RESOLUTIONS: f64 = 4.0;
/// Most correspondences: their graph then takes 512 MB.
const MAX_CORRESPONDENCES: usize = 1 << 16;
/// Most differences between correspondences for the rotation: all pairs of 500. Chosen by hand.
const MAX_ROTATION_DIFFERENCES: usize = 125_000;
/// Most differences of a certificate: each makes its matrix four rows longer.
const MAX_CERTIFICATE_DIFFERENCES: usize = 100;

impl Teaser {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] that names the setting; those of [`FeatureConfig::validate`].
    pub fn validate(&self) -> Result<()> {
        self.features.validate()?;
        if let Some(bound) = self.noise_bound.filter(|&x| !(x > 0.0 && x <= 1e15)) {
            return Err(Error::config("noise_bound", bound, "must be above 0 and at most 1e15"));
        }
        let x = self.gnc_factor;
        if !(x > 1.0 && x <= 100.0) {
            return Err(Error::config("gnc_factor", x, "must be above 1 and at most 100"));
        }
        let x = self.cost_threshold;
        if !(x > 0.0 && x.is_finite()) {
            return Err(Error::config("cost_threshold", x, "must be above 0 and finite"));
        }
        if self.max_iterations == 0 {
            return Err(Error::config("max_iterations", 0, "must be at least 1"));
        }
        if self.clique_steps == 0 {
            return Err(Error::config("clique_steps", 0, "must be at least 1"));
        }
        if self.certify && !self.prior.is_none() {
            let rule = "bounds all rotations, not those of a prior: leave one of them out";
            return Err(Error::config("certify", true, rule));
        }
        self.prior.validate_for(ScaleEstimate::Fixed)
    }

    /// Returns the pose from given correspondences: indices of a source and of a target point each.
    /// Descriptors are not computed.
    ///
    /// # Errors
    /// [`Error::Shape`] for an index beyond its cloud, [`Error::TooFewPoints`] when fewer than
    /// three correspondences are consistent, [`Error::Degenerate`] when those determine no
    /// rotation, [`Error::Config`] for a setting out of range or too many correspondences.
    pub fn register_correspondences(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        pairs: &[(u32, u32)],
    ) -> Result<Registration> {
        par::with_threads(self.threads, || {
            self.validate()?;
            check_indices(source, "source", pairs.iter().map(|pair| pair.0))?;
            check_indices(target, "target", pairs.iter().map(|pair| pair.1))?;
            let (points, origins) = (
                [source, target].map(PointCloud::points),
                [source, target].map(PointCloud::origin),
            );
            let weights = [source, target].map(PointCloud::weights);
            let pairs: Vec<(u32, u32)> =
                pairs.iter().copied().filter(has_positive_weights(weights)).collect();
            let matches = CenteredCorrespondences::new(&pairs, points, origins);
            let counts = PointCounts::from_clouds(source, target);
            let times = Timings::default();
            let found = self.solve(&matches, source.into(), target.into(), counts, times)?;
            let method = found.method.clone().with_given_correspondences(Some(matches.len()));
            Ok(Registration { method, ..found })
        })?
    }

    fn run(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        self.validate()?;
        let mut times = Timings::default();
        let [source_side, target_side] =
            self.features.extract_pair([source, target], None, &mut times)?;
        let (p, q) = (source_side.view(), target_side.view());
        let matches = times.time("matches", || {
            let mut pairs =
                correspondences::match_features(&FullConnection::new(p, q)?, self.cross_check);
            pairs.retain(has_positive_weights([source_side.weights(), target_side.weights()]));
            Ok::<_, Error>(CenteredCorrespondences::new(
                &pairs,
                [p.points, q.points],
                [p.origin, q.origin],
            ))
        })?;
        let counts = PointCounts { source: source_side.counts(), target: target_side.counts() };
        self.solve(&matches, source, target, counts, times)
    }

    fn solve(
        &self,
        matches: &CenteredCorrespondences,
        source: Cached<'_>,
        target: Cached<'_>,
        points: PointCounts,
        mut times: Timings,
    ) -> Result<Registration> {
        check_matches(matches)?;
        let bound = self.resolve_noise_bound(source, target)?;
        // Both points of a difference may have the error.
        let difference_bound = 2.0 * bound;
        let scale = match self.estimate_scale {
            true => times.time("scale", || voting::vote_scale(matches, difference_bound))?,
            false => 1.0,
        };
        let clique = self.find_consistent_set(matches, scale, difference_bound, &mut times)?;
        let kept = matches.select(&clique.vertices);
        let (rounds, settled) = times.time("rotation", || {
            let differences =
                scale_differences(kept.pairwise_differences(MAX_ROTATION_DIFFERENCES), scale);
            let options = self.gnc_options();
            rotation::estimate_rotation(&differences, difference_bound, options, &self.prior)
        })?;
        let pose =
            |round: &GncIteration| voting::vote_translation(&kept, &round.rotation, scale, bound);
        let transform = rounds.last().map_or(Transform::IDENTITY, pose);
        let inliers = inliers::find_inliers(&kept, &transform, bound);
        let needed = inliers::min_inliers(matches, scale, difference_bound);
        let (vertices, found) = (clique.vertices.len(), inliers.len());
        let not_proved = (!clique.proved).then_some(Warning::CliqueNotProved { found: vertices });
        let few = (found < needed).then_some(Warning::FewInliers { found, needed });
        // Without inliers the pose is computed from the clique.
        let held = if inliers.is_empty() { kept.clone() } else { kept.select(&inliers) };
        let (moments, singular_values) = solve_inliers(&held)?;
        let certificate = self.certify.then(|| {
            times.time("certificate", || {
                self.certify_rotation(&kept, &transform, scale, difference_bound)
            })
        });
        let trace = if self.trace { trace(&rounds, pose) } else { Vec::new() };
        let config = Teaser { noise_bound: Some(bound), ..self.clone() };
        let solved = SolvedPose {
            transform,
            moments: Some(moments),
            singular_values: Some(singular_values),
            connections: matches.len() as u64,
            iterations: rounds.len() as u32,
            stop: if settled { StopReason::ObjectiveSettled } else { StopReason::IterationLimit },
            trace,
            points: Some(points),
            time_s: times,
            method: MethodRecord::new("teaser", &config),
            warnings: not_proved.into_iter().chain(few).collect(),
            fitness: FITNESS_RULE,
        };
        let registration = solved.finish_cached(source, target)?;
        Ok(Registration { certificate: certificate.flatten(), ..registration })
    }

    /// Finds the largest set of matches that keep their distances pairwise.
    fn find_consistent_set(
        &self,
        matches: &CenteredCorrespondences,
        scale: f64,
        difference_bound: f64,
        times: &mut Timings,
    ) -> Result<Clique> {
        let graph = times.time("graph", || {
            let joined = |k, l| matches.are_consistent(k, l, scale, difference_bound);
            CompatibilityGraph::new(matches.len(), joined)
        });
        let steps = self.clique_steps.saturating_mul(1000);
        let clique = times.time("clique", || clique::find_maximum_clique(&graph, steps));
        check_count(clique.vertices.len(), "the largest set of consistent matches")?;
        Ok(clique)
    }

    /// Bounds how far the rotation is from the best.
    fn certify_rotation(
        &self,
        kept: &CenteredCorrespondences,
        transform: &Transform,
        scale: f64,
        difference_bound: f64,
    ) -> Option<Certificate> {
        let differences =
            scale_differences(kept.subsampled_differences(MAX_CERTIFICATE_DIFFERENCES), scale);
        certificate::certify(&differences, difference_bound, self.gnc_options(), transform)
    }

    fn gnc_options(&self) -> GncOptions {
        GncOptions {
            factor: self.gnc_factor,
            cost_threshold: self.cost_threshold,
            max_iterations: self.max_iterations,
        }
    }

    /// Returns the noise bound in force.
    pub(super) fn resolve_noise_bound(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
    ) -> Result<f64> {
        self.noise_bound.map_or_else(|| self.default_noise_bound(source, target), Ok)
    }

    /// With an unknown scale only the target's resolution is in the target's unit.
    fn default_noise_bound(&self, source: Cached<'_>, target: Cached<'_>) -> Result<f64> {
        let mut resolution = target.resolution()?;
        if !self.estimate_scale {
            resolution = resolution.max(source.resolution()?);
        }
        if resolution > 0.0 {
            return Ok(NOISE_BOUND_RESOLUTIONS * resolution);
        }
        let rule = "most points have a double, so that the clouds say nothing about it: set it";
        Err(Error::config("noise_bound", "none", rule))
    }
}

impl Register for Teaser {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        par::with_threads(self.threads, || self.run(source, target))?
    }
}

/// Returns whether both points of a correspondence have a weight above 0.
fn has_positive_weights(weights: [Option<&[f32]>; 2]) -> impl Fn(&(u32, u32)) -> bool {
    move |&(i, j)| {
        let [a, b] = weights;
        a.is_none_or(|a| a[i as usize] > 0.0) && b.is_none_or(|b| b[j as usize] > 0.0)
    }
}

/// Refuses lists that are too short, or too long to be compared.
fn check_matches(matches: &CenteredCorrespondences) -> Result<()> {
    check_count(matches.len(), "the list of matches")?;
    if matches.len() <= MAX_CORRESPONDENCES {
        return Ok(());
    }
    let rule = format!("at most {MAX_CORRESPONDENCES} can be compared: thin the clouds first");
    Err(Error::config("matches", matches.len(), rule))
}

/// Returns the moments of the matches, and the singular values of their cross-covariance.
fn solve_inliers(matches: &CenteredCorrespondences) -> Result<(Moments, [f64; 3])> {
    let moments = matches.moments();
    match pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed) {
        Ok(solution) => Ok((moments, solution.singular_values)),
        // Too few inliers for a pose of their own: a warning, as the clique had a pose.
        Err(Error::Degenerate { singular_values, .. }) => Ok((moments, singular_values)),
        Err(error) => Err(error),
    }
}

/// Returns the records of all rounds; `pose` is that of a round.
fn trace(
    rounds: &[GncIteration],
    pose: impl Fn(&GncIteration) -> Transform,
) -> Vec<IterationRecord> {
    let record = |(k, round): (usize, &GncIteration)| IterationRecord {
        iteration: k as u32 + 1,
        transform: pose(round),
        objective: round.cost,
        weight: round.weight,
        bandwidth: None,
    };
    rounds.iter().enumerate().map(record).collect()
}

fn check_count(found: usize, what: &str) -> Result<()> {
    if found < 3 {
        return Err(Error::TooFewPoints { what: what.into(), found, needed: 3 });
    }
    Ok(())
}

/// Returns the differences with their source side in the target's unit.
fn scale_differences(differences: Vec<(Vec3, Vec3)>, scale: f64) -> Vec<(Vec3, Vec3)> {
    differences.into_iter().map(|(a, b)| (math::scaled(a, scale), b)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_are_named() {
        let field = |teaser: Teaser| match teaser.validate() {
            Err(Error::Config { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let teaser = Teaser::default;
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(field(Teaser { noise_bound: Some(bad), ..teaser() }), "noise_bound");
            assert_eq!(field(Teaser { gnc_factor: bad, ..teaser() }), "gnc_factor");
            assert_eq!(field(Teaser { cost_threshold: bad, ..teaser() }), "cost_threshold");
        }
        assert_eq!(field(Teaser { max_iterations: 0, ..teaser() }), "max_iterations");
        assert_eq!(field(Teaser { clique_steps: 0, ..teaser() }), "clique_steps");
        assert!(teaser().validate().is_ok());
    }
}
