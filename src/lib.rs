//! Rigid point-cloud registration without correspondences and without an initial guess.
#![warn(missing_docs)]

pub mod cloud;
pub mod error;
pub mod io;
pub mod math;

pub use cloud::{Descriptors, PointCloud, Transform};
pub use error::{Error, Result};
