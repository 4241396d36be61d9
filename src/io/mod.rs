//! Clouds and poses in files.
//!
//! [`read`] takes PLY, PCD and text, told apart by content, [`read_mesh`] the faces of PLY
//! too; [`write()`] goes by the extension. Coordinates pass through f64, so map coordinates stay exact; points
//! with a NaN or infinite coordinate are left out and counted by
//! [`PointCloud::dropped`].
//!
//! A column called `weight` has the weights of the points; every other scalar that has a name
//! becomes a channel ([`PointCloud::channels`]) as it is, but colours in bytes, and PCD's packed
//! `rgb` and `rgba`, become `red`, `green` and `blue` from 0 to 1. A column with anything that is
//! not a finite number at a point that is kept, or without the name of a channel, is skipped, as
//! lists and faces are.
//!
//! A file is not believed: a count in a header is weighed against the bytes that
//! are there before memory is taken for it, and whatever is wrong is an
//! [`Error::Parse`] with its line or byte.

mod columns;
mod fault;
mod fields;
mod format;
pub(crate) mod guard;
mod lines;
pub(crate) mod outputs;
mod pcd;
mod ply;
mod pose;
#[cfg(any(feature = "batch", feature = "figures"))]
mod sheet;
mod table;
mod text;

use std::fs::{self, File};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::Path;

use crate::cloud::{Mesh, PointCloud};
use crate::error::{Error, Result};

use columns::Columns;
use fault::Fault;
pub use format::Format;
pub use pose::{read_transform, write_transform};
#[cfg(any(feature = "batch", feature = "figures"))]
pub(crate) use sheet::Sheet;

/// Reads a cloud, in the unit and frame of the file.
///
/// Text is one point a line, separated by spaces, tabs, commas or semicolons, with
/// comments after `#` or `//`. A line of column names (x, y, z, nx or normal_x, ...)
/// says where things are; without it the first three columns are the position and,
/// in .xyzn, the next three the normal.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Parse`] when it is not what
/// it claims to be or its coordinates span too much for [`PointCloud::new`].
///
/// ```no_run
/// let cloud = cfreg::io::read("bun000.ply")?;
/// println!("{} points, {} left out", cloud.len(), cloud.dropped());
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn read(path: impl AsRef<Path>) -> Result<PointCloud> {
    let path = path.as_ref();
    let content = load(path)?;
    let table = match Format::detect(path, &content) {
        Some(Format::Ply) => ply::parse(&content),
        Some(Format::Pcd) => pcd::parse(&content),
        Some(Format::Text) if format::extension(path) == "xyzn" => {
            text::parse(&content, Columns::XYZ_NORMAL)
        }
        Some(Format::Text) => text::parse(&content, Columns::XYZ),
        None => Err(Fault::new("is neither PLY nor PCD nor text")),
    };
    let table = table.map_err(|fault| fault.within(path))?;
    // What is wrong with the coordinates together has no line, but it has a file.
    table.into_cloud().map_err(|error| Fault::new(error.to_string()).within(path))
}

/// Reads a mesh: the vertices and faces of a PLY file, in its unit and frame. Faces of more
/// than three corners become fans of triangles; a range grid, in which the Stanford scans
/// come, becomes triangles between neighbours, steps of depth included (see
/// [`Mesh::without_long_edges`]).
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Parse`] when it is not PLY, has
/// neither faces nor a range grid, or names or uses a vertex that is not there or not finite.
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
        _ => Err(Fault::new("is not PLY, the only format that meshes are read from")),
    };
    let (table, faces) = parsed.map_err(|fault| fault.within(path))?;
    let vertices = table.into_points();
    let lost = |&&corner: &&u32| vertices[corner as usize].iter().any(|x| !x.is_finite());
    if let Some(corner) = faces.as_flattened().iter().find(lost) {
        let what = format!("a face has the corner {corner}, which is not finite");
        return Err(Fault::new(what).within(path));
    }
    Ok(Mesh { vertices, faces })
}

/// Writes a cloud: `.ply` and `.pcd` in binary, `.xyz` and `.txt` as text with
/// spaces, `.csv` with commas. An existing file is replaced, once all is written.
///
/// Coordinates are written as float when the cloud's origin is zero and as double
/// otherwise; either way [`read`] gets back every position. Normals are written when
/// there are any, and so are weights and channels, as float. The viewpoint is kept by PCD only, and there zero stands for
/// "not known". The count of dropped points is not kept.
///
/// # Errors
/// [`Error::Config`] for another extension, [`Error::Io`] when the system refuses;
/// a file that was there before is then still as it was.
pub fn write(path: impl AsRef<Path>, cloud: &PointCloud) -> Result<()> {
    let path = path.as_ref();
    match format::extension(path).as_str() {
        "ply" => replace(path, |out| ply::write(out, cloud)),
        "pcd" => replace(path, |out| pcd::write(out, cloud)),
        "xyz" | "txt" => replace(path, |out| text::write(out, cloud, "# ", " ")),
        "csv" => replace(path, |out| text::write(out, cloud, "", ",")),
        _ => Err(unknown_extension(path)),
    }
}

/// Writes bytes to a file; one that was there before is replaced once all is written.
///
/// # Errors
/// [`Error::Io`] when the system refuses; an old file is then still as it was.
#[cfg(any(feature = "batch", feature = "figures"))]
pub(crate) fn write_bytes(path: &Path, content: &[u8]) -> Result<()> {
    replace(path, |out| out.write_all(content))
}

/// Checks that [`write()`] knows the extension of `path`, before work is done whose result
/// could then not be written.
///
/// # Errors
/// [`Error::Config`] as [`write()`].
pub fn writable(path: impl AsRef<Path>) -> Result<()> {
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

/// The bytes of a file that is there and not empty.
///
/// Only regular files: a device or a pipe has no end that a header could be
/// weighed against.
fn load(path: &Path) -> Result<Vec<u8>> {
    let refuse = |source| Error::io(path, source);
    let kind = fs::metadata(path).map_err(refuse)?;
    if !kind.is_file() {
        let what = if kind.is_dir() { "is a directory" } else { "is not a regular file" };
        return Err(refuse(io::Error::new(ErrorKind::InvalidInput, what)));
    }
    let content = fs::read(path).map_err(refuse)?;
    if content.is_empty() {
        return Err(Fault::new("is empty").within(path));
    }
    Ok(content)
}

/// Writes a file beside `path`, then renames it to `path`: a full disk leaves the
/// old file, or none, but never half of one.
fn replace(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    // Through a link, so that the link stays one.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let written = if fs::metadata(&target).is_ok_and(|at| !at.is_file()) {
        // Something like /dev/stdout, which cannot be replaced; or a directory.
        File::create(&target).and_then(|file| fill_file(&file, fill))
    } else {
        outputs::beside(&target).and_then(|beside| {
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
