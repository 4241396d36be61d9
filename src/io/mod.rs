//! Clouds and poses in files.
//!
//! [`read`] takes PLY, PCD and text, detected by content; [`read_mesh`] also takes the faces of
//! PLY; [`write()`] goes by the extension. Points with a NaN or infinite coordinate are left out
//! and counted by [`PointCloud::dropped`]; a finite one beyond 1e75 is an error.
//!
//! A column called `weight` holds the weights of the points; every other scalar becomes a channel
//! ([`PointCloud::channels`]) unchanged, rounded to f32. Colours become values from 0 to 1 and are
//! written as whole numbers: `red`, `green`, `blue` and `alpha` in one byte or two of PLY, packed
//! into `rgb` or `rgba` of PCD, and as whole numbers in text, if red, green and blue are all
//! present. A column with a non-finite number at a point that is kept is skipped, as are lists and
//! faces; [`read_with_differences`] reports skipped data.
//!
//! | | holds | changes |
//! |---|---|---|
//! | PLY | colours of 8 and 16 bits | names but letters, digits, `_`, `-`; no viewpoint |
//! | PCD | viewpoints, colours of 8 bits | names but ASCII; no viewpoint at 0 0 0 |
//! | text | colours where red, green and blue are of one depth | no viewpoint; .csv: no digit first |
//!
//! Clouds have no other contents of a file: faces and other elements, lists, comments, the grid of
//! an organised PCD. [`differences()`] lists the data that [`write()`] leaves out or changes.
//!
//! [`read_array`] takes tables of numbers of NPY: descriptors and correspondences from elsewhere.
//!
//! Headers are not trusted: a count or size in a header is checked against the bytes present before
//! memory is taken, and any error is an [`Error::Parse`] with its line or byte. Memory is at most
//! about ten times the file; a compressed PCD that unpacks to more than that and 64 MiB is refused.
//! Time grows with the file. A header, or a line of names, has at most 1 MiB. Pipes are read up to
//! [`MAX_PIPE_BYTES`] bytes; devices are not read.

mod arrays;
mod columns;
mod content_error;
#[cfg(any(feature = "batch", feature = "figures"))]
mod csv_reader;
mod differences;
mod format;
mod layout;
pub(crate) mod limited_file;
mod lines;
mod load;
mod names;
pub(crate) mod outputs;
mod pcd;
mod ply;
mod pose;
mod table;
mod text;

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::cloud::{Mesh, PointCloud};
use crate::error::{Error, Result};

pub use arrays::{NumericArray, ScoredPairs, read_array, read_correspondences, read_descriptors};
use columns::ColumnMap;
use content_error::{ContentError, MAX_HEADER_BYTES};
pub use differences::Differences;
pub use format::Format;
use layout::FieldLayout;
pub use load::MAX_PIPE_BYTES;
use load::load;
pub use pose::{read_transform, write_transform};
#[cfg(any(feature = "batch", feature = "figures"))]
pub(crate) use {
    content_error::{quote_start, truncate_message},
    csv_reader::CsvReader,
};

/// Reads a cloud, in the unit and frame of the file.
///
/// Text is one point a line, separated by spaces, tabs, commas or semicolons, with comments after
/// `#` or `//`. A line of column names (x, y, z, nx or normal_x, ...) gives the order of columns.
/// Without it the first three columns are the position and, in .xyzn, the next three the normal.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Parse`] when its content is invalid or its
/// coordinates span too much for [`PointCloud::new`].
///
/// ```no_run
/// let cloud = cfreg::io::read("bun000.ply")?;
/// println!("{} points, {} left out", cloud.len(), cloud.dropped());
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn read(path: impl AsRef<Path>) -> Result<PointCloud> {
    Ok(read_with_differences(path)?.0)
}

/// Reads a cloud and the differences from the file: omitted or changed faces, comments, columns
/// that are not numbers, names that are not valid channel names.
///
/// # Errors
/// Those of [`read`].
pub fn read_with_differences(path: impl AsRef<Path>) -> Result<(PointCloud, Differences)> {
    let path = path.as_ref();
    let content = load(path)?;
    let table = match Format::detect(path, &content) {
        Some(Format::Ply) => ply::parse(&content),
        Some(Format::Pcd) => pcd::parse(&content),
        Some(Format::Text) if format::extension(path) == "xyzn" => {
            text::parse(&content, ColumnMap::plain(true))
        }
        Some(Format::Text) => text::parse(&content, ColumnMap::plain(false)),
        None => Err(ContentError::new("is neither PLY nor PCD nor text")),
    };
    let table = table.map_err(|fault| fault.into_error(path))?;
    drop(content);
    // An error of all coordinates together has a file but no line.
    table.into_cloud().map_err(|error| ContentError::new(error.to_string()).into_error(path))
}

/// Reads a mesh: the vertices and faces of a PLY file, in its unit and frame. Faces of more than
/// three corners become fans of triangles. A range grid, as in the Stanford scans, becomes
/// triangles between neighbours, including those across depth steps (see
/// [`Mesh::without_long_edges`]).
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Parse`] when it is not PLY, has neither
/// faces nor a range grid, or refers to a vertex that is missing or not finite.
///
/// ```no_run
/// let cloud = cfreg::io::read_mesh("bun_zipper.ply")?.sample(500, 0)?;
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn read_mesh(path: impl AsRef<Path>) -> Result<Mesh> {
    let path = path.as_ref();
    let content = load(path)?;
    let parsed = match Format::detect(path, &content) {
        Some(Format::Ply) => ply::parse_mesh(&content),
        _ => Err(ContentError::new("is not PLY, the only format that meshes are read from")),
    };
    let (table, faces) = parsed.map_err(|fault| fault.into_error(path))?;
    let vertices = table.into_points();
    let lost = |&&corner: &&u32| vertices[corner as usize].iter().any(|x| !x.is_finite());
    if let Some(corner) = faces.as_flattened().iter().find(lost) {
        let what = format!("a face has the corner {corner}, which is not finite");
        return Err(ContentError::new(what).into_error(path));
    }
    Ok(Mesh { vertices, faces })
}

/// Writes a cloud: `.ply` and `.pcd` in binary, `.xyz` and `.txt` as text with spaces, `.csv` with
/// commas. An existing file is replaced only once all is written.
///
/// Coordinates are f32 when the cloud's [`origin`](PointCloud::origin) is zero and f64 otherwise,
/// in text with the fewest digits that distinguish neighbouring values. Either way the file has
/// every [`position`](PointCloud::position) to the last bit. [`read`] then stores positions in f32
/// about the origin of their own box. They come back exactly if both origins are zero, as for
/// clouds around the zero of their frame; otherwise within 4e-7 of the longest side of the box and
/// one unit in the last place of the file's value.
///
/// Normals, weights and channels are written if present, as f32. They come back to the last bit,
/// but normals are normalised again (2e-7). Colours are rounded whole numbers
/// ([`Channels::with_color`](crate::Channels::with_color)). PCD alone keeps the viewpoint, and its
/// zero means "not known". The count of dropped points is not kept. [`differences()`] lists
/// omissions and changed names.
///
/// # Errors
/// [`Error::Config`] for another extension, and for more channels than a header of 1 MiB names;
/// [`Error::Io`] when the system refuses. An existing file is then unchanged.
pub fn write(path: impl AsRef<Path>, cloud: &PointCloud) -> Result<()> {
    let path = path.as_ref();
    let layout = layout(path, cloud)?;
    match format::extension(path).as_str() {
        "ply" => write_atomically(path, |out| ply::write(out, cloud, &layout)),
        "pcd" => write_atomically(path, |out| pcd::write(out, cloud, &layout)),
        "csv" => write_atomically(path, |out| text::write(out, cloud, &layout, "", ",")),
        _ => write_atomically(path, |out| text::write(out, cloud, &layout, "# ", " ")),
    }
}

/// Returns the data of a cloud that [`write()`] to this path leaves out or changes: the viewpoint,
/// names, colours that are rounded or become numbers.
///
/// # Errors
/// [`Error::Config`] as [`write()`].
pub fn differences(path: impl AsRef<Path>, cloud: &PointCloud) -> Result<Differences> {
    Ok(layout(path.as_ref(), cloud)?.differences)
}

/// Creates the layout of a file of that extension for a cloud.
fn layout<'a>(path: &Path, cloud: &'a PointCloud) -> Result<FieldLayout<'a>> {
    // In addition to its name, a field takes `property double ` and a line end of a PLY header, and
    // as much as ` 4 F 1` of PCD.
    let (layout, beside) = match format::extension(path).as_str() {
        "ply" => (FieldLayout::ply(cloud), 17),
        "pcd" => (FieldLayout::pcd(cloud), 7),
        "csv" => (FieldLayout::text(cloud, true), 1),
        "xyz" | "txt" => (FieldLayout::text(cloud, false), 1),
        _ => return Err(unknown_extension(path)),
    };
    let header: usize = layout.fields.iter().map(|field| field.name.len() + beside).sum();
    // Points without any field take less than that.
    if header + 1000 > MAX_HEADER_BYTES {
        let rule = format!("are more than a header of {MAX_HEADER_BYTES} bytes names: write fewer");
        return Err(Error::config("channels", layout.fields.len(), rule));
    }
    Ok(layout)
}

/// Writes bytes to a file; an existing file is replaced once all is written.
///
/// # Errors
/// [`Error::Io`] when the system refuses; an existing file is then unchanged.
#[cfg(any(feature = "batch", feature = "figures"))]
pub(crate) fn write_bytes(path: &Path, content: &[u8]) -> Result<()> {
    write_atomically(path, |out| out.write_all(content))
}

/// Checks that [`write()`] supports the extension of `path`, before long work whose result could
/// not be written.
///
/// # Errors
/// [`Error::Config`] as [`write()`].
pub fn check_writable(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    match format::extension(path).as_str() {
        "ply" | "pcd" | "xyz" | "txt" | "csv" => Ok(()),
        _ => Err(unknown_extension(path)),
    }
}

fn unknown_extension(path: &Path) -> Error {
    let rule = "the extension must be .ply, .pcd, .xyz, .txt or .csv";
    Error::config("path", path.display(), rule)
}

/// Writes a temporary file next to `path`, then renames it to `path`: a full disk leaves the old
/// file, or none, but never half of one.
fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<()> {
    // Resolves a link, so that the link remains.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let written = if fs::metadata(&target).is_ok_and(|at| !at.is_file()) {
        // A device such as /dev/stdout, which cannot be replaced; or a directory.
        File::create(&target).and_then(|file| fill_file(&file, fill))
    } else {
        outputs::create_temporary(&target).and_then(|beside| {
            fill_file(beside.as_file(), fill)?;
            beside.persist(&target).map(drop).map_err(|failed| failed.error)
        })
    };
    written.map_err(|source| Error::io(path, source))
}

fn fill_file(file: &File, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut out = BufWriter::new(file);
    fill(&mut out)?;
    out.flush()
}
