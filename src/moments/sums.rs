//! [`Moments`]: the sums, and quantities that follow from them alone.

use serde::{Deserialize, Serialize};

use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::math::{self, Mat3, Vec3};

/// Sums over weighted pairs (p, q) about two fixed origins.
///
/// With p̃ = p − [`source_origin`](Self::source_origin) and q̃ likewise: 18 numbers that determine
/// rotation, translation, scale and the residual of *any* pose, for weights of any kind, and Σw²
/// for the effective number of connections.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Moments {
    /// Origin of the source points, near their centroid.
    pub source_origin: Vec3,
    /// Origin of the target points, near their centroid.
    pub target_origin: Vec3,
    /// Σw.
    pub weight: f64,
    /// Σw².
    pub weight_squared: f64,
    /// Σw p̃.
    pub source_sum: Vec3,
    /// Σw q̃.
    pub target_sum: Vec3,
    /// Σw p̃ q̃ᵀ: rows follow the source, columns the target.
    pub cross: Mat3,
    /// Σw |p̃|².
    pub source_squares: f64,
    /// Σw |q̃|².
    pub target_squares: f64,
}

/// [`Moments`] divided by Σw and taken about the weighted means: the input of solvers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Centered {
    /// Weighted mean of the source points, in the source's frame.
    pub source_mean: Vec3,
    /// Weighted mean of the target points, in the target's frame.
    pub target_mean: Vec3,
    /// Weighted cross-covariance Σw (p − p̄)(q − q̄)ᵀ / Σw.
    pub covariance: Mat3,
    /// Weighted variance Σw |p − p̄|² / Σw.
    pub source_variance: f64,
    /// Weighted variance Σw |q − q̄|² / Σw.
    pub target_variance: f64,
}

impl Moments {
    /// Creates sums without a pair, about the given origins.
    pub fn about(source_origin: Vec3, target_origin: Vec3) -> Self {
        Moments { source_origin, target_origin, ..Default::default() }
    }

    /// Adds one pair, `source` and `target` relative to the origins: used for sparse connections,
    /// and the definition of every field.
    pub fn add_pair(&mut self, weight: f64, source: Vec3, target: Vec3) {
        self.weight += weight;
        self.weight_squared += weight * weight;
        self.source_squares += weight * math::dot(source, source);
        self.target_squares += weight * math::dot(target, target);
        for a in 0..3 {
            self.source_sum[a] += weight * source[a];
            self.target_sum[a] += weight * target[a];
            for b in 0..3 {
                self.cross[a][b] += weight * source[a] * target[b];
            }
        }
    }

    /// Adds sums about the same origins.
    pub fn merge(&mut self, other: &Moments) {
        debug_assert_eq!(self.source_origin, other.source_origin);
        debug_assert_eq!(self.target_origin, other.target_origin);
        self.weight += other.weight;
        self.weight_squared += other.weight_squared;
        self.source_squares += other.source_squares;
        self.target_squares += other.target_squares;
        self.source_sum = math::add(self.source_sum, other.source_sum);
        self.target_sum = math::add(self.target_sum, other.target_sum);
        for a in 0..3 {
            self.cross[a] = math::add(self.cross[a], other.cross[a]);
        }
    }

    /// Multiplies every weight by `factor`.
    pub(crate) fn scaled(&self, factor: f64) -> Moments {
        Moments {
            weight: factor * self.weight,
            weight_squared: factor * factor * self.weight_squared,
            source_sum: math::scaled(self.source_sum, factor),
            target_sum: math::scaled(self.target_sum, factor),
            cross: self.cross.map(|row| math::scaled(row, factor)),
            source_squares: factor * self.source_squares,
            target_squares: factor * self.target_squares,
            ..*self
        }
    }

    /// Exchanges source and target.
    pub fn swapped(&self) -> Moments {
        Moments {
            source_origin: self.target_origin,
            target_origin: self.source_origin,
            source_sum: self.target_sum,
            target_sum: self.source_sum,
            cross: math::transpose(&self.cross),
            source_squares: self.target_squares,
            target_squares: self.source_squares,
            ..*self
        }
    }

    /// Returns the effective number of connections (Σw)²/Σw² (Kish): N·M when all weights are
    /// equal, 1 when one outweighs the rest; 0 without weight.
    pub fn effective_connections(&self) -> f64 {
        if self.weight_squared > 0.0 {
            self.weight * self.weight / self.weight_squared
        } else {
            0.0
        }
    }

    /// Returns the weighted residual Σw ‖T(p) − q‖² of any transform (the paper's eq. 3, but with
    /// any weights), without another pass over the pairs. Never negative.
    pub fn residual(&self, transform: &Transform) -> f64 {
        let Transform { rotation, scale, .. } = transform;
        // About the origins the translation is small for any map coordinates.
        let shift = math::sub(transform.apply(self.source_origin), self.target_origin);
        let turned_sum = math::mat_vec(rotation, self.source_sum);
        let turned_cross = math::trace(&math::mat_mul(rotation, &self.cross));
        let squares = scale * scale * self.source_squares
            + self.target_squares
            + self.weight * math::dot(shift, shift);
        let products = scale * math::dot(shift, turned_sum)
            - math::dot(shift, self.target_sum)
            - scale * turned_cross;
        (squares + 2.0 * products).max(0.0)
    }

    /// Computes means and covariances.
    ///
    /// # Errors
    /// [`Error::NonFinite`] when a sum is not finite, [`Error::NoWeight`] when Σw is not
    /// above zero.
    pub fn centered(&self) -> Result<Centered> {
        let sums = [self.weight, self.source_squares, self.target_squares, self.weight_squared];
        let vectors = [self.source_sum, self.target_sum, self.source_origin, self.target_origin];
        let mut all = sums.iter().chain(vectors.as_flattened()).chain(self.cross.as_flattened());
        if let Some(index) = all.position(|value| !value.is_finite()) {
            return Err(Error::NonFinite {
                what: "moments (or the weights in them)".into(),
                index,
            });
        }
        if self.weight <= 0.0 {
            return Err(Error::NO_WEIGHT);
        }
        let mean = |sum: Vec3| math::scaled(sum, 1.0 / self.weight);
        let (source, target) = (mean(self.source_sum), mean(self.target_sum));
        let mean_cross = self.cross.map(mean);
        let variance =
            |squares: f64, mean: Vec3| (squares / self.weight - math::dot(mean, mean)).max(0.0);
        Ok(Centered {
            source_mean: math::add(self.source_origin, source),
            target_mean: math::add(self.target_origin, target),
            covariance: math::mat_sub(&mean_cross, &math::outer(source, target)),
            source_variance: variance(self.source_squares, source),
            target_variance: variance(self.target_squares, target),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_residual_of_any_pose_follows(
            pairs in proptest::collection::vec((0.0..1.0f64, proptest::array::uniform6(-1.0..1.0f64)), 1..20),
            vector in proptest::array::uniform3(-3.0..3.0f64),
            translation in proptest::array::uniform3(-3.0..3.0f64),
            scale in 0.3..3.0f64,
        ) {
            let transform = Transform { translation, scale, ..Transform::from_rotation_vector(vector) };
            let (origin_p, origin_q) = ([0.5, -2.0, 1.0], [3.0, 0.25, -1.5]);
            let mut moments = Moments::about(origin_p, origin_q);
            let mut want = 0.0;
            for (weight, x) in pairs {
                let (p, q) = ([x[0], x[1], x[2]], [x[3], x[4], x[5]]);
                moments.add_pair(weight, p, q);
                let moved = transform.apply(math::add(origin_p, p));
                let rest = math::sub(moved, math::add(origin_q, q));
                want += weight * math::dot(rest, rest);
            }
            prop_assert!((moments.residual(&transform) - want).abs() <= 1e-12 * (1.0 + want) * 100.0);
        }
    }

    #[test]
    fn what_cannot_be_centred_says_so() {
        assert!(matches!(Moments::default().centered(), Err(Error::NoWeight { .. })));
        let nan = Moments { weight: 1.0, source_squares: f64::NAN, ..Default::default() };
        assert!(matches!(nan.centered(), Err(Error::NonFinite { index: 1, .. })));
        assert_eq!(Moments::default().effective_connections(), 0.0);
    }
}
