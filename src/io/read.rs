//! Reading of clouds and meshes, by the format that is detected.

use std::path::Path;

use super::content_error::ContentError;
use super::differences::Differences;
use super::foreign;
use super::format::{self, DETECTION_BYTES, Format};
use super::load::{self, Unpacked, load_unpacked};
use super::mesh_table::MeshTable;
use super::scans::{ScanChoice, refuse_choice, split_path};
use super::table::PointTable;
use super::text::{self, BYTE_ORDER_MARK, TextColumns};
use super::{bin, npy, npz, obj, off, pcd, ply, ptx, stl};
use crate::cloud::{Mesh, PointCloud};
use crate::error::Result;

/// Reads a cloud, in the unit and frame of the file.
///
/// The format goes by the content, then by the extension. Text is one point a line, separated by
/// spaces, tabs, commas or semicolons, with comments after `#`, `//` or `%`. A line of column names
/// (x, y, z or Easting, Northing, Height; nx or normal_x, ...) gives the order of columns. Without
/// it the first three columns are the position and, in .xyzn, the next three the normal.
///
/// A file of several scans (E57, PTX) is read as one cloud, each scan moved by its pose;
/// `FILE.e57#2` and `FILE.e57#NAME` read one, whose sensor then is the viewpoint of the cloud. The
/// same picks an array of an NPZ file.
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be read,
/// [`Error::Parse`](crate::Error::Parse) when its content is invalid, in a format that is not read,
/// or its coordinates span too much for [`PointCloud::new`].
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
/// that are not numbers, names that are not valid channel names, counts that contradict the rows.
///
/// # Errors
/// Those of [`read`].
pub fn read_with_differences(path: impl AsRef<Path>) -> Result<(PointCloud, Differences)> {
    let given = path.as_ref();
    let (path, choice) = split_path(given);
    let (format, table) = read_table(&path, &choice)?;
    // An error of all coordinates together has a file but no line.
    table
        .into_cloud()
        .map_err(|error| ContentError::new(error.to_string()).in_format(format).into_error(given))
}

/// Reads the rows of a file.
fn read_table(path: &Path, choice: &ScanChoice) -> Result<(Format, PointTable)> {
    if let Some((_file, _start)) = load::open(path, DETECTION_BYTES)? {
        // Files of any size: not held whole.
        #[cfg(feature = "formats")]
        match detect(path, &_start) {
            Ok(format @ Format::Las) => {
                let table = refuse_choice(choice).and_then(|()| super::las::read(_file));
                return in_format(path, format, table);
            }
            Ok(format @ Format::E57) => {
                return in_format(path, format, super::e57::read(_file, choice));
            }
            _ => {}
        }
    }
    let Unpacked { content, name } = load_unpacked(path)?;
    let format = detect(&name, &content).map_err(|fault| fault.into_error(path))?;
    in_format(path, format, parse(format, content, &name, choice))
}

fn in_format(
    path: &Path,
    format: Format,
    table: Result<PointTable, ContentError>,
) -> Result<(Format, PointTable)> {
    let table = table.map_err(|fault| fault.in_format(format).into_error(path))?;
    Ok((format, table))
}

/// Detects the format of a file that begins with `content`; the error names one that is not read.
pub(super) fn detect(path: &Path, content: &[u8]) -> Result<Format, ContentError> {
    if let Some(refusal) = foreign::refusal_by_content(content) {
        return Err(refusal);
    }
    if Format::from_content(content).is_none()
        && let Some(refusal) = foreign::refusal_by_extension(path)
    {
        return Err(refusal);
    }
    Format::detect(path, content).ok_or_else(foreign::unknown)
}

/// Reads the rows of a file's content.
fn parse(
    format: Format,
    content: Vec<u8>,
    path: &Path,
    choice: &ScanChoice,
) -> Result<PointTable, ContentError> {
    let bytes = content.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&content);
    if !matches!(format, Format::E57 | Format::Ptx | Format::Npz) {
        refuse_choice(choice)?;
    }
    match format {
        Format::Ply => ply::parse(bytes),
        Format::Pcd => pcd::parse(bytes),
        Format::Ptx => ptx::parse(&text::decode_latin1(bytes), choice),
        Format::Pts => text::parse(&content, TextColumns::Pts),
        Format::Text if format::extension(path) == "xyzn" => {
            text::parse(&content, TextColumns::Normals)
        }
        Format::Text => text::parse(&content, TextColumns::Positions),
        Format::Obj | Format::Stl | Format::Off => {
            let (mesh, mut differences) = parse_mesh(format, bytes)?;
            differences.leave_out_all(mesh.faces.len(), "face");
            Ok(mesh.into_table(false)?.0.with_differences(differences))
        }
        Format::Npy => npy::parse(&content),
        Format::Npz => npz::parse(&content, choice),
        Format::Bin => bin::parse(&content, path),
        #[cfg(feature = "formats")]
        Format::Las => super::las::read(std::io::Cursor::new(content)),
        #[cfg(feature = "formats")]
        Format::E57 => super::e57::read(std::io::Cursor::new(content), choice),
        #[cfg(not(feature = "formats"))]
        Format::Las | Format::E57 => Err(ContentError::new(
            "this build does not read it (feature formats): use the program or the package",
        )),
    }
}

fn parse_mesh(format: Format, bytes: &[u8]) -> Result<(MeshTable, Differences), ContentError> {
    match format {
        Format::Obj => obj::parse(&text::decode_latin1(bytes)),
        Format::Stl => Ok((stl::parse(bytes)?, Differences::default())),
        _ => Ok((off::parse(&text::decode_latin1(bytes))?, Differences::default())),
    }
}

/// Reads a mesh: the vertices and faces of a PLY, OBJ, STL or OFF file, in its unit and frame.
/// Faces of more than three corners become fans of triangles; corners of STL at one place are one
/// vertex. A range grid of PLY, as in the Stanford scans, becomes triangles between neighbours,
/// including those across depth steps (see [`Mesh::without_long_edges`]).
///
/// # Errors
/// [`Error::Io`](crate::Error::Io) when the file cannot be read,
/// [`Error::Parse`](crate::Error::Parse) when it is in no format of meshes, has neither faces nor a
/// range grid, or refers to a vertex that is missing or not finite.
///
/// ```no_run
/// let cloud = cfreg::io::read_mesh("bun_zipper.ply")?.sample(500, 0)?;
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn read_mesh(path: impl AsRef<Path>) -> Result<Mesh> {
    let path = path.as_ref();
    let Unpacked { content, name } = load_unpacked(path)?;
    let bytes = content.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&content);
    let format = detect(&name, &content).map_err(|fault| fault.into_error(path))?;
    let parsed = match format {
        Format::Ply => ply::parse_mesh(bytes),
        Format::Obj | Format::Stl | Format::Off => {
            parse_mesh(format, bytes).and_then(|(mesh, _)| {
                let (table, faces) = mesh.into_table(true)?;
                let what = "has no surface: there are no faces";
                (!faces.is_empty()).then_some((table, faces)).ok_or_else(|| ContentError::new(what))
            })
        }
        _ => {
            let what = "is not PLY, OBJ, STL or OFF, from which meshes are read";
            Err(ContentError::new(what))
        }
    };
    let (table, faces) = parsed.map_err(|fault| fault.in_format(format).into_error(path))?;
    let vertices = table.into_points();
    let lost = |&&corner: &&u32| vertices[corner as usize].iter().any(|x| !x.is_finite());
    if let Some(corner) = faces.as_flattened().iter().find(lost) {
        let what = format!("a face has the corner {corner}, which is not finite");
        return Err(ContentError::new(what).in_format(format).into_error(path));
    }
    Ok(Mesh { vertices, faces })
}
