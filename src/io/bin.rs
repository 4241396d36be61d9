//! Points as f32 without a header: x, y, z and intensity, as in KITTI; in `.pcd.bin` also a ring,
//! as in nuScenes.

use std::path::Path;

use super::columns::{ColumnMap, Vertex};
use super::content_error::ContentError;
use super::scalar::Scalar;
use super::table::PointTable;

/// The largest coordinate that is plausible: bytes of another format give numbers of any size.
/// Chosen by hand.
const MAX_COORDINATE: f64 = 1e6;

/// Returns the names of the columns, by the name of the file.
pub(super) fn names(path: &Path) -> &'static [&'static str] {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    match name.ends_with(".pcd.bin") {
        true => &["x", "y", "z", "intensity", "ring"],
        false => &["x", "y", "z", "intensity"],
    }
}

/// Reads rows of four or five f32, little endian.
pub(super) fn parse(content: &[u8], path: &Path) -> Result<PointTable, ContentError> {
    let names = names(path);
    let stride = 4 * names.len();
    if !content.len().is_multiple_of(stride) {
        let size = content.len();
        return Err(ContentError::new(format!(
            "has {size} bytes, which are no multiple of {stride}: {} as f32 are read from .bin \
             without a header, and 5 numbers a point from .pcd.bin; write other rows as NPY",
            names.join(" ")
        )));
    }
    let columns = ColumnMap::from_names(names.iter().copied().map(Some));
    let columns = columns.map_err(ContentError::new)?;
    let mut table = PointTable::single_precision(content.len() / stride, &columns);
    let mut vertex = Vertex::default();
    for (index, row) in content.chunks_exact(stride).enumerate() {
        columns.fill(&mut vertex, |column| Scalar::F32.read(&row[4 * column..], false));
        let is_far = |x: &&f64| x.is_finite() && x.abs() > MAX_COORDINATE;
        if let Some(value) = vertex.place.iter().find(is_far) {
            let what = format!(
                "point {index} has the coordinate {value:e}, which no LiDAR sweep has: {} as f32 \
                 are read from .bin; name a file of another format by its own extension",
                names.join(" ")
            );
            return Err(ContentError::byte(index * stride, what));
        }
        table.push(&vertex).map_err(|what| ContentError::byte(index * stride, what))?;
    }
    Ok(table)
}
