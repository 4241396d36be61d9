//! Layout of a descriptor.

/// Bins of one of the three angle histograms.
pub const BLOCK: usize = 11;
/// Bins of a descriptor: the histograms of θ, α and φ one after the other.
pub const BINS: usize = 3 * BLOCK;

/// Sum of a finished block on the scale of PCL.
pub(super) const BLOCK_SUM: f64 = 100.0;
