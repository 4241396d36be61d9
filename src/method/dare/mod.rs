//! DARE: density-adaptive registration (Järemo Lawin et al. 2018).

mod density;
mod mixture;

use serde::{Deserialize, Serialize};

use self::mixture::{ComponentStatistics, NormalizedCloud, SceneMixture};
use super::iterate::{Iteration, iterate};
use super::position_problem;
use super::registration::{PointCounts, Registration, Timings};
use super::termination::StopReason;
use super::{MethodRecord, Refine, SolvedPose};
use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::par;
use crate::pose::{Prior, ScaleEstimate};
use crate::verify::FitnessRule;

/// First iterations, in which the means are fixed and only poses and variances are updated, as in
/// the authors' program.
const FROZEN_ITERATIONS: u32 = 3;

/// Chance-corrected fitness below which a pose gets a warning, higher than for other methods: of
/// 105 wrong optima from rotations of 60° to 180° the best has 0.58 (0.60 with `min_sigma` 0.055),
/// of 15 correct ones the worst has 0.82 (`cargo test --features cli --test it dare::wrong_optima
/// -- --nocapture`).
pub(super) const MIN_CHANCE_CORRECTED_FITNESS: f64 = 0.65;

/// Fitness below which a pose gets a warning.
const FITNESS_RULE: FitnessRule =
    FitnessRule { min_fitness: MIN_CHANCE_CORRECTED_FITNESS, ..FitnessRule::LOCAL };

/// Density Adaptive Point Set Registration (Järemo Lawin, Danelljan, Khan, Forssén and Felsberg,
/// CVPR 2018), positions only.
///
/// Both clouds are drawn from one latent scene, a mixture of isotropic Gaussians and uniform
/// outliers. Expectation-maximisation of Σ_clouds Σ_j w_j ln p(T x_j), where the observation
/// weights w (sum 1 per cloud) compensate the sampling density; both poses, the means and the
/// variances are estimated, and the result is the source's pose relative to the target's. The means
/// start on a spherical Fibonacci lattice (the authors draw them at random) that rotates with the
/// target, the variances wide, which aligns the centroids: the method forgets the translation of
/// the initial pose, not its rotation. Rotations of 60° and more end in a wrong optimum. The
/// trace's objective is the log-likelihood per weight, both clouds together (positions in units of
/// the target's size): it never falls.
///
/// Weights of points ([`PointCloud::with_weights`]): points of weight 0 are left out, other weights
/// multiply the observation weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Dare {
    /// Gaussians of the latent scene, 4 to 100 000. Default 200, but at most a third of the points
    /// of the smaller cloud. More resolve finer shape and cost in proportion.
    pub components: Option<usize>,
    /// Most iterations, at least 1; default 1000 (the authors' demonstration runs 50). On
    /// two samples of 500 points of the bunny half of the runs need more than 265.
    pub max_iterations: u32,
    /// Share ω of points that belong to no component, above 0 and below 1; default 0.005 (the
    /// authors' γ = 0.005). Raise it for clutter and small overlap.
    pub outlier_ratio: f64,
    /// Nearest points (including the point itself) from which a point's sampling density is
    /// estimated, 3 or more; 0 weights all points equally, which is JRMPC (Evangelidis and Horaud
    /// 2018). Default the paper's 10. In fine refinement of scans 0 was better: 7 pairs of KITTI
    /// and a terrestrial scanner started 10° off ended 0.43° off in the median with 10 and 0.33°
    /// with 0 (2,000 points).
    pub density_neighbors: usize,
    /// Stops when the log-likelihood gains less than this in an iteration, 0 or more; default 1e-5.
    pub tolerance: f64,
    /// Initial standard deviation of all components, in root mean square radii of the clouds
    /// together under the initial pose, 0.01 to 100. Default 3, about the authors' bounding-box
    /// diagonal. A smaller value keeps the pose nearer to the initial pose.
    pub initial_sigma: f64,
    /// Smallest standard deviation of a component, in root mean square radii of the target, 1e-5 to
    /// 1; default 0.065. Every point counts as blurred by as much, so that components do not shrink
    /// onto a few points and fit the noise of the clouds; set it smaller for clouds of identical
    /// points. (The authors add 1e-5 to every variance in any unit, 0.06 on the bunny.) Found to
    /// 5°, of two samples of 500 points of the bunny rotated by up to 90° about each axis: 19 of
    /// 30, the authors' program 7, or 10 with as many components.
    pub min_sigma: f64,
    /// Constraints on the pose ([`Prior`]); default none.
    pub prior: Prior,
    /// Whether to record every iteration.
    pub trace: bool,
    /// Number of threads, 0 for all cores. Never changes the result.
    pub threads: usize,
}

impl Default for Dare {
    fn default() -> Self {
        Dare {
            components: None,
            max_iterations: 1000,
            outlier_ratio: 0.005,
            density_neighbors: 10,
            tolerance: 1e-5,
            initial_sigma: 3.0,
            min_sigma: 0.065,
            prior: Prior::default(),
            trace: false,
            threads: 0,
        }
    }
}

impl Dare {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`Error::Config`] for a setting outside the range in its field's documentation.
    pub fn validate(&self) -> Result<()> {
        let fault = |field, value: &dyn std::fmt::Display, rule: &str| {
            Err(Error::config(field, value, rule))
        };
        if let Some(k) = self.components.filter(|k| !(4..=100_000).contains(k)) {
            return fault("components", &k, "must be 4 to 100000");
        }
        if self.max_iterations == 0 {
            return fault("max_iterations", &0, "must be at least 1");
        }
        if !(self.outlier_ratio >= 1e-9 && self.outlier_ratio < 1.0) {
            return fault("outlier_ratio", &self.outlier_ratio, "must be 1e-9 or more, below 1");
        }
        if [1, 2].contains(&self.density_neighbors) {
            return fault("density_neighbors", &self.density_neighbors, "must be 0 or 3 and more");
        }
        if !(self.tolerance >= 0.0 && self.tolerance.is_finite()) {
            return fault("tolerance", &self.tolerance, "must be 0 or more");
        }
        if !(0.01..=100.0).contains(&self.initial_sigma) {
            return fault("initial_sigma", &self.initial_sigma, "must be 0.01 to 100");
        }
        if !(1e-5..=1.0).contains(&self.min_sigma) {
            return fault("min_sigma", &self.min_sigma, "must be 1e-5 to 1");
        }
        self.prior.validate_for(ScaleEstimate::Fixed)
    }

    /// Returns the settings with all defaults that depend on the clouds filled in.
    fn resolved(&self, source: &PointCloud, target: &PointCloud) -> Dare {
        let most = (source.len().min(target.len()) / 3).max(4);
        let components = self.components.unwrap_or_else(|| most.min(200));
        Dare { components: Some(components), ..self.clone() }
    }

    fn run(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        initial: &Transform,
    ) -> Result<Registration> {
        self.validate()?;
        let (source, target) = (&*source.with_positive_weights(), &*target.with_positive_weights());
        let config = self.resolved(source, target);
        let mut times = Timings::default();
        let frame = NormalizedFrame::new(source, target)?;
        let [from, to] = times.time("density", || {
            let view = |cloud, center| frame.normalize_cloud(cloud, center, self.density_neighbors);
            Ok::<_, Error>([view(source, frame.source)?, view(target, frame.target)?])
        })?;
        let mut pose = self.initial_pose(&frame, [&from, &to], initial)?;
        let mut mixture = config.initial_mixture(&from, &to, &pose);
        let mut before = f64::NEG_INFINITY;
        let step = |iteration: u32| {
            let (of_source, first) = mixture.e_step(&from, &pose);
            let (of_target, second) = mixture.e_step(&to, &Transform::IDENTITY);
            let objective = first + second;
            let [source_pose, target_pose] =
                self.solve_poses(&mut mixture, &of_source, &of_target, &pose)?;
            let clouds = [(&of_source[..], &source_pose), (&of_target[..], &target_pose)];
            mixture.update_components(clouds, iteration <= FROZEN_ITERATIONS);
            pose = target_pose.inverse().after(&source_pose);
            mixture.move_components(&target_pose);
            let weight = clouds.iter().flat_map(|(all, _)| *all).map(|c| c.mass).sum();
            let is_settled =
                iteration > FROZEN_ITERATIONS + 1 && objective - before < self.tolerance;
            before = objective;
            let stop = match () {
                () if is_settled => Some(StopReason::ObjectiveSettled),
                () if iteration == self.max_iterations => Some(StopReason::IterationLimit),
                () => None,
            };
            let transform = frame.denormalize_pose(&pose);
            let bandwidth = Some(frame.rms_radius * mixture.mean_sigma());
            Ok(Iteration { transform, objective, weight, bandwidth, stop, state: () })
        };
        let iterated = times.time("iterate", || iterate(self.trace, step))?;
        let (clusters, _) = mixture.e_step(&from, &pose);
        let moments = mixture.moments(&clusters, frame.rms_radius, (frame.source, frame.target));
        let solved = SolvedPose {
            transform: iterated.transform,
            moments: Some(moments),
            singular_values: Some(mixture.solve_pose(&clusters, &self.prior)?.singular_values),
            connections: source.len() as u64 * mixture.means.len() as u64,
            iterations: iterated.iterations,
            stop: iterated.stop,
            trace: iterated.trace,
            points: Some(PointCounts::from_clouds(source, target)),
            time_s: times,
            method: MethodRecord::new("dare", &config),
            warnings: Vec::new(),
            fitness: FITNESS_RULE,
        };
        solved.finish_cached(source.into(), target.into())
    }

    /// Returns the pose from which the iterations start, in units of the target's size.
    fn initial_pose(
        &self,
        frame: &NormalizedFrame,
        [from, to]: [&NormalizedCloud; 2],
        initial: &Transform,
    ) -> Result<Transform> {
        let mut pose = frame.normalize_pose(&Transform { scale: 1.0, ..*initial });
        if math::norm(pose.translation) > from.radius() + to.radius() {
            // No points can correspond: such a translation is not informative, and the scene would
            // be so wide that f32 cannot resolve the clouds in it.
            pose.translation = [0.0; 3];
        }
        // The projection may change the initial pose; the likelihood grows from there.
        self.prior.project_pose(&pose, [0.0; 3])
    }

    /// Returns the M-step's poses of both clouds in the scene's frame; `pose` is the previous pose
    /// between them.
    ///
    /// With a prior, which links the two poses, the scene first follows both clouds at their
    /// current poses, then the source alone moves: neither step lowers the likelihood.
    fn solve_poses(
        &self,
        mixture: &mut SceneMixture,
        source: &[ComponentStatistics],
        target: &[ComponentStatistics],
        pose: &Transform,
    ) -> Result<[Transform; 2]> {
        if self.prior.is_none() {
            let solve = |clusters| mixture.solve_pose(clusters, &self.prior);
            return Ok([solve(source)?.transform, solve(target)?.transform]);
        }
        mixture.follow_clouds([(source, pose), (target, &Transform::IDENTITY)])?;
        Ok([mixture.solve_pose(source, &self.prior)?.transform, Transform::IDENTITY])
    }

    /// Returns the initial scene: means on a sphere about both clouds' centroid, with their
    /// standard deviation along each axis, and rotated with the target.
    fn initial_mixture(
        &self,
        source: &NormalizedCloud,
        target: &NormalizedCloud,
        pose: &Transform,
    ) -> SceneMixture {
        let moved = source.points.iter().map(|p| pose.apply(p.map(f64::from)));
        let all: Vec<Vec3> = moved.chain(target.points.iter().map(|p| p.map(f64::from))).collect();
        let n = all.len() as f64;
        let center = math::scaled(all.iter().fold([0.0; 3], |sum, p| math::add(sum, *p)), 1.0 / n);
        let square = |p: Vec3| math::dot(p, p);
        let spread = all.iter().map(|&p| square(math::sub(p, center))).sum::<f64>() / n;
        // Each cloud about its own centroid: outliers fill the ball that contains both.
        let radius = source.radius().max(target.radius());
        let k = self.components.unwrap_or(4);
        let from_axes = math::transpose(&target.principal_axes());
        let lay = |direction| {
            let turned = math::mat_vec(&from_axes, direction);
            math::add(center, math::scaled(turned, (spread / 3.0).sqrt()))
        };
        SceneMixture {
            means: fibonacci_sphere(k).map(lay).collect(),
            variances: vec![self.initial_sigma.powi(2) * spread; k],
            outlier_ratio: self.outlier_ratio,
            volume: 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3),
            point_variance: self.min_sigma.powi(2),
        }
    }
}

/// Returns even directions by the golden angle (González 2010).
fn fibonacci_sphere(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2 * i + 1) as f64 / count as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        [radius * cos, radius * sin, z]
    })
}

/// The frame of the model: each cloud about its centroid, in units of the target's root mean square
/// radius.
struct NormalizedFrame {
    source: Vec3,
    target: Vec3,
    rms_radius: f64,
}

impl NormalizedFrame {
    fn new(source: &PointCloud, target: &PointCloud) -> Result<Self> {
        let unit = position_problem::rms_radius(source, target)?;
        Ok(NormalizedFrame {
            source: source.centroid(),
            target: target.centroid(),
            rms_radius: unit,
        })
    }

    fn normalize_cloud(
        &self,
        cloud: &PointCloud,
        center: Vec3,
        neighbors: usize,
    ) -> Result<NormalizedCloud> {
        let inward =
            |p| math::scaled(math::sub(p, center), 1.0 / self.rms_radius).map(|x| x as f32);
        let points: Vec<[f32; 3]> = cloud.positions().map(inward).collect();
        if points.as_flattened().iter().any(|x| x.is_nan() || x.abs() > 1e15) {
            return Err(Error::Extent { extent: f64::INFINITY });
        }
        let mut weights = match neighbors {
            0 => density::equal_weights(cloud.len()),
            k => density::observation_weights(&points, k)?,
        };
        if let Some(own) = cloud.relative_weights() {
            weights.iter_mut().zip(&own).for_each(|(weight, &own)| *weight *= f64::from(own));
            let sum: f64 = weights.iter().sum();
            weights.iter_mut().for_each(|weight| *weight /= sum);
        }
        Ok(NormalizedCloud { points, weights })
    }

    /// Converts a pose between the clouds into one between their normalised views.
    fn normalize_pose(&self, pose: &Transform) -> Transform {
        let shift = math::sub(pose.apply(self.source), self.target);
        Transform { translation: math::scaled(shift, 1.0 / self.rms_radius), ..*pose }
    }

    /// Converts a pose between the normalised views into one between the clouds.
    fn denormalize_pose(&self, pose: &Transform) -> Transform {
        let turned = pose.rotate(self.source);
        let shift = math::sub(math::scaled(pose.translation, self.rms_radius), turned);
        Transform { translation: math::add(shift, self.target), ..*pose }
    }
}

impl Refine for Dare {
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
    fn settings_out_of_range_are_named() {
        let ok = Dare::default;
        for (bad, name) in [
            (Dare { components: Some(3), ..ok() }, "components"),
            (Dare { max_iterations: 0, ..ok() }, "max_iterations"),
            (Dare { outlier_ratio: 0.0, ..ok() }, "outlier_ratio"),
            (Dare { outlier_ratio: f64::NAN, ..ok() }, "outlier_ratio"),
            (Dare { density_neighbors: 2, ..ok() }, "density_neighbors"),
            (Dare { tolerance: f64::NAN, ..ok() }, "tolerance"),
            (Dare { initial_sigma: f64::NAN, ..ok() }, "initial_sigma"),
            (Dare { min_sigma: 0.0, ..ok() }, "min_sigma"),
        ] {
            let found = bad.validate();
            assert!(matches!(found, Err(Error::Config { field, .. }) if field == name), "{name}");
        }
        assert!(ok().validate().is_ok());
    }

    #[test]
    fn the_lattice_is_even() {
        let points: Vec<Vec3> = fibonacci_sphere(100).collect();
        let sum = points.iter().fold([0.0; 3], |sum, p| math::add(sum, *p));
        assert!(math::norm(sum) < 1.0);
        assert!(points.iter().all(|p| (math::norm(*p) - 1.0).abs() < 1e-12));
    }
}
