//! Descriptors: the local shape around a point, in the point's own frame.

mod bin;
mod fpfh;
mod pair_features;
mod spfh;

pub use fpfh::{BINS, BLOCK, HistogramScale, fpfh, fpfh_at};
