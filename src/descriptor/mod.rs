//! Descriptors: the local shape around a point, in the point's own frame.

mod bin;
mod fpfh;
mod layout;
mod pair_features;
mod prepared;
mod spfh;

pub use fpfh::{HistogramScale, fpfh, fpfh_at};
pub(crate) use layout::mirrored_rows;
pub use layout::{BINS, BLOCK};
pub use prepared::{Descriptor, Fpfh, PreparedCloud};
