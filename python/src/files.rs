//! Reading and writing of cloud files.

use std::path::PathBuf;

use pyo3::prelude::*;

use super::arrays::parse_pose;
use super::cloud::PyCloud;
use super::cloud_arg::CloudArg;
use super::gil::run_interruptible;
use super::interop::BadRows;
use cfreg::io;

/// Read a cloud from a file: PLY, PCD, LAS, LAZ, E57, PTX, PTS, OBJ, STL, OFF, NPY, NPZ, KITTI .bin,
/// text (XYZ, TXT, CSV), or gzip of these, recognised by content.
///
/// Parameters
/// ----------
/// path : str or path; "FILE.e57#2" or "FILE.e57#NAME" reads one scan of E57 or PTX, all of which
///     are one cloud otherwise, and "FILE.npz#NAME" an array
///
/// Returns
/// -------
/// PointCloud, in the unit and frame of the file, with normals and viewpoint if it has them;
///     a column `weight` has the weights, others become channels, colours from 0 to 1. Names that
///     are invalid for channels are changed (`GPS Time` is `GPS_Time`), faces and comments skipped
///
/// Raises
/// ------
/// OSError : the file cannot be read (FileNotFoundError and other subclasses)
/// FileFormatError : the content is not of its format, a coordinate is beyond 1e75, a pipe has more
///     than 256 MiB; names the line or byte
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np, tempfile, os
/// >>> path = os.path.join(tempfile.mkdtemp(), "corner.ply")
/// >>> cfreg.write(path, np.eye(3))
/// >>> cfreg.read(path)
/// PointCloud(3 points, from [0, 0, 0] to [1, 1, 1])
#[pyfunction]
pub(super) fn read(py: Python<'_>, path: PathBuf) -> PyResult<PyCloud> {
    run_interruptible(py, || io::read(path)).map(PyCloud::from)
}

/// Write a cloud to a file; the extension selects the format: .ply .pcd .las .laz .e57 .xyz .txt .csv
/// .pts .npy.
///
/// Coordinates are written as float, or as double if the cloud is far from zero. The file contains
/// `points` to the last bit, and read() returns them, far from zero within 4e-7 of the cloud's
/// size. Colours of files and of Open3D become integers again; names that the format does not allow
/// are changed. An existing file is replaced once all is written.
///
/// Parameters
/// ----------
/// path : str or path
/// cloud : any input of PointCloud; rows that are not finite are dropped, normals written
///     if there are any. Only .pcd and .e57 keep a viewpoint
///
/// Raises
/// ------
/// SettingError : another extension
/// OSError : the system refuses; an existing file is unchanged
#[pyfunction]
pub(super) fn write(py: Python<'_>, path: PathBuf, cloud: &Bound<'_, PyAny>) -> PyResult<()> {
    let cloud = CloudArg::read(cloud, "cloud", None, BadRows::Drop)?;
    let cloud = cloud.get();
    run_interruptible(py, || io::write(path, cloud))
}

/// Move the cloud in a file by a pose and write it to another file.
///
/// In the same format nothing but coordinates and normals changes: columns, colours, faces, comments
/// and coordinate systems stay, E57 and PTX get the pose in their headers. In another format the
/// cloud is read and written.
///
/// Parameters
/// ----------
/// source : str or path of a file in any format of read()
/// transform : (4, 4), or a Registration
/// target : str or path of the file that is written
///
/// Returns
/// -------
/// str : omissions and changes in one line, empty if there are none
///
/// Raises
/// ------
/// SettingError : another extension, or no pose
/// FileFormatError, OSError : as read() and write()
#[pyfunction]
pub(super) fn apply(
    py: Python<'_>,
    source: PathBuf,
    transform: &Bound<'_, PyAny>,
    target: PathBuf,
) -> PyResult<String> {
    let transform = parse_pose(transform, "transform")?;
    let moved = run_interruptible(py, || io::apply(source, &transform, target))?;
    Ok(moved.differences.to_string())
}
