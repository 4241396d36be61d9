//! The full connection between two clouds with descriptors, and its moments.

use super::dense::{self, inverse_factors, nearest_descriptors, row_sums};
use super::pruned;
use super::side::{ConnectionSide, FeatureView, PointWeights};
use super::sums::Moments;
use super::tile::{Scaling, joint_mean};
use crate::error::{Error, Result};
use crate::weight::{Bandwidth, KernelVisitor, Normalization, WeightKernel, WeightScheme};

/// Every source point connected with every target point (the paper's fig. 1), ready to be weighted
/// with any kernel, any number of times.
///
/// From 8 columns on, squared distances are |a|² + |b|² − 2 a·b in f32 about the mean of all
/// descriptors. Their error is some 1e-7 (|a|² + |b|²), also between equal rows, where it may be up
/// to 2e-4 for FPFH on PCL's scale. With fewer columns they are sums of squared differences.
///
/// ```
/// use cfreg::{Descriptors, moments::{FeatureView, FullConnection}, weight::Normalization};
/// let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let descriptors = Descriptors::new(1, vec![0.0, 5.0, 9.0])?;
/// let side = FeatureView { points: &points, origin: [0.0; 3], descriptors: &descriptors };
/// let connection = FullConnection::new(side, side)?;
/// // A closure is a weight.
/// let moments = connection.moments(&|d2: f32| (-d2).exp(), Normalization::None)?;
/// assert!((moments.weight - 3.0).abs() < 1e-6);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub struct FullConnection {
    pub(super) source: ConnectionSide,
    pub(super) target: ConnectionSide,
}

/// Minimum automatic bandwidth, in variances of the descriptors: below, rounding would decide.
const MIN_BANDWIDTH_SHARE: f64 = 1e-3;
/// Absolute minimum of the bandwidth, for descriptors that do not differ. Chosen by hand.
const MIN_BANDWIDTH: f64 = 1e-12;

impl FullConnection {
    /// Connects all points of `source` with all points of `target`.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] for an empty side, [`Error::Shape`] when a side does not have one
    /// descriptor a point or the dimensions differ, [`Error::NonFinite`] for descriptors too large
    /// for f32 distances.
    pub fn new(source: FeatureView<'_>, target: FeatureView<'_>) -> Result<Self> {
        let (from, to) = (source.descriptors.dim(), target.descriptors.dim());
        if from != to {
            let what = "dimension of the target's descriptors, against the source's".into();
            return Err(Error::Shape { what, expected: from, found: to });
        }
        let mean = joint_mean(source.descriptors, target.descriptors);
        Ok(FullConnection {
            source: ConnectionSide::new(&source, &mean, "source")?,
            target: ConnectionSide::new(&target, &mean, "target")?,
        })
    }

    /// Sets the weights of the points: the weight of a pair becomes aᵢ bⱼ wᵢⱼ, with wᵢⱼ as without
    /// point weights, normalised if requested. Without normalisation a weight of 2 is equivalent to
    /// having the point twice, and 0 to leaving it out. `None`: all have the same weight.
    ///
    /// Point weights apply to all moments, not to [`source_sums`](Self::source_sums),
    /// [`target_sums`](Self::target_sums) and nearest descriptors. With point weights
    /// [`pruned_moments`](Self::pruned_moments) leaves nothing out.
    ///
    /// # Errors
    /// [`Error::Shape`] unless there is one weight a point, [`Error::NonFinite`] and
    /// [`Error::Config`] for a weight that is not finite or below 0.
    pub fn with_point_weights(
        mut self,
        source: Option<&[f32]>,
        target: Option<&[f32]>,
    ) -> Result<Self> {
        let made = |side: &ConnectionSide, weights: Option<&[f32]>, name| {
            weights.map(|weights| PointWeights::new(weights, side.rows.len(), name)).transpose()
        };
        self.source.weights = made(&self.source, source, "source")?;
        self.target.weights = made(&self.target, target, "target")?;
        Ok(self)
    }

    fn has_point_weights(&self) -> bool {
        self.source.weights.is_some() || self.target.weights.is_some()
    }

    /// Returns the number of connections N·M.
    pub fn pairs(&self) -> u64 {
        self.source.rows.len() as u64 * self.target.rows.len() as u64
    }

    /// Computes the moments of the connections, weighted by `kernel` and normalised.
    ///
    /// One pass over the N·M pairs, two for `source` and `target`, three for `both`,
    /// 2n + 1 for `sinkhorn:n`.
    ///
    /// # Errors
    /// [`Error::NonFinite`] when `kernel` returns NaN or infinity, [`Error::NoWeight`] when
    /// all weights vanish.
    pub fn moments<K: WeightKernel>(
        &self,
        kernel: &K,
        normalization: Normalization,
    ) -> Result<Moments> {
        let FullConnection { source, target } = self;
        let moments = match normalization {
            Normalization::None => dense::weigh(source, target, kernel, Scaling::None),
            Normalization::Source => {
                let u = inverse_factors(&self.source_sums(kernel), 1.0);
                dense::weigh(source, target, kernel, Scaling::Source(&u))
            }
            Normalization::Target => {
                let v = inverse_factors(&self.target_sums(kernel), 1.0);
                dense::weigh(source, target, kernel, Scaling::Target(&v))
            }
            Normalization::Both => {
                let u = inverse_factors(&self.source_sums(kernel), 1.0);
                let v = inverse_factors(&self.target_sums(kernel), 1.0);
                dense::weigh(source, target, kernel, Scaling::Dual(&u, &v))
            }
            Normalization::Sinkhorn(rounds) => {
                let (u, v) = self.sinkhorn(kernel, rounds);
                dense::weigh(source, target, kernel, Scaling::Product(&u, &v))
            }
        };
        moments.centered()?;
        Ok(moments)
    }

    /// Computes [`moments`](Self::moments) with a kernel of the catalogue at bandwidth `beta`.
    ///
    /// # Errors
    /// The errors of [`moments`](Self::moments), and [`Error::Config`] for a `beta` or ν out of
    /// range.
    pub fn scheme_moments(
        &self,
        scheme: WeightScheme,
        beta: f64,
        normalization: Normalization,
    ) -> Result<Moments> {
        struct MomentsVisitor<'a>(&'a FullConnection, Normalization);
        impl KernelVisitor for MomentsVisitor<'_> {
            type Output = Result<Moments>;
            fn visit<K: WeightKernel>(self, kernel: K) -> Result<Moments> {
                self.0.moments(&kernel, self.1)
            }
        }
        scheme.visit(beta, MomentsVisitor(self, normalization))?
    }

    /// Computes [`scheme_moments`](Self::scheme_moments) within a tolerance ε in [0, 1), in less
    /// time: connections whose weights provably do not matter are left out.
    ///
    /// With w the normalised weights of all connections and w̃ the weights of the result, 0 where
    /// left out, Σ|w̃ − w| ≤ ε Σw. Without normalisation this is the share of Σw left out. So the
    /// error of Σw is at most ε Σw, of Σw p̃ ε Σw max|p̃|, of the cross moment ε Σw max|p̃|
    /// max|q̃|, of any sum Σw f ε Σw max|f|. Rounding to f32 is added, as without a tolerance. The
    /// result is the dense one, bit for bit, for a tolerance of 0, for fewer than 5·10⁷
    /// connections, which are as fast dense, and with point weights.
    ///
    /// # Errors
    /// The errors of [`scheme_moments`](Self::scheme_moments), and of [`check_tolerance`].
    pub fn pruned_moments(
        &self,
        scheme: WeightScheme,
        beta: f64,
        normalization: Normalization,
        tolerance: f64,
    ) -> Result<Moments> {
        check_tolerance(tolerance)?;
        if tolerance == 0.0 || self.pairs() < pruned::MIN_CONNECTIONS || self.has_point_weights() {
            return self.scheme_moments(scheme, beta, normalization);
        }
        let (moments, _) =
            self.pruned_moments_with_count(scheme, beta, normalization, tolerance)?;
        moments.centered()?;
        Ok(moments)
    }

    /// Computes moments within a tolerance above 0 for any size, and counts the weights that were
    /// computed. It takes a scheme, because a closure may grow with d².
    pub(super) fn pruned_moments_with_count(
        &self,
        scheme: WeightScheme,
        beta: f64,
        normalization: Normalization,
        tolerance: f64,
    ) -> Result<(Moments, u64)> {
        struct PrunedMomentsVisitor<'a>(&'a FullConnection, Normalization, f64);
        impl KernelVisitor for PrunedMomentsVisitor<'_> {
            type Output = (Moments, u64);
            fn visit<K: WeightKernel>(self, kernel: K) -> (Moments, u64) {
                let PrunedMomentsVisitor(
                    FullConnection { source, target },
                    normalization,
                    tolerance,
                ) = self;
                pruned::moments(source, target, &kernel, normalization, tolerance)
            }
        }
        scheme.visit(beta, PrunedMomentsVisitor(self, normalization, tolerance))
    }

    /// Computes the moments of `w_ij v_j` for given factors v of the target points, for per-target
    /// normalisations that need more than the sums, such as the outlier term of CPD.
    ///
    /// # Errors
    /// [`Error::Shape`] unless there is one factor a target point, and the errors of
    /// [`moments`](Self::moments).
    pub fn moments_with_factors<K: WeightKernel>(
        &self,
        kernel: &K,
        target_factors: &[f32],
    ) -> Result<Moments> {
        let (expected, found) = (self.target.rows.len(), target_factors.len());
        if expected != found {
            return Err(Error::Shape { what: "factors of target points".into(), expected, found });
        }
        let scaling = Scaling::Target(target_factors);
        let moments = dense::weigh(&self.source, &self.target, kernel, scaling);
        moments.centered()?;
        Ok(moments)
    }

    /// Returns Σ_j w_ij of every source point.
    pub fn source_sums<K: WeightKernel>(&self, kernel: &K) -> Vec<f64> {
        row_sums(&self.source, &self.target, kernel, Scaling::None)
    }

    /// Returns Σ_i w_ij of every target point.
    pub fn target_sums<K: WeightKernel>(&self, kernel: &K) -> Vec<f64> {
        row_sums(&self.target, &self.source, kernel, Scaling::None)
    }

    /// Finds for every source point the target point with the most similar descriptor; the lower
    /// index where two are equally near.
    pub fn nearest_targets(&self) -> Vec<u32> {
        let nearest = nearest_descriptors(&self.source, &self.target);
        nearest.into_iter().map(|(_, target)| target).collect()
    }

    /// Finds the pairs (source, target) of mutual nearest neighbours in descriptor space, by source
    /// point.
    pub fn mutual_nearest(&self) -> Vec<(u32, u32)> {
        let (there, back) = (self.nearest_targets(), self.nearest_sources());
        let pairs = there.into_iter().zip(0..).map(|(j, i)| (i, j));
        pairs.filter(|&(i, j)| back[j as usize] == i).collect()
    }

    /// Finds for every target point the source point with the most similar descriptor.
    pub fn nearest_sources(&self) -> Vec<u32> {
        let nearest = nearest_descriptors(&self.target, &self.source);
        nearest.into_iter().map(|(_, source)| source).collect()
    }

    /// Returns the squared bandwidth β that `bandwidth` gives for these clouds; the same if source
    /// and target are exchanged. `auto` costs two passes over the pairs.
    ///
    /// The bandwidth is at least a thousandth of the descriptors' variance: below, the rounding of
    /// distances would decide.
    ///
    /// # Errors
    /// The errors of [`Bandwidth::validate`].
    pub fn bandwidth(&self, bandwidth: Bandwidth) -> Result<f64> {
        bandwidth.validate()?;
        let share = match bandwidth {
            Bandwidth::Fixed(beta) => return Ok(beta),
            Bandwidth::Auto(share) => share,
        };
        let there = nearest_descriptors(&self.source, &self.target);
        let back = nearest_descriptors(&self.target, &self.source);
        let mut least: Vec<f32> = there.iter().chain(&back).map(|&(d2, _)| d2).collect();
        let half = least.len() / 2;
        let (_, &mut median, _) = least.select_nth_unstable_by(half, f32::total_cmp);
        let norms = || self.source.rows.norms().iter().chain(self.target.rows.norms());
        let variance = norms().map(|&norm| f64::from(norm)).sum::<f64>() / least.len() as f64;
        let floor = (MIN_BANDWIDTH_SHARE * variance).max(MIN_BANDWIDTH);
        Ok((share * f64::from(median)).max(floor))
    }

    /// Returns Σ_i aᵢ w_ij of every target point, with the weights aᵢ of the source's points.
    pub(crate) fn point_weighted_target_sums<K: WeightKernel>(&self, kernel: &K) -> Vec<f64> {
        let Some(PointWeights { shares, scale }) = &self.source.weights else {
            return self.target_sums(kernel);
        };
        let scaling = Scaling::Target(shares);
        let sums = row_sums(&self.target, &self.source, kernel, scaling);
        sums.into_iter().map(|sum| scale * sum).collect()
    }

    /// Returns the factors uᵢ and vⱼ after `rounds` of Sinkhorn-Knopp.
    pub(super) fn sinkhorn<K: WeightKernel>(
        &self,
        kernel: &K,
        rounds: u32,
    ) -> (Vec<f32>, Vec<f32>) {
        let (n, m) = (self.source.rows.len(), self.target.rows.len());
        let (mut u, mut v) = (Vec::new(), vec![1.0f32; m]);
        for _ in 0..rounds {
            let sums = row_sums(&self.source, &self.target, kernel, Scaling::Target(&v));
            u = inverse_factors(&sums, 1.0 / n as f64);
            let sums = row_sums(&self.target, &self.source, kernel, Scaling::Target(&u));
            v = inverse_factors(&sums, 1.0 / m as f64);
        }
        (u, v)
    }
}

/// Refuses an invalid tolerance of [`FullConnection::pruned_moments`].
///
/// # Errors
/// [`Error::Config`] unless `tolerance` is in [0, 1).
pub fn check_tolerance(tolerance: f64) -> Result<()> {
    if (0.0..1.0).contains(&tolerance) {
        return Ok(());
    }
    Err(Error::config("tolerance", tolerance, "must be at least 0 and below 1"))
}
