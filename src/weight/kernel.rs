//! Kernels: the weight of a connection as a function of the squared distance d².
//!
//! Each is the weight `w = ρ'(r)/r` of a loss `ρ(r)` at `r = d` (Black and
//! Rangarajan 1996; Barron 2019 for the family), so that solving with it is one
//! step of re-weighted least squares for that loss. With `x = d²/β`:
//!
//! | kernel | w | ρ |
//! |---|---|---|
//! | [`Gaussian`] | `exp(−x)` | `β/2 (1 − exp(−x))` |
//! | [`Laplacian`] | `exp(−√x)` | `β (1 − (1 + √x) exp(−√x))` |
//! | [`Cauchy`] | `1/(1 + x)` | `β/2 ln(1 + x)` |
//! | [`GemanMcClure`] | `1/(1 + x)²` | `β/2 · x/(1 + x)` |
//! | [`TruncatedQuadratic`] | `1` if `x ≤ 1`, else `0` | `β/2 · min(x, 1)` |
//! | [`StudentT`] | `(1 + x/ν)^(−(ν+1)/2)` | `β ν/(ν−1) (1 − (1 + x/ν)^(−(ν−1)/2))` |
//! | [`Tukey`] | `(1 − x)²` if `x ≤ 1`, else `0` | `β/6 (1 − (1 − x)³)`, at most `β/6` |
//! | [`Uniform`] | `1` | `β/2 · x` |

use crate::math::fast;

/// Weight of a connection as a function of its squared descriptor distance.
///
/// Weights must be finite, which [`moments`](crate::moments) checks, and not negative, which is not
/// checked. They are summed and squared in f32: keep the large ones between 1e-25 and 1e8. Any
/// closure is a kernel:
///
/// ```
/// use cfreg::weight::WeightKernel;
/// let step = |squared_distance: f32| if squared_distance < 50.0 { 1.0 } else { 0.1 };
/// assert_eq!(step.weight(60.0), 0.1);
/// ```
pub trait WeightKernel: Sync {
    /// Returns the weight at the squared distance `d2 ≥ 0`.
    fn weight(&self, d2: f32) -> f32;

    /// Replaces every squared distance by its weight. The call is inside a SIMD dispatch: a
    /// `weight` without branches, marked `#[inline(always)]`, vectorises.
    #[inline(always)]
    fn fill(&self, d2: &mut [f32]) {
        for value in d2 {
            *value = self.weight(*value);
        }
    }

    /// Returns whether passes call [`fill_tile`](Self::fill_tile), with many rows at once: for
    /// kernels with expensive calls, such as one in another language.
    #[inline(always)]
    fn takes_tiles(&self) -> bool {
        false
    }

    /// Applies [`fill`](Self::fill) to rows of `width` squared distances, one source point each.
    fn fill_tile(&self, d2: &mut [f32], width: usize) {
        d2.chunks_exact_mut(width).for_each(|row| self.fill(row));
    }
}

impl<F: Fn(f32) -> f32 + Sync> WeightKernel for F {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        self(d2)
    }
}

/// `exp(−d²/β)`: the paper's weight (section III-B).
#[derive(Debug, Clone, Copy)]
pub struct Gaussian {
    /// Squared bandwidth β > 0, in squared descriptor units.
    pub beta: f32,
}

impl WeightKernel for Gaussian {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        fast::exp_neg(d2 * (-1.0 / self.beta))
    }
}

/// `exp(−d/√β)`: longer tails than the Gaussian, sharper at zero.
#[derive(Debug, Clone, Copy)]
pub struct Laplacian {
    /// Squared bandwidth β > 0.
    pub beta: f32,
}

impl WeightKernel for Laplacian {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        fast::exp_neg(-(d2 * (1.0 / self.beta)).sqrt())
    }
}

/// `1/(1 + d²/β)`.
#[derive(Debug, Clone, Copy)]
pub struct Cauchy {
    /// Squared bandwidth β > 0: the weight is ½ there.
    pub beta: f32,
}

impl WeightKernel for Cauchy {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        1.0 / (1.0 + d2 * (1.0 / self.beta))
    }
}

/// `1/(1 + d²/β)²`.
#[derive(Debug, Clone, Copy)]
pub struct GemanMcClure {
    /// Squared bandwidth β > 0: the weight is ¼ there.
    pub beta: f32,
}

impl WeightKernel for GemanMcClure {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        let cauchy = Cauchy { beta: self.beta }.weight(d2);
        cauchy * cauchy
    }
}

/// 1 up to `d² = β`, 0 beyond.
#[derive(Debug, Clone, Copy)]
pub struct TruncatedQuadratic {
    /// Largest squared distance of a connection with weight, β > 0.
    pub beta: f32,
}

impl WeightKernel for TruncatedQuadratic {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        if d2 <= self.beta { 1.0 } else { 0.0 }
    }
}

/// `(1 + d²/(νβ))^(−(ν+1)/2)`: Cauchy at ν = 1, towards `exp(−d²/2β)` for large ν.
#[derive(Debug, Clone, Copy)]
pub struct StudentT {
    /// Squared bandwidth β > 0.
    pub beta: f32,
    /// Degrees of freedom ν > 0.
    pub nu: f32,
}

impl WeightKernel for StudentT {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        let base = 1.0 + d2 * (1.0 / (self.nu * self.beta));
        fast::exp_neg(-0.5 * (self.nu + 1.0) * fast::ln(base))
    }
}

/// `(1 − d²/β)²` up to `d² = β`, 0 beyond: Tukey's biweight.
#[derive(Debug, Clone, Copy)]
pub struct Tukey {
    /// Squared distance from which on the weight is 0, β > 0.
    pub beta: f32,
}

impl WeightKernel for Tukey {
    #[inline(always)]
    fn weight(&self, d2: f32) -> f32 {
        let rest = (1.0 - d2 * (1.0 / self.beta)).max(0.0);
        rest * rest
    }
}

/// 1 for every connection: the unweighted problem, which is degenerate according to the paper.
/// Useful as the control of a study.
#[derive(Debug, Clone, Copy)]
pub struct Uniform;

impl WeightKernel for Uniform {
    #[inline(always)]
    fn weight(&self, _d2: f32) -> f32 {
        1.0
    }
}
