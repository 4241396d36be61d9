//! Registration methods: weights on the full connection, one closed-form solve.
//!
//! Everything that registers implements [`Register`]; what has a name is in the catalogue
//! [`Method`]. An answer is a [`Registration`].

mod catalogue;
mod cf;
mod prepared;
mod registration;

pub use catalogue::Method;
pub use cf::Cf;
pub use prepared::{Describe, Prepared};
pub use registration::{Counts, PointCounts, Registration, Timings};

use crate::cloud::PointCloud;
use crate::error::Result;

/// Something that finds the pose of one cloud in another.
///
/// Object safe, so that batches and chains take any method, also yours.
pub trait Register: Send + Sync {
    /// The pose that maps `source` into the frame of `target`.
    ///
    /// # Errors
    /// When no answer can be computed; an answer that is not to be trusted is `Ok` with
    /// its [`doubts`](Registration::doubts).
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration>;
}
