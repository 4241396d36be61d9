//! Kernel Correlation (Tsin and Kanade 2004).

use serde::{Deserialize, Serialize};

use super::iterate::{Iteration, iterate};
use super::position_problem::PositionProblem;
use super::registration::{PointCounts, Registration, Timings};
use super::{MethodRecord, Refine, SolvedPose, StopReason};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::search;
use crate::verify::FitnessRule;
use crate::weight::{Gaussian, Normalization};

/// Default first σ in root mean square radii of the target. Chosen by hand.
const INITIAL_SIGMA_RADII: f64 = 0.5;
/// Default last σ in resolutions of the coarser cloud. Chosen by hand.
const FINAL_SIGMA_RESOLUTIONS: f64 = 2.0;

/// Kernel Correlation (Tsin and Kanade 2004; the paper's eq. 2): the pose that maximises the
/// correlation of the clouds, each blurred by a Gaussian, J(T) = Σ_ij exp(−d_ij²/2σ²).
///
/// Each step weights all pairs by w = exp(−d²/2σ²) at the current pose and solves once. **J never
/// falls** from step to step at one σ: with x = d²/2σ², the function e⁻ˣ is convex, so it is above
/// its tangent at the current x₀: e⁻ˣ ≥ e^(−x₀) (1 + x₀ − x). Summed over all pairs, J(T) ≥ J(T₀) +
/// (Σw d²(T₀) − Σw d²(T)) / 2σ². The closed form minimises Σw d²(T), so it is not above Σw d²(T₀),
/// and J(T) ≥ J(T₀). (The cost of Tsin and Kanade is −J.)
///
/// σ shrinks by a factor whenever a level has converged, from wide enough for capture to fine
/// enough for accuracy. As any local method it finds moderate rotations at large overlap; beyond
/// that the result has a warning.
///
/// The objective of the trace is J at the initial pose of the step; it grows while the bandwidth is
/// constant.
///
/// Weights of points ([`PointCloud::with_weights`]): points of weight 0 are left out; the weight of
/// any other pair is aᵢ bⱼ w, in J too, with weights relative to their cloud's mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct KernelCorrelation {
    /// First σ in the target's unit, above 0. Default half of the target's root mean square
    /// radius. Set it to the expected error of the pose when refining.
    pub sigma: Option<f64>,
    /// Last σ in the target's unit, above 0 and not above the first. Default twice the
    /// coarser cloud's resolution (median distance to the nearest neighbour), at most the
    /// first.
    pub last_sigma: Option<f64>,
    /// Factor on σ from level to level, in [0.01, 0.99]; default 0.7. A factor nearer to 1 is
    /// slower and loses the pose less easily.
    pub factor: f64,
    /// A level has converged when J grows by no more than this share of it, 0 to 0.1; default 1e-6
    /// (f32 weights leave 1e-7).
    pub tolerance: f64,
    /// Most iterations per level, at least 1; default 50. If the last level does not converge
    /// within this number, the result has a warning.
    pub max_iterations: u32,
    /// Constraints on the pose ([`Prior`]); default none.
    pub prior: Prior,
    /// Whether to record every iteration.
    pub trace: bool,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for KernelCorrelation {
    fn default() -> Self {
        KernelCorrelation {
            sigma: None,
            last_sigma: None,
            factor: 0.7,
            tolerance: 1e-6,
            max_iterations: 50,
            prior: Prior::default(),
            trace: false,
            threads: 0,
        }
    }
}

impl KernelCorrelation {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] for the first setting outside its range.
    pub fn validate(&self) -> Result<()> {
        for (field, sigma) in [("sigma", self.sigma), ("last_sigma", self.last_sigma)] {
            if let Some(sigma) = sigma.filter(|&sigma| !(sigma > 0.0 && sigma <= 1e15)) {
                return Err(Error::config(field, sigma, "must be above 0 and at most 1e15"));
            }
        }
        if let (Some(first), Some(last)) = (self.sigma, self.last_sigma)
            && last > first
        {
            return Err(Error::config(
                "last_sigma",
                last,
                format!("must not exceed sigma {first}"),
            ));
        }
        if !(0.01..=0.99).contains(&self.factor) {
            return Err(Error::config("factor", self.factor, "must be in [0.01, 0.99]"));
        }
        if !(0.0..=0.1).contains(&self.tolerance) {
            return Err(Error::config("tolerance", self.tolerance, "must be in [0, 0.1]"));
        }
        if self.max_iterations == 0 {
            return Err(Error::config("max_iterations", 0, "must be at least 1"));
        }
        self.prior.validate_for(ScaleEstimate::Fixed)
    }

    /// Returns the first and the last σ.
    fn sigma_range(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        unit: f64,
        scale: f64,
    ) -> Result<(f64, f64)> {
        let last = match self.last_sigma {
            Some(last) => last,
            None => {
                let source = search::resolution(source.points())? * scale;
                let resolution = source.max(search::resolution(target.points())?);
                // Clouds of repeated points have resolution 0.
                (FINAL_SIGMA_RESOLUTIONS * resolution).max(1e-3 * unit)
            }
        };
        Ok(match self.sigma {
            Some(first) => (first, last.min(first)),
            None => ((INITIAL_SIGMA_RADII * unit).max(last), last),
        })
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
        let (first, last) = self.sigma_range(source, target, unit, initial.scale)?;
        let (mut pose, mut sigma) = (*initial, first);
        let (mut in_level, mut before) = (0, f64::NEG_INFINITY);
        let iterated = iterate(self.trace, |_| {
            in_level += 1;
            let kernel = Gaussian { beta: (2.0 * (sigma / unit).powi(2)) as f32 };
            let moments = times.time("moments", || {
                positions.full_connection(&pose)?.moments(&kernel, Normalization::None)
            })?;
            let solution = times.time("solve", || {
                pose::solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, &self.prior)
            })?;
            pose = solution.transform;
            let (objective, bandwidth) = (moments.weight, Some(sigma));
            let settled = objective - before <= self.tolerance * objective;
            before = objective;
            let ends_level = settled || in_level == self.max_iterations;
            let stop = (ends_level && sigma <= last).then_some(match settled {
                true => StopReason::ScheduleEnded,
                false => StopReason::IterationLimit,
            });
            if ends_level {
                sigma = (sigma * self.factor).max(last);
                (in_level, before) = (0, f64::NEG_INFINITY);
            }
            let (weight, state) = (moments.weight, (solution, moments));
            Ok(Iteration { transform: pose, objective, weight, bandwidth, stop, state })
        })?;
        let (solution, moments) = iterated.state;
        let config =
            KernelCorrelation { sigma: Some(first), last_sigma: Some(last), ..self.clone() };
        let solved = SolvedPose {
            transform: iterated.transform,
            moments: Some(moments),
            singular_values: Some(solution.singular_values),
            connections: source.len() as u64 * target.len() as u64,
            iterations: iterated.iterations,
            stop: iterated.stop,
            trace: iterated.trace,
            points: Some(PointCounts::from_clouds(source, target)),
            time_s: times,
            method: MethodRecord::new("kc", &config),
            warnings: Vec::new(),
            fitness: FitnessRule::LOCAL,
        };
        solved.finish_cached(source.into(), target.into())
    }
}

impl Refine for KernelCorrelation {
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
        let field = |kc: KernelCorrelation| match kc.validate() {
            Err(Error::Config { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let kc = KernelCorrelation::default;
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(field(KernelCorrelation { sigma: Some(bad), ..kc() }), "sigma");
            assert_eq!(field(KernelCorrelation { last_sigma: Some(bad), ..kc() }), "last_sigma");
        }
        let crossed = KernelCorrelation { sigma: Some(1.0), last_sigma: Some(2.0), ..kc() };
        assert_eq!(field(crossed), "last_sigma");
        for bad in [0.0, 1.0, f64::NAN] {
            assert_eq!(field(KernelCorrelation { factor: bad, ..kc() }), "factor");
        }
        for bad in [-1.0, 0.2, f64::NAN] {
            assert_eq!(field(KernelCorrelation { tolerance: bad, ..kc() }), "tolerance");
        }
        assert_eq!(field(KernelCorrelation { max_iterations: 0, ..kc() }), "max_iterations");
        assert!(kc().validate().is_ok());
    }
}
