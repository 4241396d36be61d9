//! Layout of a descriptor.

/// Bins of one of the three angle histograms.
pub const BLOCK: usize = 11;
/// Bins of a descriptor: the histograms of θ, α and φ one after the other.
pub const BINS: usize = 3 * BLOCK;

/// Sum of a finished block on the scale of PCL.
pub(super) const BLOCK_SUM: f64 = 100.0;

/// Converts the descriptors of points into those of their mirror images: α, the angle to the normal
/// of the plane of line and normal, changes its sign, and so the order of its bins. Values after the
/// first [`BINS`] of a row are unchanged.
///
/// # Panics
/// When rows have fewer than [`BINS`] values.
pub fn mirrored_rows(rows: &[f32], dim: usize) -> Vec<f32> {
    let mut rows = rows.to_vec();
    for row in rows.chunks_exact_mut(dim) {
        row[BLOCK..2 * BLOCK].reverse();
    }
    rows
}
