//! Coherent Point Drift, rigid (Myronenko and Song 2010).

mod expectation;

use serde::{Deserialize, Serialize};

use self::expectation::{EStepResult, SourceMixture};
use super::iterate::{Iteration, iterate};
use super::position_problem::PositionProblem;
use super::registration::{PointCounts, Registration, Timings};
use super::{MethodRecord, Refine, SolvedPose, StopReason};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math;
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solution, Solver};
use crate::verify::FitnessRule;

/// Smallest σ in root mean square radii of the target: a few roundings of f32 coordinates.
const SIGMA_FLOOR: f64 = 1e-6;
/// Smallest σ if only f32 tiles are used: below it σ² would contain only their rounding errors.
const EXACT_SIGMA_FLOOR: f64 = 1e-3;

/// Coherent Point Drift, rigid (Myronenko and Song, PAMI 2010, fig. 2): the source points are the
/// centres of a Gaussian mixture of one σ, the target points its data, and a uniform part
/// `outliers` explains the points that no centre explains. Expectation maximisation:
///
/// - E: w_ij = exp(−d²/2σ²) / (Σ_i exp(−d²/2σ²) + c), with c = (2πσ²)^{3/2} w/(1 − w) N/M for N
///   source and M target points,
/// - M: pose by the closed form, then σ² = Σw d² / (3 Σw), both from the moments alone.
///
/// σ starts wide enough to connect all points and decreases by itself. Finds rotations of some tens
/// of degrees at full overlap; beyond that it converges to a wrong pose, and the result has a
/// warning. Lengths are in root mean square radii of the target, as in the authors' programs, so
/// the unit of the clouds does not matter.
///
/// The objective of the trace is the negative log-likelihood per target point, −Σ_j ln(Σ_i
/// exp(−d²/2σ²) + c)/M + 3/2 ln σ², at the initial pose and σ of the step: it falls from step to
/// step.
///
/// Weights of points ([`PointCloud::with_weights`]): points of weight 0 are left out. With a and b
/// the other weights relative to their cloud's mean, aᵢ/N is the share of centre i in the mixture
/// and bⱼ the weight of datum j: w_ij = bⱼ aᵢ exp(−d²/2σ²) / (Σ_i aᵢ exp(−d²/2σ²) + c), the
/// objective is −Σ_j bⱼ ln(…)/M + 3/2 ln σ².
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Cpd {
    /// Share w of target points that the mixture does not explain, in [0, 1); default 0.1, as in
    /// the authors' program. Raise it under noise and partial overlap.
    pub outliers: f64,
    /// Whether the clouds may differ in scale: `fixed` (default, and the paper's section
    /// IV) or `umeyama`, the published update. `symmetric` is refused: it is not the
    /// M-step's maximum.
    pub scale: ScaleEstimate,
    /// First σ in the target's unit, above 0. Default the published: √ of a third of the mean
    /// squared distance over all pairs. Set it to the expected error of the pose when refining, so
    /// that a good initial pose is kept.
    pub sigma: Option<f64>,
    /// Stops when the objective changes by no more than this, in nats per target point, 0 to 1;
    /// default 1e-6. The authors' 1e-5 is relative to the magnitude of the whole objective, which
    /// depends on the unit.
    pub tolerance: f64,
    /// Most iterations, at least 1; default 150 (the authors' program's).
    pub max_iterations: u32,
    /// Largest share of a target point's weights that may be left out once σ is small, in [0, 0.1];
    /// default 1e-7, the rounding error of f32 tiles. Only sources with d² ≤ d²_nearest + 2σ²
    /// ln(N/share) are then connected, found by search and weighted in f64. 0 always weights all
    /// pairs; σ then ends at a thousandth of the target's radius, and weights below e⁻⁸⁷ vanish.
    pub truncation: f64,
    /// Constraints on the pose ([`Prior`]); default none.
    pub prior: Prior,
    /// Whether to record every iteration.
    pub trace: bool,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for Cpd {
    fn default() -> Self {
        Cpd {
            outliers: 0.1,
            scale: ScaleEstimate::Fixed,
            sigma: None,
            tolerance: 1e-6,
            max_iterations: 150,
            truncation: 1e-7,
            prior: Prior::default(),
            trace: false,
            threads: 0,
        }
    }
}

impl Cpd {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] for the first setting outside its range.
    pub fn validate(&self) -> Result<()> {
        if !(0.0..1.0).contains(&self.outliers) {
            return Err(Error::config("outliers", self.outliers, "must be in [0, 1)"));
        }
        if self.scale == ScaleEstimate::Symmetric {
            return Err(Error::config("scale", self.scale, "must be fixed or umeyama"));
        }
        if let Some(sigma) = self.sigma.filter(|&sigma| !(sigma > 0.0 && sigma <= 1e15)) {
            return Err(Error::config("sigma", sigma, "must be above 0 and at most 1e15"));
        }
        if !(0.0..=1.0).contains(&self.tolerance) {
            return Err(Error::config("tolerance", self.tolerance, "must be in [0, 1]"));
        }
        if self.max_iterations == 0 {
            return Err(Error::config("max_iterations", 0, "must be at least 1"));
        }
        if !(0.0..=0.1).contains(&self.truncation) {
            return Err(Error::config("truncation", self.truncation, "must be in [0, 0.1]"));
        }
        self.prior.validate_for(self.scale)
    }

    fn run(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        initial: &Transform,
    ) -> Result<Registration> {
        self.validate()?;
        let (source, target) = (&*source.with_positive_weights(), &*target.with_positive_weights());
        let mut times = Timings::default();
        let positions =
            times.time("prepare", || PositionProblem::new(source.into(), target.into()))?;
        let unit = positions.rms_radius();
        let floor = if self.truncation > 0.0 { SIGMA_FLOOR } else { EXACT_SIGMA_FLOOR };
        let first = self.sigma.unwrap_or_else(|| initial_sigma(source, target, initial));
        let mut sigma = (first / unit).max(floor);
        let mixture =
            SourceMixture::new(&positions, source, target, self.outliers, self.truncation);
        let (mut pose, mut objective) = (*initial, f64::INFINITY);
        let iterated = iterate(self.trace, |iteration| {
            let expectation: EStepResult =
                times.time("moments", || mixture.e_step(&pose, sigma))?;
            let moments = expectation.moments;
            let solution = times.time("solve", || {
                pose::solve_with(&moments, Solver::Arun, self.scale, &self.prior)
            })?;
            check_scale(&solution)?;
            pose = solution.transform;
            let bandwidth = Some(sigma * unit);
            let change = (objective - expectation.objective).abs();
            objective = expectation.objective;
            let variance = moments.residual(&pose) / (3.0 * moments.weight) / (unit * unit);
            let next = variance.sqrt().max(floor);
            let stop = self.stop_reason(iteration, change, next == floor && sigma == floor);
            sigma = next;
            let (weight, state) = (moments.weight, (solution, expectation));
            Ok(Iteration { transform: pose, objective, weight, bandwidth, stop, state })
        })?;
        let (solution, expectation) = iterated.state;
        let solved = SolvedPose {
            transform: iterated.transform,
            moments: Some(expectation.moments),
            singular_values: Some(solution.singular_values),
            connections: expectation.connections,
            iterations: iterated.iterations,
            stop: iterated.stop,
            trace: iterated.trace,
            points: Some(PointCounts::from_clouds(source, target)),
            time_s: times,
            method: MethodRecord::new("cpd", &Cpd { sigma: Some(first), ..self.clone() }),
            warnings: Vec::new(),
            fitness: FitnessRule::LOCAL,
        };
        solved.finish_cached(source.into(), target.into())
    }

    /// Returns the reason to stop after an iteration that changed the objective by `change`.
    fn stop_reason(&self, iteration: u32, change: f64, at_floor: bool) -> Option<StopReason> {
        match () {
            () if change <= self.tolerance => Some(StopReason::ObjectiveSettled),
            () if at_floor => Some(StopReason::ScheduleEnded),
            () if iteration == self.max_iterations => Some(StopReason::IterationLimit),
            () => None,
        }
    }
}

/// Refuses a solution that shrinks the source to a point, or mirrors it.
fn check_scale(solution: &Solution) -> Result<()> {
    match solution.transform.scale > 0.0 {
        true => Ok(()),
        false => Err(Error::Degenerate { rank: 0, singular_values: solution.singular_values }),
    }
}

/// Returns √(Σ_ij d²/3NM) at `pose`, from means and variances alone.
fn initial_sigma(source: &PointCloud, target: &PointCloud, pose: &Transform) -> f64 {
    // Weighted mean, and weighted mean squared distance from it.
    let spread = |cloud: &PointCloud| {
        let center = cloud.centroid();
        let local = || cloud.positions().map(|p| math::sub(p, center));
        let squares = || local().map(|p| math::dot(p, p));
        let n = cloud.len() as f64;
        let Some(weights) = cloud.relative_weights() else {
            return (center, squares().sum::<f64>() / n);
        };
        let share = || weights.iter().map(|&weight| f64::from(weight) / n);
        let off = local()
            .zip(share())
            .fold([0.0; 3], |sum, (p, share)| math::add(sum, math::scaled(p, share)));
        let squares = squares().zip(share()).map(|(square, share)| share * square).sum::<f64>();
        (math::add(center, off), squares - math::dot(off, off))
    };
    let ((from, source), (to, target)) = (spread(source), spread(target));
    let shift = math::sub(pose.apply(from), to);
    ((pose.scale * pose.scale * source + target + math::dot(shift, shift)) / 3.0).sqrt()
}

impl Refine for Cpd {
    fn refine(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        initial: &Transform,
    ) -> Result<Registration> {
        par::with_threads(self.threads, || self.run(source, target, initial))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_name_the_field() {
        let field = |cpd: Cpd| match cpd.validate() {
            Err(Error::Config { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let cpd = Cpd::default;
        for bad in [-0.1, 1.0, f64::NAN] {
            assert_eq!(field(Cpd { outliers: bad, ..cpd() }), "outliers");
        }
        for bad in [-1.0, 1.5, f64::NAN] {
            assert_eq!(field(Cpd { tolerance: bad, ..cpd() }), "tolerance");
            assert_eq!(field(Cpd { truncation: bad, ..cpd() }), "truncation");
        }
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(field(Cpd { sigma: Some(bad), ..cpd() }), "sigma");
        }
        assert_eq!(field(Cpd { max_iterations: 0, ..cpd() }), "max_iterations");
        assert_eq!(field(Cpd { scale: ScaleEstimate::Symmetric, ..cpd() }), "scale");
        assert!(cpd().validate().is_ok());
    }

    #[test]
    fn the_first_sigma_is_that_of_all_pairs() {
        let source = PointCloud::new(&[[0.0, 0.0, 1.0], [2.0, 0.0, 0.0], [1.0, 5.0, 0.0]]).unwrap();
        let target = PointCloud::new(&[[1.0, 0.0, 0.0], [3.0, -2.0, 0.0]]).unwrap();
        let pose = Transform { scale: 2.0, ..Transform::from_rotation_vector([0.3, 0.1, -2.0]) };
        let mut sum = 0.0;
        for p in source.positions() {
            for q in target.positions() {
                let d = math::sub(pose.apply(p), q);
                sum += math::dot(d, d);
            }
        }
        let want = (sum / 18.0).sqrt();
        assert!((initial_sigma(&source, &target, &pose) / want - 1.0).abs() < 1e-6);
        // An integer weight equals as many copies of the point.
        let heavy = source.clone().with_weights(vec![1.0, 3.0, 2.0]).unwrap();
        let many = source.select(&[0, 1, 1, 1, 2, 2]);
        let sigma = |source| initial_sigma(source, &target, &pose);
        assert!((sigma(&heavy) / sigma(&many) - 1.0).abs() < 1e-6);
    }
}
