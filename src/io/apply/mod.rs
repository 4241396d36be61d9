//! Moving of whole files: positions and normals change, and all else stays as it is.
//!
//! A file that stays in its format is not read into a cloud: its bytes are copied, but for the
//! numbers that move. Columns keep their types and names, faces, comments and records of headers
//! stay. Numbers of text get three decimals more than they had, six at least. Coordinates in f32
//! become f64 where f32 would lose what the points differ in.

mod arrays;
mod meshes;
mod numbers;
mod pcd;
mod ply;
mod ptx;
mod quaternion;
mod splat;
mod text;

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

pub(super) use self::numbers::MovedBounds;
pub(super) use self::quaternion::from_rotation;
#[cfg(feature = "formats")]
pub(super) use self::quaternion::{multiply, to_rotation};
use super::content_error::ContentError;
use super::differences::Differences;
use super::format::{self, DETECTION_BYTES, Format};
use super::load::{self, Unpacked, load_unpacked};
use super::scans::{ScanChoice, split_path};
use super::text::TextColumns;
use super::{check_writable, read, write};
use crate::cloud::Transform;
use crate::error::Result;

/// The outcome of moving a file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Moved {
    /// Rows that were moved, or stayed because they mark missing points.
    pub points: u64,
    /// Omissions and changes beside the moved numbers.
    pub differences: Differences,
}

/// An error of what is read, or of what is written.
pub(super) enum WriteFault {
    Content(ContentError),
    Io(std::io::Error),
}

impl From<ContentError> for WriteFault {
    fn from(fault: ContentError) -> Self {
        WriteFault::Content(fault)
    }
}

impl From<std::io::Error> for WriteFault {
    fn from(error: std::io::Error) -> Self {
        WriteFault::Io(error)
    }
}

/// The file that is written.
pub(super) type Output<'a> = BufWriter<&'a File>;

/// Moves the cloud in `input` by `transform` and writes it to `output`.
///
/// In the same format nothing but the coordinates and the normals changes: LAS keeps its point
/// format, scale and records, E57 and PTX get the pose in their headers and keep their points,
/// Gaussian splats turn with their spherical harmonics. In another format the cloud is read and
/// written as by [`read`](super::read()) and [`write`](super::write()). Both names may end in
/// `.gz`. LAS and E57 are moved in memory that does not grow with the file; others are held once.
///
/// # Errors
/// Those of [`read`](super::read()) and [`write`](super::write()); [`Error::Config`](crate::Error::Config) for a
/// transform with a scale where the format has no place for it (E57, PTX).
///
/// ```no_run
/// let pose = cfreg::io::read_transform("pose.txt")?;
/// let moved = cfreg::io::apply("scan.laz", &pose, "moved.laz")?;
/// println!("{} points; {}", moved.points, moved.differences);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn apply(
    input: impl AsRef<Path>,
    transform: &Transform,
    output: impl AsRef<Path>,
) -> Result<Moved> {
    let (given, output) = (input.as_ref(), output.as_ref());
    let (path, choice) = split_path(given);
    let target = Format::from_extension(output_name(output).as_ref());
    if choice == ScanChoice::All
        && let Some(moved) = apply_in_format(&path, transform, output, target)?
    {
        return Ok(moved);
    }
    check_writable(output)?;
    let (cloud, differences) = super::read_with_differences(given)?;
    let moved = cloud.transformed(transform)?;
    write(output, &moved)?;
    let differences = differences.merge(super::differences(output, &moved)?);
    Ok(Moved { points: moved.len() as u64, differences })
}

/// Returns whether [`apply`] may write to `path`, in the format of `input`.
///
/// # Errors
/// [`Error::Config`](crate::Error::Config) for an extension of no format that is written.
pub fn check_applicable(input: impl AsRef<Path>, path: impl AsRef<Path>) -> Result<()> {
    let (input, path) = (input.as_ref(), path.as_ref());
    let own = |path: &Path| Format::from_extension(output_name(path).as_ref());
    let moves = own(path).is_some() && own(path) == own(input) && own(path) != Some(Format::Npz);
    if moves { Ok(()) } else { check_writable(path) }
}

/// Returns the name of an output without `.gz`.
fn output_name(path: &Path) -> std::path::PathBuf {
    match format::extension(path).as_str() {
        "gz" => path.with_extension(""),
        _ => path.to_path_buf(),
    }
}

/// Moves a file that stays in its format; `None` for another.
fn apply_in_format(
    path: &Path,
    transform: &Transform,
    output: &Path,
    target: Option<Format>,
) -> Result<Option<Moved>> {
    #[cfg(feature = "formats")]
    if let Some((file, start)) = load::open(path, DETECTION_BYTES)? {
        match read::detect(path, &start) {
            Ok(Format::Las) if target == Some(Format::Las) => {
                let is_laz = format::extension(output) == "laz";
                let moved = write_output(path, output, Format::Las, |out| {
                    super::las::apply(file, transform, is_laz, out)
                });
                return moved.map(Some);
            }
            Ok(Format::E57) if target == Some(Format::E57) => {
                let moved = write_output(path, output, Format::E57, |out| {
                    super::e57::apply(file, transform, out)
                });
                return moved.map(Some);
            }
            _ => {}
        }
    }
    let Unpacked { content, name } = load_unpacked(path)?;
    let own = read::detect(&name, &content).map_err(|fault| fault.into_error(path))?;
    if target != Some(own) || matches!(own, Format::Npz | Format::Las | Format::E57) {
        return Ok(None);
    }
    let packs = format::extension(output) == "gz";
    let moved = write_output(path, output, own, |out| {
        if packs {
            return pack(out, |out| apply_content(own, &content, &name, transform, out));
        }
        apply_content(own, &content, &name, transform, out)
    });
    moved.map(Some)
}

/// Writes a file; errors of the content are about `path`.
fn write_output(
    path: &Path,
    output: &Path,
    format: Format,
    fill: impl FnOnce(&mut Output<'_>) -> Result<Moved, WriteFault>,
) -> Result<Moved> {
    let mut fault = None;
    let written = super::write_file(output, |out| {
        fill(out).map_err(|error| match error {
            WriteFault::Io(error) => error,
            WriteFault::Content(content) => {
                fault = Some(content);
                std::io::Error::other("the input is refused")
            }
        })
    });
    match fault {
        Some(fault) => Err(fault.in_format(format).into_error(path)),
        None => written,
    }
}

#[cfg(feature = "formats")]
fn pack(
    out: &mut Output<'_>,
    fill: impl FnOnce(&mut dyn Write) -> Result<Moved, WriteFault>,
) -> Result<Moved, WriteFault> {
    let mut packed = flate2::write::GzEncoder::new(out, flate2::Compression::default());
    let moved = fill(&mut packed)?;
    packed.finish()?;
    Ok(moved)
}

#[cfg(not(feature = "formats"))]
fn pack(
    _out: &mut Output<'_>,
    _fill: impl FnOnce(&mut dyn Write) -> Result<Moved, WriteFault>,
) -> Result<Moved, WriteFault> {
    Err(std::io::Error::other("this build writes no gzip (feature formats)").into())
}

fn apply_content(
    format: Format,
    content: &[u8],
    name: &Path,
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    match format {
        Format::Ply => ply::apply(content, transform, out),
        Format::Pcd => pcd::apply(content, transform, out),
        Format::Ptx => ptx::apply(content, transform, out),
        Format::Pts => text::apply(content, TextColumns::Pts, transform, out),
        Format::Text if format::extension(name) == "xyzn" => {
            text::apply(content, TextColumns::Normals, transform, out)
        }
        Format::Text => text::apply(content, TextColumns::Positions, transform, out),
        Format::Obj => meshes::apply_obj(content, transform, out),
        Format::Off => meshes::apply_off(content, transform, out),
        Format::Stl => meshes::apply_stl(content, transform, out),
        Format::Npy => arrays::apply_npy(content, transform, out),
        Format::Bin => arrays::apply_bin(content, name, transform, out),
        Format::Las | Format::E57 | Format::Npz => {
            Err(ContentError::new("is read from files alone: unpack it first").into())
        }
    }
}

/// Refuses a scale where the format has no place for it.
pub(super) fn refuse_scale(transform: &Transform, format: Format) -> Result<(), ContentError> {
    if transform.scale == 1.0 {
        return Ok(());
    }
    let scale = transform.scale;
    let what = format!(
        "the pose has the scale {scale}, for which headers of {format} have no place: write another \
         format, such as PLY or LAS"
    );
    Err(ContentError::new(what))
}
