//! Covariance of a pose, and the motions along which it is unconstrained.
//!
//! A pose refined on two surfaces solves g = Σ w J (n·e) = 0 over the surface pairs. As for any
//! such estimator (White 1982) its covariance is A⁻¹ B A⁻ᵀ. B is the scatter of the terms of g,
//! summed first over neighbours, whose errors are correlated. A is the derivative of g by a motion.
//! A is measured by moving the pose and finding the pairs again: nearest points follow a motion,
//! and the surfaces constrain the pose less than Σ w J Jᵀ would suggest.

use std::collections::BTreeMap;

use faer::linalg::solvers::DenseSolveCore;

use serde::{Deserialize, Serialize};

use crate::cloud::Transform;
use crate::math::cholesky::{self, Mat6, Vec6};
use crate::math::{self, Vec3};
use crate::par;
use crate::surface::{SurfacePair, twist_row};

/// A small motion: a turn about the [`center`](PoseCovariance::center), and a shift.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Twist {
    /// Rotation vector, radians.
    pub rotation: Vec3,
    /// Translation, in the target's unit.
    pub translation: Vec3,
}

/// Covariance of a pose that is refined on surfaces.
///
/// With c the [`center`](Self::center), T the pose and p a point, the true pose is p ↦ exp(ω)(T p −
/// c) + c + τ; the matrix is that of (ω, τ).
///
/// It knows of noise and of errors that go together among neighbours, not of a scan that is
/// warped as a whole, which agrees with itself and no other frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PoseCovariance {
    /// Rows of six: rotation vector (radians), then translation (the target's unit).
    pub matrix: Mat6,
    /// Centre of rotation, in the target's frame: the mean of the points where the surfaces
    /// overlap.
    pub center: Vec3,
    /// Motions along which the surfaces slide on each other, |ω|² + |τ|²/r² = 1 with r the root
    /// mean square distance of the points from the center. The variance of the matrix along them is
    /// 1 (and r²), in place of infinity.
    #[serde(rename = "undetermined")]
    pub unobservable: Vec<Twist>,
}

/// Fewest pairs for a covariance. Chosen by hand.
const MIN_PAIRS: usize = 10;
/// Side of the cubes within which errors are taken as correlated, in spacings. Chosen by hand.
const CORRELATION_LENGTH: f64 = 8.0;
/// Share of the curvature along a motion that the normals of both surfaces must agree on: the rest
/// is noise of the normals, which constrains nothing. Chosen by hand.
const NORMAL_AGREEMENT: f64 = 0.5;
/// Step of the finite differences, in spacings, and number of points for them. Chosen by hand.
const DIFFERENCE_STEP: f64 = 0.2;
const MAX_DIFFERENCE_POINTS: usize = 1000;
/// Standard deviation below which a sampled surface is never known, in spacings. Without any noise
/// the remaining errors are those of the two samplings, and no residual shows them. Slopes are not
/// known better than this either, and a motion that moves points along their surface except for
/// smaller slopes is unconstrained: in clouds that are flat, or copies of each other, both normals
/// have the same error. Chosen by hand.
const SAMPLING_STD: f64 = 0.004;

impl PoseCovariance {
    /// Estimates the covariance of a `pose` that is refined on two surfaces.
    ///
    /// `contacts` returns the surface pairs under a pose, of at most the given number of source
    /// points spread evenly; their points are about a local origin that `origin` brings into the
    /// target's frame. `spacing` is that of the points.
    ///
    /// `None` for fewer than ten surface pairs and if all pairs are at one position.
    pub fn estimate(
        contacts: impl Fn(&Transform, usize) -> Vec<SurfacePair> + Sync,
        pose: &Transform,
        origin: Vec3,
        spacing: f64,
    ) -> Option<PoseCovariance> {
        let all = contacts(pose, usize::MAX);
        let frame = NormalizedFrame::from_pairs(&all)?;
        let sums = PairSums::new(&all, &frame, CORRELATION_LENGTH * spacing);
        let (values, motions) = symmetric_eigen(&sums.curvature)?;
        let scatter = sums.scatter(&motions);
        let answer =
            frame.finite_difference_hessian(&contacts, pose, &motions, DIFFERENCE_STEP * spacing);
        let known = spacing / frame.radius;
        let slope = |k: usize| (values[k] / frame.squared_displacement(&all, &motions[k])).sqrt();
        let holds = |&k: &usize| {
            let agreed = dot(&motions[k], &sums.agreed.map(|row| dot(&motions[k], &row)));
            agreed > NORMAL_AGREEMENT * values[k]
                && slope(k) > SAMPLING_STD
                && answer[k][k] > 0.0
                && scatter[k][k].sqrt() < known * answer[k][k]
        };
        let held: Vec<usize> = (0..6).filter(holds).collect();
        let own = covariance_of_motions(&held, &answer, &scatter, SAMPLING_STD * known);
        let matrix = frame.covariance(&own, &motions);
        // Rounding must not give NaN.
        cholesky::factor(&matrix)?;
        Some(PoseCovariance {
            matrix,
            center: math::add(frame.center, origin),
            unobservable: (0..6).filter(|k| !holds(k)).map(|k| frame.twist(&motions[k])).collect(),
        })
    }

    /// Returns the information matrix: the inverse of the covariance, but 0 along unconstrained
    /// motions.
    ///
    /// `None` for a matrix that is not positive definite.
    pub fn information(&self) -> Option<Mat6> {
        let factor = cholesky::factor(&self.matrix)?;
        let mut information = [[0.0; 6]; 6];
        for (k, row) in information.iter_mut().enumerate() {
            let unit: Vec6 = std::array::from_fn(|i| f64::from(u8::from(i == k)));
            *row = cholesky::solve(&factor, &unit);
        }
        // Along an unconstrained motion v, which is not correlated with others, the matrix is v vᵀ:
        // its inverse has u uᵀ with u the inverse times v.
        let full = information;
        for Twist { rotation: [a, b, c], translation: [x, y, z] } in &self.unobservable {
            let motion = [a, b, c, x, y, z];
            let along = full.map(|row| row.iter().zip(motion).map(|(i, v)| i * v).sum::<f64>());
            for i in 0..6 {
                (0..6).for_each(|j| information[i][j] -= along[i] * along[j]);
            }
        }
        // Rounding must not break the symmetry.
        Some(std::array::from_fn(|i| {
            std::array::from_fn(|j| 0.5 * (information[i][j] + information[j][i]))
        }))
    }

    /// Returns the normalised squared error of `pose`, which has this covariance, against the true
    /// pose: eᵀ Σ⁻¹ e, 6 in the mean if the covariance is correct (less for unobservable motions).
    pub fn nees(&self, pose: &Transform, truth: &Transform) -> f64 {
        let off = truth.after(&pose.inverse());
        let [a, b, c] = off.rotation_vector();
        let [x, y, z] = math::sub(off.apply(self.center), self.center);
        let error = [a, b, c, x, y, z];
        let Some(factor) = cholesky::factor(&self.matrix) else { return f64::NAN };
        cholesky::solve(&factor, &error).iter().zip(error).map(|(a, b)| a * b).sum()
    }
}

/// Sums over all surface pairs, in radii.
struct PairSums {
    /// Sum of w J Jᵀ by the mean normals.
    curvature: Mat6,
    /// The same sum by one normal of each surface: the part on which both agree.
    agreed: Mat6,
    /// Cubes within which errors are taken as correlated.
    cubes: BTreeMap<[i64; 3], CorrelationCell>,
}

impl PairSums {
    /// Sums over `contacts`, in cubes of this `side`.
    fn new(contacts: &[SurfacePair], frame: &NormalizedFrame, side: f64) -> PairSums {
        let mut curvature = [[0.0; 6]; 6];
        let mut agreed = [[0.0; 6]; 6];
        let mut cubes: BTreeMap<[i64; 3], CorrelationCell> = BTreeMap::new();
        for contact in contacts {
            let normal = contact.mean_normal();
            let facing =
                |n: Vec3| if math::dot(n, normal) < 0.0 { math::scaled(n, -1.0) } else { n };
            let row = frame.jacobian_row(contact, normal);
            let [own, other] = contact.normals.map(|n| frame.jacobian_row(contact, facing(n)));
            let cube = contact.point.map(|x| (x / side).floor() as i64);
            let cube = cubes.entry(cube).or_default();
            cube.weight += contact.weight;
            for i in 0..6 {
                cube.gradient[i] += frame.weighted_residual(contact) * row[i];
                for j in 0..6 {
                    curvature[i][j] += contact.weight * row[i] * row[j];
                    agreed[i][j] += 0.5 * contact.weight * (own[i] * other[j] + other[i] * own[j]);
                }
            }
        }
        PairSums { curvature, agreed, cubes }
    }

    /// Scatter of the gradients of the cubes along `motions`.
    fn scatter(&self, motions: &[Vec6; 6]) -> Mat6 {
        let mut scatter = [[0.0; 6]; 6];
        let fitted = CorrelationCell::degrees_of_freedom_correction(self.cubes.values());
        for cube in self.cubes.values() {
            let pull = motions.map(|motion| dot(&motion, &cube.gradient));
            (0..6).for_each(|i| (0..6).for_each(|j| scatter[i][j] += fitted * pull[i] * pull[j]));
        }
        scatter
    }
}

/// Surface pairs whose errors are taken as correlated.
#[derive(Default)]
struct CorrelationCell {
    weight: f64,
    gradient: Vec6,
}

impl CorrelationCell {
    /// Factor by which the scatter of the cubes is too small after a fit of six unknowns to them: n
    /// / (n − 6), at most 2, for n the number of equivalent cubes of one weight.
    fn degrees_of_freedom_correction<'a>(cubes: impl Iterator<Item = &'a CorrelationCell>) -> f64 {
        let sums = |(sum, squares): (f64, f64), cube: &CorrelationCell| {
            (sum + cube.weight, squares + cube.weight * cube.weight)
        };
        let (sum, squares) = cubes.fold((0.0, 0.0), sums);
        let n = sum * sum / squares;
        if n > 12.0 { n / (n - 6.0) } else { 2.0 }
    }
}

/// Centre of the motions, and the length at which rotations and translations weigh equally.
struct NormalizedFrame {
    center: Vec3,
    radius: f64,
    /// Sum over all surface pairs.
    weight: f64,
}

impl NormalizedFrame {
    fn from_pairs(contacts: &[SurfacePair]) -> Option<NormalizedFrame> {
        let weight: f64 = contacts.iter().map(|contact| contact.weight).sum();
        if contacts.len() < MIN_PAIRS || weight.is_nan() || weight <= 0.0 {
            return None;
        }
        let part = |contact: &SurfacePair| contact.weight / weight;
        let center =
            contacts.iter().fold([0.0; 3], |sum, c| math::add(sum, math::scaled(c.point, part(c))));
        let square = |contact: &SurfacePair| {
            let arm = math::sub(contact.point, center);
            part(contact) * math::dot(arm, arm)
        };
        let radius = contacts.iter().map(square).sum::<f64>().sqrt();
        (radius > 0.0).then_some(NormalizedFrame { center, radius, weight })
    }

    /// Derivative of the distance along `normal` by a motion, in radii.
    fn jacobian_row(&self, contact: &SurfacePair, normal: Vec3) -> Vec6 {
        let arm = math::scaled(math::sub(contact.point, self.center), 1.0 / self.radius);
        twist_row(arm, normal, 1.0)
    }

    /// Weighted distance along the normal, in radii.
    fn weighted_residual(&self, contact: &SurfacePair) -> f64 {
        contact.weight * math::dot(contact.mean_normal(), contact.residual) / self.radius
    }

    /// Sum of the squared displacements of the surface pairs by a motion, in radii.
    fn squared_displacement(&self, contacts: &[SurfacePair], &[a, b, c, x, y, z]: &Vec6) -> f64 {
        let square = |contact: &SurfacePair| {
            let arm = math::scaled(math::sub(contact.point, self.center), 1.0 / self.radius);
            let way = math::add(math::cross([a, b, c], arm), [x, y, z]);
            contact.weight * math::dot(way, way)
        };
        contacts.iter().map(square).sum()
    }

    /// Covariance of rotation vector and translation by that of the `motions`, in units of the
    /// target; rounding does not break its symmetry.
    fn covariance(&self, own: &Mat6, motions: &[Vec6; 6]) -> Mat6 {
        let unit = |i: usize| if i < 3 { 1.0 } else { self.radius };
        let entry = |i: usize, j: usize| -> f64 {
            let row = |k: usize| (0..6).map(|l| own[k][l] * motions[l][j]).sum::<f64>();
            unit(i) * unit(j) * (0..6).map(|k| motions[k][i] * row(k)).sum::<f64>()
        };
        let matrix: Mat6 = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (matrix[i][j] + matrix[j][i])))
    }

    fn twist(&self, &[a, b, c, x, y, z]: &Vec6) -> Twist {
        Twist { rotation: [a, b, c], translation: math::scaled([x, y, z], self.radius) }
    }

    /// Change of the gradient along each of `motions` (rows) by a step along each (columns), with
    /// the pairs found again.
    fn finite_difference_hessian(
        &self,
        contacts: &(impl Fn(&Transform, usize) -> Vec<SurfacePair> + Sync),
        pose: &Transform,
        motions: &[Vec6; 6],
        length: f64,
    ) -> Mat6 {
        let step = length / self.radius;
        let pull = |motion: Vec6| -> Vec6 {
            let Twist { rotation, translation } = self.twist(&motion);
            let turn = Transform::from_rotation_vector(rotation);
            let center = math::add(self.center, translation);
            let shift = math::sub(center, turn.rotate(self.center));
            let moved = Transform { translation: shift, ..turn }.after(pose);
            let mut sum = [0.0; 6];
            for contact in contacts(&moved, MAX_DIFFERENCE_POINTS) {
                let row = self.jacobian_row(&contact, contact.mean_normal());
                let off = self.weighted_residual(&contact);
                (0..6).for_each(|i| sum[i] += off * row[i]);
            }
            motions.map(|motion| (0..6).map(|i| motion[i] * sum[i]).sum())
        };
        let steps = par::map(
            12,
            || (),
            |_, k| {
                let sign = if k % 2 == 0 { step } else { -step };
                pull(motions[k / 2].map(|x| sign * x))
            },
        );
        let probed: f64 =
            contacts(pose, MAX_DIFFERENCE_POINTS).iter().map(|contact| contact.weight).sum();
        let share = probed / self.weight;
        std::array::from_fn(|k| {
            std::array::from_fn(|l| (steps[2 * l][k] - steps[2 * l + 1][k]) / (2.0 * step * share))
        })
    }
}

/// Covariance in the frame of the motions: A⁻¹ B A⁻ᵀ among those that are `held`, of a standard
/// deviation of at least `sampling_std`, and 1 along the others.
fn covariance_of_motions(held: &[usize], a: &Mat6, b: &Mat6, sampling_std: f64) -> Mat6 {
    let of_held = |m: &Mat6| faer::Mat::from_fn(held.len(), held.len(), |i, j| m[held[i]][held[j]]);
    let inverse = of_held(a).partial_piv_lu().inverse();
    let spread = &inverse * of_held(b) * inverse.transpose();
    let mut own = [[0.0; 6]; 6];
    (0..6).for_each(|k| own[k][k] = 1.0);
    for (i, &k) in held.iter().enumerate() {
        for (j, &l) in held.iter().enumerate() {
            own[k][l] = spread[(i, j)] + if k == l { sampling_std.powi(2) } else { 0.0 };
        }
    }
    own
}

fn dot(a: &Vec6, b: &Vec6) -> f64 {
    (0..6).map(|i| a[i] * b[i]).sum()
}

/// Returns the eigenvalues, ascending, and unit eigenvectors as rows.
fn symmetric_eigen(matrix: &Mat6) -> Option<(Vec6, [Vec6; 6])> {
    let matrix = faer::Mat::from_fn(6, 6, |i, j| matrix[i][j]);
    let eigen = matrix.self_adjoint_eigen(faer::Side::Lower).ok()?;
    let values = std::array::from_fn(|k| eigen.S().column_vector()[k]);
    Some((values, std::array::from_fn(|k| std::array::from_fn(|i| eigen.U()[(i, k)]))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_known_along_what_is_undetermined() {
        // A plane of radius 3: two translations and a rotation slide.
        let radius: f64 = 3.0;
        let slides = [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.6, 0.8, 0.0]];
        let mut matrix = [[0.0; 6]; 6];
        let held: [Vec6; 4] = [
            [1.0, 0.5, 0.0, 0.0, 0.0, 0.2],
            [0.0, 1.0, 0.0, 0.0, 0.0, -0.3],
            [0.0, 0.0, 0.0, 0.8, -0.6, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        ];
        let unit = |i: usize| if i < 3 { 1.0 } else { radius };
        for (vectors, variance) in [(&held[..], 1e-6), (&slides[..], 1.0)] {
            for v in vectors {
                for i in 0..6 {
                    (0..6).for_each(|j| matrix[i][j] += variance * unit(i) * unit(j) * v[i] * v[j]);
                }
            }
        }
        let scaled = |v: Vec6| Twist {
            rotation: [v[0], v[1], v[2]],
            translation: [v[3] * radius, v[4] * radius, v[5] * radius],
        };
        let undetermined = slides.map(scaled).to_vec();
        let known = PoseCovariance { matrix, center: [0.0; 3], unobservable: undetermined };
        let information = known.information().unwrap();
        let times = |a: &Mat6, v: &Vec6| a.map(|row| row.iter().zip(v).map(|(a, v)| a * v).sum());
        for v in slides {
            let of: Vec6 = times(&information, &std::array::from_fn(|i| unit(i) * v[i]));
            assert!(of.iter().all(|x: &f64| x.abs() < 1e-8), "{of:?}");
        }
        for v in held {
            // Along constrained motions it is the inverse.
            let v: Vec6 = std::array::from_fn(|i| unit(i) * v[i]);
            let back: Vec6 = times(&matrix, &times(&information, &v));
            assert!(back.iter().zip(v).all(|(a, b)| (a - b).abs() < 1e-6), "{back:?} {v:?}");
        }
        let full = PoseCovariance { unobservable: Vec::new(), ..known };
        let one = times(&full.information().unwrap(), &times(&matrix, &held[0]));
        assert!(one.iter().zip(held[0]).all(|(a, b)| (a - b).abs() < 1e-6), "{one:?}");
    }
}
