//! The latent scene: isotropic Gaussians and a uniform outlier component.
//!
//! Each component has its own variance, so a connection's weight is not a function of the distance
//! alone and the tiles of [`crate::moments`] cannot be used. But an isotropic Gaussian depends only
//! on the mass, centroid and scatter of the points it is responsible for: one pass over N·K returns
//! a [`ComponentStatistics`] per component, and poses, means and variances follow from these in
//! O(K). The responsibilities are never stored.

use pulp::{Simd, WithSimd};

use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, Mat3, Vec3, fast};
use crate::moments::Moments;
use crate::par;
use crate::pose::{self, Prior, ScaleEstimate, Solution, Solver};

/// Points per task of the parallel loop. Chosen by hand.
const BLOCK: usize = 1024;
/// Points that are summed in f32 before the sums continue in f64. Chosen by hand.
const CHUNK: usize = 32;
/// Sums per component: Σa, Σa dx, Σa dy, Σa dz, Σa|d|², Σa².
const SUMS_PER_COMPONENT: usize = 6;
/// Factor on the weights before they are squared: they may be 1e-7 each.
const WEIGHT_SCALE: f32 = (1u32 << 30) as f32;
/// Mass below which a component keeps its mean and variance: they are unconstrained.
const MIN_MASS: f64 = 1e-12;

/// A cloud about its centroid in units of the model, and its observation weights.
pub(super) struct NormalizedCloud {
    pub(super) points: Vec<[f32; 3]>,
    /// Weights with sum 1.
    pub(super) weights: Vec<f64>,
}

impl NormalizedCloud {
    /// Returns the distance of the farthest point from the centroid.
    pub(super) fn radius(&self) -> f64 {
        let squares = self.points.iter().map(|p| p.map(f64::from)).map(|p| math::dot(p, p));
        squares.fold(0.0, f64::max).sqrt()
    }

    /// Returns the principal axes, a right-handed frame: the widest first, each of the first two
    /// towards its longer tail.
    pub(super) fn principal_axes(&self) -> Mat3 {
        let points = || self.points.iter().map(|p| p.map(f64::from));
        let mut squares = [[0.0; 3]; 3];
        for p in points() {
            let outer = math::outer(p, p);
            squares = [0, 1, 2].map(|a| math::add(squares[a], outer[a]));
        }
        let (_, [_, second, first]) = math::eigen::symmetric(&squares);
        let tailed = |axis: Vec3| {
            let cubes: f64 = points().map(|p| math::dot(p, axis).powi(3)).sum();
            math::scaled(axis, if cubes < 0.0 { -1.0 } else { 1.0 })
        };
        let (first, second) = (tailed(first), tailed(second));
        [first, second, math::cross(first, second)]
    }
}

/// Density Σ_k π N(μ_k, σ_k²) + ω/V, with equal priors π = (1 − ω)/K.
pub(super) struct SceneMixture {
    pub(super) means: Vec<Vec3>,
    pub(super) variances: Vec<f64>,
    /// ω.
    pub(super) outlier_ratio: f64,
    /// V.
    pub(super) volume: f64,
    /// Variance of every point about its measured position. Its expected log-likelihood under a
    /// component is that of the point less 3/2 blur/σ²: this factor in the E-step and this term of
    /// the variances keep EM monotone.
    pub(super) point_variance: f64,
}

/// Statistics of the points that a component is responsible for, in the cloud's own coordinates.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ComponentStatistics {
    /// Σa, a = responsibility × observation weight.
    pub(super) mass: f64,
    /// Σa².
    pub(super) squared_mass: f64,
    /// Σa x / Σa.
    pub(super) centroid: Vec3,
    /// Σa |x − centroid|².
    pub(super) scatter: f64,
}

impl SceneMixture {
    /// The E-step: returns the clusters of `view` under `pose`, and Σ_j w_j ln p(x_j).
    pub(super) fn e_step(
        &self,
        view: &NormalizedCloud,
        pose: &Transform,
    ) -> (Vec<ComponentStatistics>, f64) {
        let k = self.means.len();
        let model = self.simd_components();
        let sums_of_block = |_: &mut (), block| self.sum_block(view, pose, &model, block);
        let blocks = par::map_blocks(view.points.len(), BLOCK, || (), sums_of_block);
        let mut sums = vec![0.0; SUMS_PER_COMPONENT * k];
        let mut likelihood = self.outlier_density().ln();
        for (block, part) in &blocks {
            sums.iter_mut().zip(block).for_each(|(sum, x)| *sum += x);
            likelihood += part;
        }
        let back = pose.inverse();
        let cluster = |i: usize| {
            let sum = |s: usize| sums[s * k + i];
            let mass = sum(0);
            let lift = f64::from(WEIGHT_SCALE);
            let squared = sum(5) / (lift * lift);
            if mass < MIN_MASS {
                return ComponentStatistics::default();
            }
            // About the component's mean in f32, as the kernel used it.
            let mean = self.means[i].map(|x| f64::from(x as f32));
            let shift = math::scaled([sum(1), sum(2), sum(3)], 1.0 / mass);
            let scatter = (sum(4) - mass * math::dot(shift, shift)).max(0.0);
            ComponentStatistics {
                mass,
                squared_mass: squared,
                centroid: back.apply(math::add(mean, shift)),
                scatter,
            }
        };
        ((0..k).map(cluster).collect(), likelihood)
    }

    /// Density of outliers.
    fn outlier_density(&self) -> f64 {
        self.outlier_ratio / self.volume
    }

    /// The components as the kernel takes them: amplitudes relative to the density of outliers.
    fn simd_components(&self) -> SimdComponents {
        let uniform = self.outlier_density();
        let prior = (1.0 - self.outlier_ratio) / self.means.len() as f64;
        let amplitude = |variance: &f64| {
            let blurred = (-1.5 * self.point_variance / variance).exp();
            (prior / uniform * blurred * (std::f64::consts::TAU * variance).powf(-1.5)) as f32
        };
        let axis = |a: usize| self.means.iter().map(|mean| mean[a] as f32).collect();
        SimdComponents {
            x: axis(0),
            y: axis(1),
            z: axis(2),
            exponent: self.variances.iter().map(|v| (-0.5 / v) as f32).collect(),
            amplitude: self.variances.iter().map(amplitude).collect(),
        }
    }

    /// Sums of the components, and the log-likelihood, over a block of points.
    fn sum_block(
        &self,
        view: &NormalizedCloud,
        pose: &Transform,
        model: &SimdComponents,
        block: std::ops::Range<usize>,
    ) -> (Vec<f64>, f64) {
        let k = self.means.len();
        let mut sums = vec![0.0; SUMS_PER_COMPONENT * k];
        let mut likelihood = 0.0;
        for start in block.clone().step_by(CHUNK) {
            let range = start..(start + CHUNK).min(block.end);
            let moved: Vec<[f32; 3]> = view.points[range.clone()]
                .iter()
                .map(|p| pose.apply(p.map(f64::from)).map(|x| x as f32))
                .collect();
            let mut partial = vec![0.0f32; SUMS_PER_COMPONENT * k];
            let weights = &view.weights[range];
            let pass = EStepKernel { model, points: &moved, weights, sums: &mut partial };
            likelihood += pulp::Arch::new().dispatch(pass);
            sums.iter_mut().zip(&partial).for_each(|(sum, &x)| *sum += f64::from(x));
        }
        (sums, likelihood)
    }

    /// Root of the mean variance of the components.
    pub(super) fn mean_sigma(&self) -> f64 {
        let k = self.variances.len() as f64;
        (self.variances.iter().sum::<f64>() / k).sqrt()
    }

    /// Moments of all connections of the points behind `clusters` with the means, weighted by
    /// a/σ_k², in units of `unit` about the given origins: the scatter is the same for every pose.
    pub(super) fn moments(
        &self,
        clusters: &[ComponentStatistics],
        unit: f64,
        (source_origin, target_origin): (Vec3, Vec3),
    ) -> Moments {
        let mut moments = Moments::about(source_origin, target_origin);
        for ((cluster, &mean), variance) in clusters.iter().zip(&self.means).zip(&self.variances) {
            let (p, q) = (math::scaled(cluster.centroid, unit), math::scaled(mean, unit));
            let rest = moments.weight_squared + cluster.squared_mass / (variance * variance);
            moments.add_pair(cluster.mass / variance, p, q);
            moments.weight_squared = rest;
            moments.source_squares += unit * unit * cluster.scatter / variance;
        }
        moments
    }

    /// Returns the pose with the least squared distance of the clusters to the means, by the
    /// model's weights, among the poses that `prior` allows.
    ///
    /// # Errors
    /// Those of [`pose::solve_with`].
    pub(super) fn solve_pose(
        &self,
        clusters: &[ComponentStatistics],
        prior: &Prior,
    ) -> Result<Solution> {
        let moments = self.moments(clusters, 1.0, ([0.0; 3], [0.0; 3]));
        pose::solve_with(&moments, Solver::Arun, ScaleEstimate::Fixed, prior)
    }

    /// Moves the means rigidly to the least squared distance to the clusters of both clouds under
    /// their poses; the means do not move if this motion is unconstrained.
    ///
    /// # Errors
    /// Those of [`pose::solve`], except for the unconstrained rotation.
    pub(super) fn follow_clouds(
        &mut self,
        clouds: [(&[ComponentStatistics], &Transform); 2],
    ) -> Result<()> {
        let mut moments = Moments::about([0.0; 3], [0.0; 3]);
        for (clusters, pose) in clouds {
            for ((cluster, &mean), variance) in
                clusters.iter().zip(&self.means).zip(&self.variances)
            {
                moments.add_pair(cluster.mass / variance, pose.apply(cluster.centroid), mean);
            }
        }
        match pose::solve(&moments, Solver::Arun, ScaleEstimate::Fixed) {
            Ok(solution) => self.move_components(&solution.transform),
            Err(Error::Degenerate { .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Moves the scene, which has no frame of its own, into that of a cloud under `pose`.
    pub(super) fn move_components(&mut self, pose: &Transform) {
        let back = pose.inverse();
        self.means.iter_mut().for_each(|mean| *mean = back.apply(*mean));
    }

    /// The rest of the M-step: updates the means (unless `freeze_means`), then the variances, from
    /// the clusters of both clouds under their new poses.
    pub(super) fn update_components(
        &mut self,
        clouds: [(&[ComponentStatistics], &Transform); 2],
        freeze_means: bool,
    ) {
        for i in 0..self.means.len() {
            let parts = clouds.map(|(clusters, pose)| {
                let cluster = &clusters[i];
                (cluster.mass, pose.apply(cluster.centroid), cluster.scatter)
            });
            let mass = parts[0].0 + parts[1].0;
            if mass < MIN_MASS {
                continue;
            }
            if !freeze_means {
                let [a, b] = parts.map(|(mass, centroid, _)| math::scaled(centroid, mass));
                self.means[i] = math::scaled(math::add(a, b), 1.0 / mass);
            }
            let spread = |&(mass, centroid, scatter): &(f64, Vec3, f64)| {
                let rest = math::sub(centroid, self.means[i]);
                scatter + mass * math::dot(rest, rest)
            };
            self.variances[i] =
                parts.iter().map(spread).sum::<f64>() / (3.0 * mass) + self.point_variance;
        }
    }
}

/// The model in f32, one array per parameter.
struct SimdComponents {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    /// −1/2σ².
    exponent: Vec<f32>,
    /// Relative to the outliers' density.
    amplitude: Vec<f32>,
}

struct EStepKernel<'a> {
    model: &'a SimdComponents,
    points: &'a [[f32; 3]],
    weights: &'a [f64],
    sums: &'a mut [f32],
}

impl WithSimd for EStepKernel<'_> {
    /// Σ w ln(p / outlier density).
    type Output = f64;

    // Plain loops: compiled here once per instruction set, the compiler vectorises them.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let SimdComponents { x, y, z, exponent, amplitude } = self.model;
        let k = x.len();
        let (x, y, z) = (&x[..k], &y[..k], &z[..k]);
        let (exponent, amplitude) = (&exponent[..k], &amplitude[..k]);
        let (mass, rest) = self.sums.split_at_mut(k);
        let (sx, rest) = rest.split_at_mut(k);
        let (sy, rest) = rest.split_at_mut(k);
        let (sz, rest) = rest.split_at_mut(k);
        let (scatter, squared) = rest.split_at_mut(k);
        let (scatter, squared) = (&mut scatter[..k], &mut squared[..k]);
        let mut row = vec![0.0f32; k];
        let row = &mut row[..k];
        let mut likelihood = 0.0;
        for (&[px, py, pz], &weight) in self.points.iter().zip(self.weights) {
            for i in 0..k {
                let (dx, dy, dz) = (px - x[i], py - y[i], pz - z[i]);
                let d2 = dx.mul_add(dx, dy.mul_add(dy, dz * dz));
                row[i] = amplitude[i] * fast::exp_neg(exponent[i] * d2);
            }
            let sum = 1.0 + row.iter().map(|&a| f64::from(a)).sum::<f64>();
            likelihood += weight * sum.ln();
            let factor = (weight / sum) as f32;
            for i in 0..k {
                let a = row[i] * factor;
                let (dx, dy, dz) = (px - x[i], py - y[i], pz - z[i]);
                mass[i] += a;
                sx[i] = a.mul_add(dx, sx[i]);
                sy[i] = a.mul_add(dy, sy[i]);
                sz[i] = a.mul_add(dz, sz[i]);
                scatter[i] = a.mul_add(dx.mul_add(dx, dy.mul_add(dy, dz * dz)), scatter[i]);
                squared[i] = (a * WEIGHT_SCALE).mul_add(a * WEIGHT_SCALE, squared[i]);
            }
        }
        likelihood
    }
}
