//! Clouds from files and into files.

use std::path::PathBuf;

use pyo3::prelude::*;

use super::cloud::PyCloud;
use super::cloud_arg::CloudArg;
use super::gil::run_interruptible;
use super::interop::BadRows;
use cfreg::io;

/// Reads a cloud from a file: PLY, PCD, XYZ, TXT or CSV, told apart by content.
///
/// Parameters
/// ----------
/// path : str or path
///
/// Returns
/// -------
/// PointCloud, in the unit and frame of the file, with normals and viewpoint if it has them;
///     a column `weight` has the weights, others become channels, colours from 0 to 1. Names that
///     no channel has are changed (`GPS Time` is `GPS_Time`), faces and comments are skipped
///
/// Raises
/// ------
/// OSError : the file cannot be read (FileNotFoundError and its kin)
/// FileFormatError : it is not what it claims to be, a coordinate is beyond 1e75, a pipe has more
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

/// Writes a cloud to a file; the extension says the format: .ply .pcd .xyz .txt .csv.
///
/// Coordinates are written as float, or as double where the cloud lies far from zero: the file
/// has `points` to the last bit, and read() gets them back, far from zero within 4e-7 of the
/// cloud's size. Colours of files and of Open3D are whole numbers again; names that the format
/// cannot hold are changed. A file that was there is replaced once all is written.
///
/// Parameters
/// ----------
/// path : str or path
/// cloud : whatever PointCloud takes; rows that are not finite are left out, normals written
///     where there are any. Only .pcd keeps a viewpoint
///
/// Raises
/// ------
/// SettingError : another extension
/// OSError : the system refuses; a file that was there before is as it was
#[pyfunction]
pub(super) fn write(py: Python<'_>, path: PathBuf, cloud: &Bound<'_, PyAny>) -> PyResult<()> {
    let cloud = CloudArg::read(cloud, "cloud", None, BadRows::Drop)?;
    let cloud = cloud.get();
    run_interruptible(py, || io::write(path, cloud))
}
