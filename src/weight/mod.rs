//! Weights of connections: kernels of the squared descriptor distance, and
//! normalisations of the full connection.
//!
//! A [`WeightKernel`] is open: any `Fn(f32) -> f32 + Sync` is one. Configurations, `--weights` and
//! Python use the names of the closed catalogue [`WeightScheme`], and [`Composite`] adds and
//! multiplies its kernels.

mod bandwidth;
mod compatibility;
mod composite;
mod kernel;
mod normalization;
mod scheme;

pub use bandwidth::Bandwidth;
pub use compatibility::{Compatibility, ConnectionEnds, MAX_CONNECTIONS, SecondOrderWeights};
pub use composite::{Composite, ResolvedComposite};
pub use kernel::{
    Cauchy, Gaussian, GemanMcClure, Laplacian, StudentT, TruncatedQuadratic, Tukey, Uniform,
    WeightKernel,
};
pub use normalization::Normalization;
pub use scheme::{KernelVisitor, WeightScheme, check_beta};
