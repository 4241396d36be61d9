//! ICP: the nearest point within a limit, weighted and solved repeatedly.

mod convergence;
mod pairs;
mod surface;

use serde::{Deserialize, Serialize};

use self::convergence::Convergence;
use self::surface::{PairSet, SurfaceProblem};
use super::iterate::{Iteration, iterate};
use super::position_problem::PositionProblem;
use super::registration::{PointCounts, Timings};
use super::{Cached, MethodRecord, Refine, Registration, SolvedPose};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math;
use crate::moments::{self, Moments};
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solver};
use crate::verify::{self, FitnessRule};
use crate::weight::WeightScheme;

/// The minimised distance of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// Point to point (Besl and McKay 1992): a closed form.
    #[default]
    Point,
    /// Point to the target's tangent plane (Chen and Medioni 1991): Gauss-Newton.
    Plane,
    /// Disc to disc (Segal, Hähnel and Thrun 2009): Gauss-Newton.
    Generalized,
}

/// Iterative closest point: weight 1 for the nearest target point of every source point under the
/// current pose, solved repeatedly until the pose converges.
///
/// Finds the nearest local optimum, not the global one: start within about 20 degrees, or after a
/// method without an initial pose (`--method cf --refine icp`). From farther off the result is
/// usually wrong, and its low fitness gives a warning.
///
/// In the trace, the objective is the root mean square distance of the pairs (weighted, in the
/// target's unit) at the pose before the step; it falls.
///
/// Weights of points ([`PointCloud::with_weights`]): points of weight 0 are left out, the weight of
/// a pair is multiplied by those of its two points. `keep` counts pairs, regardless of their
/// weight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Icp {
    /// The metric that is minimised; default point to point. `plane` and `generalized` need fewer
    /// iterations and slide along surfaces, but need surfaces.
    pub metric: Metric,
    /// Largest pair distance, in the target's unit, above 0. Default none: every source point has a
    /// pair (Besl and McKay). Set it, to a few times the expected misalignment, when the clouds
    /// overlap only in part.
    pub max_distance: Option<f64>,
    /// Share of the pairs that is kept, shortest first, in (0, 1]; default 1. Trimmed ICP
    /// (Chetverikov et al. 2002): set it a little below the overlap.
    #[serde(rename = "keep")]
    pub trim_ratio: f64,
    /// Whether the source point must also be the nearest of its target point; default no. Fewer,
    /// better pairs under partial overlap, at about twice the time.
    pub reciprocal: bool,
    /// Kernel of the pair's distance; default uniform. Other kernels limit the influence of
    /// outliers.
    pub weights: WeightScheme,
    /// Bandwidth of the kernel, in the target's unit, above 0. Default three resolutions
    /// of the coarser cloud ([`verify::default_distance`]).
    pub bandwidth: Option<f64>,
    /// Number of nearest points for a tangent plane, at least 3; default 20 (Segal et al.). More
    /// for noisy clouds. Only for `plane` and `generalized`.
    pub surface_neighbors: usize,
    /// Most iterations, at least 1; default 200. A pose at this limit gets a warning.
    pub max_iterations: u32,
    /// Rotation of a step below which the pose has converged, radians, 0 or more; default 1e-6. A
    /// pose that returns, within this, to one of the eight last steps has also converged.
    pub rotation_tolerance: f64,
    /// Displacement of the source's centre in a step below which the pose has converged, in root
    /// mean square radii of the target, 0 or more; default 1e-6. Both must hold.
    pub translation_tolerance: f64,
    /// Change of the pairs' mean squared distance below which the iterations end, relative to the
    /// previous one, 0 or more; default 0, which leaves only the pose criteria.
    pub relative_error_tolerance: f64,
    /// Absolute change of the pairs' mean squared distance below which the iterations end, in
    /// squared target units, 0 or more; default 0.
    pub error_tolerance: f64,
    /// Constraints on the pose ([`Prior`]), except on its scale; default none. Exact for point to
    /// point; the other metrics project each step to the nearest allowed pose.
    pub prior: Prior,
    /// Whether to record every iteration.
    pub trace: bool,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for Icp {
    fn default() -> Self {
        Icp {
            metric: Metric::Point,
            max_distance: None,
            trim_ratio: 1.0,
            reciprocal: false,
            weights: WeightScheme::Uniform,
            bandwidth: None,
            surface_neighbors: 20,
            max_iterations: 200,
            rotation_tolerance: 1e-6,
            translation_tolerance: 1e-6,
            relative_error_tolerance: 0.0,
            error_tolerance: 0.0,
            prior: Prior::default(),
            trace: false,
            threads: 0,
        }
    }
}

impl Icp {
    /// Returns the paper's settings (section IV-A) as PCL 1.13's `IterativeClosestPoint` interprets
    /// them: pairs of at most 0.5, 1000 iterations, transformation epsilon 1e-9 (of the squared
    /// translation, and of 1 − cos of the angle), Euclidean fitness epsilon 0.05 (of the change of
    /// the mean squared distance, relative to it), and PCL's own 1e-12 on its absolute change. The
    /// relative criterion ends it after some ten iterations, before convergence.
    ///
    /// A preset, not a separate method: a [`Registration`] by it names `icp` and has all settings.
    /// The lengths are absolute, as the paper's; only the translation is measured by the cloud's
    /// radius here.
    pub fn paper() -> Self {
        Icp {
            max_distance: Some(0.5),
            max_iterations: 1000,
            rotation_tolerance: (1.0 - 1e-9f64).acos(),
            translation_tolerance: 1e-9f64.sqrt(),
            relative_error_tolerance: 0.05,
            error_tolerance: 1e-12,
            ..Icp::default()
        }
    }

    /// Returns its name in the catalogue.
    pub(super) fn name(&self) -> &'static str {
        match self.metric {
            Metric::Point => "icp",
            Metric::Plane => "plane-icp",
            Metric::Generalized => "gicp",
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] with the name of the first setting that is out of its range.
    pub fn validate(&self) -> Result<()> {
        let length = |field, value: Option<f64>| match value {
            Some(value) if !(value > 0.0 && value <= 1e15) => {
                Err(Error::config(field, value, "must be above 0 and at most 1e15"))
            }
            _ => Ok(()),
        };
        length("max_distance", self.max_distance)?;
        length("bandwidth", self.bandwidth)?;
        if !(self.trim_ratio > 0.0 && self.trim_ratio <= 1.0) {
            return Err(Error::config("keep", self.trim_ratio, "must be in (0, 1]"));
        }
        if self.surface_neighbors < 3 {
            let rule = "must be at least 3: fewer points have no plane";
            return Err(Error::config("surface_neighbors", self.surface_neighbors, rule));
        }
        if self.max_iterations == 0 {
            return Err(Error::config("max_iterations", 0, "must be at least 1"));
        }
        for (field, value) in [
            ("rotation_tolerance", self.rotation_tolerance),
            ("translation_tolerance", self.translation_tolerance),
            ("relative_error_tolerance", self.relative_error_tolerance),
            ("error_tolerance", self.error_tolerance),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::config(field, value, "must be finite, 0 or more"));
            }
        }
        self.prior.validate_for(ScaleEstimate::Fixed)?;
        // The kernel's own range check (ν of student-t).
        self.weights.weight(1.0, 0.0).map(|_| ())
    }

    /// Returns the settings with the bandwidth filled in if a kernel needs one.
    fn resolved(&self, source: Cached<'_>, target: Cached<'_>, scale: f64) -> Result<Icp> {
        let mut config = self.clone();
        if config.bandwidth.is_none() && config.weights != WeightScheme::Uniform {
            // Duplicated points have resolution 0.
            let [from, onto] = [source.resolution()?, target.resolution()?];
            let found = verify::default_distance_from_resolutions(from, onto, scale);
            config.bandwidth = Some(found.max(1e-6 * target.cloud.diagonal()));
        }
        Ok(config)
    }

    fn run(&self, ends: [Cached<'_>; 2], initial: &Transform) -> Result<Registration> {
        self.validate()?;
        let counting = ends.map(|end| end.cloud.with_positive_weights());
        let ends = [0, 1].map(|k| ends[k].restrict_to(&counting[k]));
        let [source, target] = ends.map(|end| end.cloud);
        let mut times = Timings::default();
        let positions = times.time("tree", || PositionProblem::new(ends[0], ends[1]))?;
        let config = self.resolved(ends[0], ends[1], initial.scale)?;
        let surfaces = match config.metric {
            Metric::Point => None,
            metric => Some(times.time("normals", || {
                SurfaceProblem::new(metric, ends, config.surface_neighbors, positions.rms_radius())
            })?),
        };
        let mut transform = *initial;
        let unit = positions.rms_radius();
        let mut convergence = Convergence::new(&config, source.centroid(), unit, transform);
        let iterated = iterate(config.trace, |iteration| {
            let (pairs, error) = times.time("pairs", || {
                pairs::find_pairs(&config, &positions, &positions.transform_source(&transform)?)
            })?;
            let moments = moments::moments_of_pairs(source, target, &pairs)?;
            let on = PairSet { source, target, pairs: &pairs };
            transform = times
                .time("solve", || self.next_pose(surfaces.as_ref(), on, &moments, &transform))?;
            let stop = convergence.check(transform, error, iteration);
            let (objective, weight) = (error.sqrt(), moments.weight);
            let state = (moments, pairs);
            Ok(Iteration { transform, objective, weight, bandwidth: None, stop, state })
        })?;
        let (moments, pairs) = iterated.state;
        let on = PairSet { source, target, pairs: &pairs };
        let degenerate = surfaces.and_then(|surfaces| surfaces.check_pivot(on, &transform));
        let solved = SolvedPose {
            transform,
            moments: Some(moments),
            singular_values: Some(
                pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed)?.singular_values,
            ),
            connections: pairs.len() as u64,
            iterations: iterated.iterations,
            stop: iterated.stop,
            trace: iterated.trace,
            points: Some(PointCounts::from_clouds(source, target)),
            time_s: times,
            method: MethodRecord::of_family(config.name(), "icp", &config),
            warnings: degenerate.into_iter().collect(),
            fitness: FitnessRule::LOCAL,
        };
        solved.finish_cached(ends[0], ends[1])
    }

    /// Returns the pose that minimises the distance of the pairs: after one step from `pose` on
    /// `surfaces`, in closed form without them.
    fn next_pose(
        &self,
        surfaces: Option<&SurfaceProblem>,
        on: PairSet<'_>,
        moments: &Moments,
        pose: &Transform,
    ) -> Result<Transform> {
        match surfaces {
            Some(surfaces) => self.prior.project_pose(
                &surfaces.gauss_newton_step(on, pose)?,
                moments.centered()?.source_mean,
            ),
            None => solve_point_to_point(moments, pose.scale, &self.prior),
        }
    }
}

/// Returns the pose of least squared distance that keeps its initial scale.
fn solve_point_to_point(moments: &Moments, scale: f64, prior: &Prior) -> Result<Transform> {
    let found = pose::solve_with(moments, Solver::Arun, ScaleEstimate::Fixed, prior)?.transform;
    if scale == 1.0 {
        return Ok(found);
    }
    let centered = moments.centered()?;
    let turned = math::mat_vec(&found.rotation, centered.source_mean);
    let translation = math::sub(centered.target_mean, math::scaled(turned, scale));
    Ok(Transform { rotation: found.rotation, translation, scale })
}

impl Refine for Icp {
    fn refine(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        initial: &Transform,
    ) -> Result<Registration> {
        self.refine_cached(source.into(), target.into(), initial)
    }

    fn refine_cached(
        &self,
        source: Cached<'_>,
        target: Cached<'_>,
        initial: &Transform,
    ) -> Result<Registration> {
        par::with_threads(self.threads, || self.run([source, target], initial))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_out_of_range_name_the_field() {
        let field = |icp: Icp| match icp.validate() {
            Err(Error::Config { field, .. }) => field,
            other => panic!("{other:?}"),
        };
        let icp = Icp::default();
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(field(Icp { max_distance: Some(bad), ..icp.clone() }), "max_distance");
            assert_eq!(field(Icp { bandwidth: Some(bad), ..icp.clone() }), "bandwidth");
            assert_eq!(field(Icp { trim_ratio: bad, ..icp.clone() }), "keep");
        }
        for bad in [-1e-9, f64::NAN, f64::INFINITY] {
            let with = Icp { rotation_tolerance: bad, ..icp.clone() };
            assert_eq!(field(with), "rotation_tolerance");
            let with = Icp { error_tolerance: bad, ..icp.clone() };
            assert_eq!(field(with), "error_tolerance");
        }
        assert_eq!(field(Icp { surface_neighbors: 2, ..icp.clone() }), "surface_neighbors");
        assert_eq!(field(Icp { max_iterations: 0, ..icp.clone() }), "max_iterations");
        let with = Icp { weights: WeightScheme::StudentT(-1.0), ..icp };
        assert_eq!(field(with), "weights");
        Icp::paper().validate().unwrap();
    }
}
