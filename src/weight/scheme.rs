//! The closed, serialisable catalogue of kernels.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::kernel::{
    Cauchy, Gaussian, GemanMcClure, Laplacian, StudentT, TruncatedQuadratic, Tukey, Uniform,
    WeightKernel,
};
use crate::error::{Error, Result};

/// The named kernels; see [`super`] for their formulas.
///
/// Written `gaussian`, `laplacian`, `cauchy`, `geman-mcclure`, `truncated`,
/// `student-t:NU`, `tukey`, `uniform`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum WeightScheme {
    /// [`Gaussian`], the paper's kernel.
    #[default]
    Gaussian,
    /// [`Laplacian`].
    Laplacian,
    /// [`Cauchy`].
    Cauchy,
    /// [`GemanMcClure`].
    GemanMcClure,
    /// [`TruncatedQuadratic`].
    TruncatedQuadratic,
    /// [`StudentT`] with its degrees of freedom ν in (0, 1000].
    StudentT(f32),
    /// [`Tukey`].
    Tukey,
    /// [`Uniform`].
    Uniform,
    /// A function without a name that was passed beside the configuration; the configuration only
    /// records that there was one.
    Custom,
}

/// An operation on a kernel whose type is known only at run time.
pub trait KernelVisitor {
    /// The result of the operation.
    type Output;
    /// Performs the operation.
    fn visit<K: WeightKernel>(self, kernel: K) -> Self::Output;
}

impl WeightScheme {
    /// Default degrees of freedom of `student-t`.
    pub const DEFAULT_NU: f32 = 5.0;

    /// Every kernel, Student's t with its default degrees of freedom.
    pub const ALL: [WeightScheme; 8] = [
        WeightScheme::Gaussian,
        WeightScheme::Laplacian,
        WeightScheme::Cauchy,
        WeightScheme::GemanMcClure,
        WeightScheme::TruncatedQuadratic,
        WeightScheme::StudentT(Self::DEFAULT_NU),
        WeightScheme::Tukey,
        WeightScheme::Uniform,
    ];

    /// Names accepted by `--weights`.
    pub const NAMES: [&'static str; 8] = [
        "gaussian",
        "laplacian",
        "cauchy",
        "geman-mcclure",
        "truncated",
        "student-t:NU",
        "tukey",
        "uniform",
    ];

    /// Passes the kernel with squared bandwidth `beta` to `visitor`: one `match`, outside every
    /// loop.
    ///
    /// # Errors
    /// The errors of [`check_beta`]; [`Error::Config`] for a ν outside (0, 1000], and for
    /// [`Custom`](WeightScheme::Custom), which is no kernel.
    #[inline(always)]
    pub fn visit<V: KernelVisitor>(self, beta: f64, visitor: V) -> Result<V::Output> {
        check_beta(beta)?;
        let beta = beta as f32;
        Ok(match self {
            WeightScheme::Gaussian => visitor.visit(Gaussian { beta }),
            WeightScheme::Laplacian => visitor.visit(Laplacian { beta }),
            WeightScheme::Cauchy => visitor.visit(Cauchy { beta }),
            WeightScheme::GemanMcClure => visitor.visit(GemanMcClure { beta }),
            WeightScheme::TruncatedQuadratic => visitor.visit(TruncatedQuadratic { beta }),
            WeightScheme::StudentT(nu) => visitor.visit(StudentT { beta, nu: checked_nu(nu)? }),
            WeightScheme::Tukey => visitor.visit(Tukey { beta }),
            WeightScheme::Uniform => visitor.visit(Uniform),
            WeightScheme::Custom => return Err(custom()),
        })
    }

    /// Computes the weight of one connection; loops should use [`visit`](Self::visit).
    ///
    /// # Errors
    /// The errors of [`visit`](Self::visit).
    pub fn weight(self, beta: f64, d2: f32) -> Result<f32> {
        struct At(f32);
        impl KernelVisitor for At {
            type Output = f32;
            fn visit<K: WeightKernel>(self, kernel: K) -> f32 {
                kernel.weight(self.0)
            }
        }
        self.visit(beta, At(d2))
    }
}

/// Refuses bandwidths for which weights cannot be computed in f32.
///
/// # Errors
/// [`Error::Config`] unless `beta` is in `[1e-12, 1e12]`.
pub fn check_beta(beta: f64) -> Result<()> {
    if (1e-12..=1e12).contains(&beta) {
        return Ok(());
    }
    Err(Error::config("beta", beta, "must be between 1e-12 and 1e12 (squared descriptor units)"))
}

fn custom() -> Error {
    let rule = "records a user function and cannot be loaded; pass the function again";
    Error::config("weights", "custom", rule)
}

fn checked_nu(nu: f32) -> Result<f32> {
    if nu > 0.0 && nu <= 1000.0 {
        return Ok(nu);
    }
    Err(Error::config("weights", format!("student-t:{nu}"), "NU must be in (0, 1000]"))
}

impl fmt::Display for WeightScheme {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            WeightScheme::Gaussian => "gaussian",
            WeightScheme::Laplacian => "laplacian",
            WeightScheme::Cauchy => "cauchy",
            WeightScheme::GemanMcClure => "geman-mcclure",
            WeightScheme::TruncatedQuadratic => "truncated",
            WeightScheme::StudentT(nu) => return write!(f, "student-t:{nu}"),
            WeightScheme::Tukey => "tukey",
            WeightScheme::Uniform => "uniform",
            WeightScheme::Custom => "custom",
        })
    }
}

impl FromStr for WeightScheme {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Ok(match text {
            "gaussian" => WeightScheme::Gaussian,
            "laplacian" => WeightScheme::Laplacian,
            "cauchy" => WeightScheme::Cauchy,
            "geman-mcclure" => WeightScheme::GemanMcClure,
            "truncated" => WeightScheme::TruncatedQuadratic,
            "student-t" => WeightScheme::StudentT(Self::DEFAULT_NU),
            "tukey" => WeightScheme::Tukey,
            "uniform" => WeightScheme::Uniform,
            "custom" => return Err(custom()),
            _ => {
                let nu = text.strip_prefix("student-t:").and_then(|nu| nu.parse().ok());
                let Some(nu) = nu else {
                    let rule = format!("must be one of {}", Self::NAMES.join(", "));
                    return Err(Error::config("weights", text, rule));
                };
                WeightScheme::StudentT(checked_nu(nu)?)
            }
        })
    }
}

impl From<WeightScheme> for String {
    fn from(scheme: WeightScheme) -> Self {
        scheme.to_string()
    }
}

impl TryFrom<String> for WeightScheme {
    type Error = Error;
    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all() -> impl Iterator<Item = WeightScheme> {
        WeightScheme::ALL.into_iter().chain([1.0, 3.0, 50.0].map(WeightScheme::StudentT))
    }

    /// The losses of the table in `kernel`, as functions of r.
    fn loss(scheme: WeightScheme, beta: f64, r: f64) -> f64 {
        let x = r * r / beta;
        match scheme {
            WeightScheme::Gaussian => beta / 2.0 * (1.0 - (-x).exp()),
            WeightScheme::Laplacian => beta * (1.0 - (1.0 + x.sqrt()) * (-x.sqrt()).exp()),
            WeightScheme::Cauchy | WeightScheme::StudentT(1.0) => beta / 2.0 * (1.0 + x).ln(),
            WeightScheme::GemanMcClure => beta / 2.0 * x / (1.0 + x),
            WeightScheme::TruncatedQuadratic => beta / 2.0 * x.min(1.0),
            WeightScheme::StudentT(nu) => {
                let nu = f64::from(nu);
                let tail = (1.0 + x / nu).powf(-(nu - 1.0) / 2.0);
                beta * nu / (nu - 1.0) * (1.0 - tail)
            }
            WeightScheme::Tukey => beta / 6.0 * (1.0 - (1.0 - x.min(1.0)).powi(3)),
            WeightScheme::Uniform => beta / 2.0 * x,
            WeightScheme::Custom => unreachable!("is no kernel"),
        }
    }

    proptest! {
        #[test]
        fn weights_are_the_losses_derivative_over_r(beta in 0.1..1e4f64, x in 0.01..4.0f64) {
            prop_assume!((x - 1.0).abs() > 1e-3); // the truncated ones have a kink at 1
            let r = (x * beta).sqrt();
            for scheme in all() {
                let h = 1e-5 * r;
                let slope = (loss(scheme, beta, r + h) - loss(scheme, beta, r - h)) / (2.0 * h);
                let weight = f64::from(scheme.weight(beta, (r * r) as f32).unwrap());
                prop_assert!((weight - slope / r).abs() < 2e-5, "{scheme}: {weight} {}", slope / r);
            }
        }

        #[test]
        fn weights_fall_from_one_towards_zero(beta in 1e-3..1e6f64, a in 0.0..1e5f32, b in 0.0..1e5f32) {
            let (near, far) = (a.min(b), a.max(b));
            for scheme in all() {
                prop_assert_eq!(scheme.weight(beta, 0.0).unwrap(), 1.0);
                let (near, far) = (scheme.weight(beta, near).unwrap(), scheme.weight(beta, far).unwrap());
                prop_assert!(far >= 0.0 && near * (1.0 + 1e-6) >= far, "{scheme}");
            }
        }
    }

    #[test]
    fn names_round_trip() {
        for scheme in all() {
            assert_eq!(scheme.to_string().parse::<WeightScheme>().unwrap(), scheme);
        }
        assert_eq!("student-t".parse::<WeightScheme>().unwrap().to_string(), "student-t:5");
        for name in ["", "gauss", "student-t:0", "student-t:x", "student-t:NaN", "custom"] {
            assert!(matches!(name.parse::<WeightScheme>(), Err(Error::Config { .. })), "{name}");
        }
    }

    #[test]
    fn bandwidths_out_of_range_are_refused() {
        for beta in [0.0, -1.0, 1e-13, 1e13, f64::NAN, f64::INFINITY] {
            assert!(matches!(WeightScheme::Gaussian.weight(beta, 1.0), Err(Error::Config { .. })));
        }
    }
}
