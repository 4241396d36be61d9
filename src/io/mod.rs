//! Clouds and poses in files.
//!
//! [`read()`] takes PLY, PCD, PTX, PTS, OBJ, STL, OFF, NPY, NPZ, KITTI `.bin` and text, and with the
//! feature `formats` LAS, LAZ, E57 and gzip, detected by content; [`read_mesh`] also takes faces;
//! [`write()`] goes by the extension; [`apply()`] moves a file without changing anything else.
//! Points with a NaN or infinite coordinate are left out and counted by [`PointCloud::dropped`]; a
//! finite one beyond 1e75 is an error.
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
//! | LAS, LAZ | colours of 16 bits, extra bytes | coordinates to 9 digits of the size; no viewpoint |
//! | E57 | viewpoints, colours of 8 and 16 bits | names as PLY |
//! | NPY | colours of 8 and 16 bits | names as PLY; no viewpoint |
//! | PTS | intensity, colours of 8 bits | nothing else |
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

mod apply;
mod arrays;
mod bin;
mod cells;
mod columns;
mod content_error;
#[cfg(feature = "batch")]
mod csv_reader;
mod differences;
#[cfg(feature = "formats")]
mod e57;
mod foreign;
mod format;
#[cfg(feature = "formats")]
mod guard;
#[cfg(feature = "formats")]
mod las;
mod layout;
pub(crate) mod limited_file;
mod lines;
mod literal;
mod load;
mod mesh_table;
mod names;
mod npy;
mod npz;
mod obj;
mod off;
pub(crate) mod outputs;
mod pcd;
mod ply;
mod pose;
mod pose_format;
mod ptx;
mod read;
mod scalar;
mod scans;
mod stl;
mod table;
mod text;

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::cloud::PointCloud;
use crate::error::{Error, Result};

pub use apply::{Moved, apply, check_applicable};
pub use arrays::{NumericArray, ScoredPairs, read_array, read_correspondences, read_descriptors};
use content_error::MAX_HEADER_BYTES;
pub(crate) use content_error::{quote_start, truncate_message};
#[cfg(feature = "batch")]
pub(crate) use csv_reader::CsvReader;
pub use differences::Differences;
pub use format::Format;
use layout::FieldLayout;
pub use load::MAX_PIPE_BYTES;
pub use pose::{read_transform, write_transform};
pub use pose_format::{PoseFormat, write_pose};
pub use read::{read, read_mesh, read_with_differences};

/// Writes a cloud: `.ply`, `.pcd` and `.npy` in binary, `.xyz`, `.txt` and `.pts` as text with
/// spaces, `.csv` with commas, and with the feature `formats` `.las`, `.laz` and `.e57`. An existing file is replaced only once all is written.
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
    #[cfg(feature = "formats")]
    match format::extension(path).as_str() {
        "las" | "laz" => {
            let (layout, is_laz) = (las::LasLayout::new(cloud), format::extension(path) == "laz");
            return write_file(path, |out| {
                las::write(out, cloud, &layout, is_laz).map_err(|fault| match fault {
                    apply::WriteFault::Io(error) => error,
                    apply::WriteFault::Content(what) => io::Error::other(what.message()),
                })
            });
        }
        "e57" => {
            let layout = layout(path, cloud)?;
            return write_file(path, |out| {
                let file: &File = out.get_ref();
                e57::write(file, cloud, &layout)
                    .map_err(|error| io::Error::other(error.to_string()))
            });
        }
        _ => {}
    }
    let layout = layout(path, cloud)?;
    match format::extension(path).as_str() {
        "ply" => write_atomically(path, |out| ply::write(out, cloud, &layout)),
        "pcd" => write_atomically(path, |out| pcd::write(out, cloud, &layout)),
        "npy" => write_atomically(path, |out| npy::write(out, cloud, &layout)),
        "pts" => write_atomically(path, |out| text::write_pts(out, cloud, &layout)),
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
    #[cfg(feature = "formats")]
    if matches!(format::extension(path.as_ref()).as_str(), "las" | "laz") {
        return Ok(las::LasLayout::new(cloud).differences);
    }
    Ok(layout(path.as_ref(), cloud)?.differences)
}

/// Creates the layout of a file of that extension for a cloud.
fn layout<'a>(path: &Path, cloud: &'a PointCloud) -> Result<FieldLayout<'a>> {
    // In addition to its name, a field takes `property double ` and a line end of a PLY header, and
    // as much as ` 4 F 1` of PCD.
    let (layout, beside) = match format::extension(path).as_str() {
        "ply" => (FieldLayout::without_viewpoint(cloud), 17),
        "npy" => (FieldLayout::without_viewpoint(cloud), 12),
        #[cfg(feature = "formats")]
        "e57" => (FieldLayout::named(cloud), 100),
        "pts" => (FieldLayout::pts(cloud), 0),
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
        "ply" | "pcd" | "xyz" | "txt" | "csv" | "pts" | "npy" => Ok(()),
        "las" | "laz" | "e57" if cfg!(feature = "formats") => Ok(()),
        _ => Err(unknown_extension(path)),
    }
}

fn unknown_extension(path: &Path) -> Error {
    let rule = match cfg!(feature = "formats") {
        true => {
            "the extension must be .ply, .pcd, .las, .laz, .e57, .xyz, .txt, .csv, .pts or .npy"
        }
        false => "the extension must be .ply, .pcd, .xyz, .txt, .csv, .pts or .npy",
    };
    Error::config("path", path.display(), rule)
}

/// Writes a file as [`write_file`], by calls alone.
fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<()> {
    write_file(path, |out| fill(out))
}

/// Writes a temporary file next to `path`, then renames it to `path`: a full disk leaves the old
/// file, or none, but never half of one.
fn write_file<T>(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<T>,
) -> Result<T> {
    // Resolves a link, so that the link remains.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let written = if fs::metadata(&target).is_ok_and(|at| !at.is_file()) {
        // A device such as /dev/stdout, which cannot be replaced; or a directory.
        File::create(&target).and_then(|file| fill_file(&file, fill))
    } else {
        outputs::create_temporary(&target).and_then(|beside| {
            let done = fill_file(beside.as_file(), fill)?;
            beside.persist(&target).map(|_| done).map_err(|failed| failed.error)
        })
    };
    written.map_err(|source| Error::io(path, source))
}

fn fill_file<T>(
    file: &File,
    fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<T>,
) -> io::Result<T> {
    let mut out = BufWriter::new(file);
    let done = fill(&mut out)?;
    out.flush()?;
    Ok(done)
}
