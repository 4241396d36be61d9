//! The narrow waist: everything that a closed form needs from N×M weighted pairs.
//!
//! [`FullConnection`] weights every source point against every target point and returns
//! [`Moments`], in one fused pass over tiles of the distance matrix: tile filler → weight →
//! reducer. W is never stored; memory is O(N + M).
//!
//! Sparse connections, listed pair by pair, go through [`moments_of_pairs`].
//!
//! Precision: the tiles are f32, and every sum over more than one tile is f64. Tiles are cut at
//! fixed positions and merged in order, so the bits do not depend on the number of threads.
//! [`naive`] is the specification: the double loop in f64.

mod connection;
mod dense;
mod entries;
pub mod naive;
mod pairs;
mod pruned;
mod reduce;
mod side;
mod strongest;
mod sums;
mod tile;

pub use connection::{FullConnection, check_tolerance};
pub use entries::Entries;
pub(crate) use pairs::check_indices;
pub use pairs::{WeightedPair, moments_of_pairs};
pub use side::FeatureView;
pub use sums::{Centered, Moments};
