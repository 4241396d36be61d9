//! `PointCloud`: created once, used for any number of calls.

use std::collections::BTreeMap;
use std::sync::Arc;

use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};

use super::arrays::{NumericArray, interop_module, parse_pose, parse_vec3, read_only, to_array2};
use super::errors::{format_value, parse_count, real, to_pyerr, whole};
use super::gil::run_interruptible;
use super::interop::{self, BadRows};
use super::rows::RowSelection;
use super::shutdown::detach;
use cfreg::cloud::{Parts, PointCloud as Cloud};
use cfreg::error::Error;
use cfreg::math::Vec3;
use cfreg::{filter, search};

/// Weights, channels, integers of colours, and descriptors of a pickled cloud.
type PickledAttributes<'py> = (
    Option<Bound<'py, PyAny>>,
    Bound<'py, PyDict>,
    BTreeMap<String, u16>,
    Option<Bound<'py, PyAny>>,
);

/// Points, optionally with unit normals and a viewpoint.
///
/// Any number of calls use it without another copy. It is immutable.
///
/// Parameters
/// ----------
/// points : (N, 3) numbers in any unit: an array of float32 or float64 with any strides, which
///     is read as it is, or one of integers or other floats, or a list of rows, which become
///     float64. Rows with a NaN or an infinity (or a mask) are dropped and counted in
///     `dropped`. Also a point cloud or mesh of Open3D, trimesh, pyvista, laspy or small_gicp,
///     with its normals
/// normals : (N, 3) array, scaled to unit length; zero, or not finite, means undefined. Also the
///     whole result of estimate_normals for the same points
/// viewpoint : three numbers, the position of the sensor in the frame of the points. Estimated
///     normals point towards it
/// weights : (N,) numbers, 0 or more and not all 0: the weight of each point. 2 is equivalent
///     to having the point twice, 0 to not connecting it
/// descriptors : (N, D) numbers, D up to 512: a row a point by which points may be compared, such as
///     learned features (`cfreg.register(..., given_descriptors="replace")`)
/// channels : {name: (N,) numbers}, finite: scalars by which points may be compared beside their
///     shape (`cfreg.CF(channels=...)`). Colours of the other libraries become red, green, blue, 0
///     to 1; for pyvista and Open3D's tensors all finite columns are used, `weight` as weights
///
/// Raises
/// ------
/// Error : any other type of input
/// ShapeError : not (N, 3), or not one normal a point
/// ExtentError : coordinates that span more than 1e15 or less than 1e-15, or one beyond 1e75
///
/// Examples
/// --------
/// >>> import cfreg, numpy as np
/// >>> cloud = cfreg.PointCloud(np.array([[0.0, 0, 0], [1, 0, 0], [0, np.nan, 0]]))
/// >>> cloud
/// PointCloud(2 points, 1 dropped, from [0, 0, 0] to [1, 0, 0])
/// >>> cloud.points.shape, cloud.points.flags.writeable
/// ((2, 3), False)
#[pyclass(frozen, module = "cfreg", name = "PointCloud")]
pub(super) struct PyCloud {
    cloud: Cloud,
    /// Results of `points` and `normals`, created on first use.
    points: PyOnceLock<Py<PyAny>>,
    normals: PyOnceLock<Py<PyAny>>,
}

impl From<Cloud> for PyCloud {
    fn from(cloud: Cloud) -> Self {
        PyCloud { cloud, points: PyOnceLock::new(), normals: PyOnceLock::new() }
    }
}

impl PyCloud {
    /// A cloud of what is no `PointCloud`, or of one with other normals; `name` is what errors
    /// call it.
    pub(super) fn from_any<'py>(
        any: &Bound<'py, PyAny>,
        name: &str,
        normals: Option<&Bound<'py, PyAny>>,
        bad_rows: BadRows,
    ) -> PyResult<Cloud> {
        let cloud = interop::read_cloud(any, name, normals, bad_rows)?;
        let Ok(given) = any.cast::<PyCloud>() else { return Ok(cloud) };
        // All other attributes of the given cloud.
        let given = &given.get().cloud;
        let weights = given.weights().map(<[f32]>::to_vec);
        let (channels, viewpoint) = (given.channels().clone(), given.viewpoint());
        let (descriptors, dropped) = (given.descriptors().cloned(), given.dropped());
        let parts = Parts { weights, channels, descriptors, viewpoint, dropped, ..cloud.parts() };
        Cloud::from_parts(parts).map_err(to_pyerr)
    }

    pub(super) fn cloud(&self) -> &Cloud {
        &self.cloud
    }
}

#[pymethods]
impl PyCloud {
    #[new]
    #[pyo3(signature = (points, normals=None, viewpoint=None, weights=None, channels=None, descriptors=None))]
    fn new(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        normals: Option<&Bound<'_, PyAny>>,
        viewpoint: Option<&Bound<'_, PyAny>>,
        weights: Option<&Bound<'_, PyAny>>,
        channels: Option<&Bound<'_, PyAny>>,
        descriptors: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let channels = channels.map(mapping).transpose()?;
        let viewpoint = viewpoint.map(|at| parse_vec3(at, "viewpoint")).transpose()?;
        let given = points.cast::<PyCloud>().ok();
        let cloud = match (given, normals) {
            (Some(given), None) => {
                let given = given.get();
                detach(py, || given.cloud.clone())?
            }
            _ => PyCloud::from_any(points, "points", normals, BadRows::Drop)?,
        };
        // Rows that a `PointCloud` has dropped do not count.
        let rows = match (given, weights, &channels, descriptors) {
            (Some(_), ..) | (_, None, None, None) => RowSelection::new(cloud.len()),
            _ => RowSelection::from_points(points, &cloud)?,
        };
        let cloud = match viewpoint {
            Some(at) => cloud.with_viewpoint(at).map_err(to_pyerr)?,
            None => cloud,
        };
        let cloud = match weights {
            Some(weights) => {
                cloud.with_weights(rows.column(weights, "weights")?).map_err(to_pyerr)?
            }
            None => cloud,
        };
        let cloud = match channels {
            Some(given) => {
                let channels = rows.channels(&given, &BTreeMap::new())?;
                cloud.with_channels(channels).map_err(to_pyerr)?
            }
            None => cloud,
        };
        let cloud = match descriptors {
            Some(given) => {
                let descriptors = rows.descriptors(given, "descriptors")?;
                detach(py, || cloud.with_descriptors(descriptors))?.map_err(to_pyerr)?
            }
            None => cloud,
        };
        Ok(cloud.into())
    }

    /// (N, D) float32 array of the points' descriptors, read-only; None if the cloud carries none.
    #[getter]
    fn descriptors<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let Some(rows) = self.cloud.descriptors() else { return Ok(None) };
        let values = detach(py, || rows.as_slice().to_vec())?;
        Ok(Some(read_only(to_array2(py, rows.dim(), values))))
    }

    /// (N,) float32 array of the points' weights, read-only; None if all have the same weight.
    #[getter]
    fn weights<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f32>>> {
        self.cloud.weights().map(|weights| read_only(PyArray1::from_slice(py, weights)))
    }

    /// {name: (N,) float32 array, read-only}, in the order of the input.
    #[getter]
    fn channels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let channels = PyDict::new(py);
        for (name, values) in self.cloud.channels().iter() {
            channels.set_item(name, read_only(PyArray1::from_slice(py, values)))?;
        }
        Ok(channels)
    }

    /// (N, 3) array of the coordinates, read-only: float32 as used internally, or float64 if the
    /// cloud is so far from zero that float32 would lose digits.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let made = self.points.get_or_try_init(py, || {
            let array = if self.cloud.origin() == [0.0; 3] {
                let rows = detach(py, || self.cloud.points().as_flattened().to_vec())?;
                read_only(to_array2(py, 3, rows)).into_any()
            } else {
                let rows = detach(py, || self.cloud.positions().collect::<Vec<_>>())?;
                read_only(to_array2(py, 3, rows.into_flattened())).into_any()
            };
            Ok::<_, PyErr>(array.unbind())
        })?;
        Ok(made.bind(py).clone())
    }

    /// (N, 3) float32 array of unit normals, read-only, zero where undefined; None if the cloud has
    /// none.
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(normals) = self.cloud.normals() else { return Ok(None) };
        let made = self.normals.get_or_try_init(py, || {
            let rows = detach(py, || normals.as_flattened().to_vec())?;
            Ok::<_, PyErr>(read_only(to_array2(py, 3, rows)).into_any().unbind())
        })?;
        Ok(Some(made.bind(py).clone()))
    }

    /// Viewpoint of the cloud, or None.
    #[getter]
    fn viewpoint<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.cloud.viewpoint().map(|at| read_only(PyArray1::from_slice(py, &at)))
    }

    /// Number of rows that marked measurements without a return, and were removed.
    #[getter]
    fn no_returns(&self) -> usize {
        self.cloud.no_returns()
    }

    /// Number of points with a NaN or infinite coordinate that were dropped.
    #[getter]
    fn dropped(&self) -> usize {
        self.cloud.dropped()
    }

    /// Lowest and highest corner, two rows of three; None if the cloud is empty.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let bounds = detach(py, || self.cloud.bounds())?;
        Ok(bounds.map(|(low, high)| read_only(to_array2(py, 3, [low, high].concat()))))
    }

    /// Median distance from a point to the nearest other one, in the unit of the points; 0 for
    /// fewer than two positions.
    #[getter]
    fn resolution(&self, py: Python<'_>) -> PyResult<f64> {
        run_interruptible(py, || search::resolution(self.cloud.points()))
    }

    /// Return one point per voxel: the mean of the points, and of the normals, in it.
    ///
    /// size : side of the voxels, in the unit of the points, above 0. SettingError otherwise
    fn voxel(&self, py: Python<'_>, #[pyo3(from_py_with = real)] size: f64) -> PyResult<Self> {
        run_interruptible(py, || filter::voxel_grid(&self.cloud, size)).map(Self::from)
    }

    /// Return one point per voxel, as `voxel` does: Open3D's name for it.
    ///
    /// voxel_size : side of the voxels, in the unit of the points, above 0. SettingError otherwise
    fn voxel_down_sample(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = real)] voxel_size: f64,
    ) -> PyResult<Self> {
        self.voxel(py, voxel_size)
    }

    /// Select points, with all that they have: by a slice, indices or a mask, as arrays are.
    fn __getitem__(&self, py: Python<'_>, key: &Bound<'_, PyAny>) -> PyResult<Self> {
        let numpy = py.import("numpy")?;
        let all = numpy.call_method1("arange", (self.cloud.len(),))?;
        let chosen = numpy.call_method1("atleast_1d", (all.get_item(key)?,))?;
        let chosen: Vec<usize> = chosen.call_method0("tolist")?.extract()?;
        detach(py, || self.cloud.select(&chosen)).map(Self::from)
    }

    /// Join two clouds of one frame: the points of both, with normals, weights and channels where
    /// both have them; without a viewpoint.
    fn __add__(&self, py: Python<'_>, other: &Bound<'_, PyAny>) -> PyResult<Self> {
        let other = other.cast::<Self>().map_err(|_| {
            let given = format_value(other);
            PyTypeError::new_err(format!("a PointCloud and a PointCloud are joined, not {given}"))
        })?;
        let other = other.get();
        detach(py, || self.cloud.joined(&other.cloud))?.map(Self::from).map_err(to_pyerr)
    }

    /// Draw points at random without replacement, in their order.
    ///
    /// count : how many, at least 1; the whole cloud if it has no more
    /// seed : the same seed draws the same points on every machine
    #[pyo3(signature = (count, seed=0))]
    fn sample(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = whole)] count: i64,
        #[pyo3(from_py_with = whole)] seed: i64,
    ) -> PyResult<Self> {
        let seed = self::parse_count("seed", seed)? as u64;
        let count = self::parse_count("count", count)?;
        if count == 0 {
            return Err(to_pyerr(Error::config("count", 0, "must be at least 1")));
        }
        run_interruptible(py, || Ok(filter::sample(&self.cloud, count, seed))).map(Self::from)
    }

    /// Move the cloud by a pose, with its normals and its viewpoint.
    ///
    /// transform : (4, 4), rotation times scale, and translation. SettingError if it is no such
    /// matrix
    fn transformed(&self, py: Python<'_>, transform: &Bound<'_, PyAny>) -> PyResult<Self> {
        let transform = parse_pose(transform, "transform")?;
        run_interruptible(py, || self.cloud.transformed(&transform)).map(Self::from)
    }

    /// Convert the cloud to an `open3d.geometry.PointCloud`, normals too. Needs Open3D.
    fn to_open3d<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        interop_module(slf.py())?.call_method1("to_open3d", (slf,))
    }

    /// Convert the cloud to a `trimesh.PointCloud`. Needs trimesh.
    fn to_trimesh<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        interop_module(slf.py())?.call_method1("to_trimesh", (slf,))
    }

    /// Convert the cloud to a `pyvista.PolyData`, normals too. Needs pyvista.
    fn to_pyvista<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        interop_module(slf.py())?.call_method1("to_pyvista", (slf,))
    }

    /// Convert the cloud to a `laspy.LasData`, with all that LAS has a place for. Needs laspy.
    fn to_laspy<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        interop_module(slf.py())?.call_method1("to_laspy", (slf,))
    }

    /// Convert the cloud to a `small_gicp.PointCloud`. Needs small_gicp.
    fn to_small_gicp<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        interop_module(slf.py())?.call_method1("to_small_gicp", (slf,))
    }

    fn __len__(&self) -> usize {
        self.cloud.len()
    }

    #[pyo3(signature = (dtype=None, copy=None))]
    fn __array__<'py>(
        &self,
        py: Python<'py>,
        dtype: Option<Bound<'py, PyAny>>,
        copy: Option<bool>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let points = self.points(py)?;
        let own = points.getattr("dtype")?;
        let dtype = dtype.unwrap_or_else(|| own.clone());
        match copy {
            Some(true) => points.call_method1("astype", (dtype,)),
            Some(false) if !py.import("numpy")?.call_method1("dtype", (&dtype,))?.eq(&own)? => {
                let message = format!("copy: the points are {own}, another type takes a copy");
                Err(PyValueError::new_err(message))
            }
            _ => py.import("numpy")?.call_method1("asarray", (points, dtype)),
        }
    }

    fn __eq__(&self, py: Python<'_>, other: &Bound<'_, PyAny>) -> PyResult<bool> {
        let Ok(other) = other.cast::<Self>() else { return Ok(false) };
        let other = other.get();
        detach(py, || self.cloud == other.cloud)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let cloud = &self.cloud;
        let mut parts = vec![format!("{} points", cloud.len())];
        if cloud.dropped() > 0 {
            parts.push(format!("{} dropped", cloud.dropped()));
        }
        if cloud.normals().is_some() {
            parts.push("normals".into());
        }
        if cloud.weights().is_some() {
            parts.push("weights".into());
        }
        parts.extend(cloud.channels().names().map(String::from));
        parts.extend(cloud.descriptors().map(|rows| format!("{} descriptor values", rows.dim())));
        if let Some((low, high)) = detach(py, || cloud.bounds())? {
            parts.push(format!("from {} to {}", format_position(low), format_position(high)));
        }
        parts.extend(cloud.viewpoint().map(|at| format!("seen from {}", format_position(at))));
        Ok(format!("PointCloud({})", parts.join(", ")))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let this = slf.get();
        let Parts { points, origin, frame_origin, normals, viewpoint, dropped, no_returns, .. } =
            detach(py, || this.cloud.parts())?;
        let dropped = (dropped, no_returns);
        let normals = normals.map(|normals| to_array2(py, 3, normals.into_flattened()));
        let points = to_array2(py, 3, points.into_flattened());
        let channels = this.cloud.channels();
        let depth = |name: &str| Some((name.to_string(), channels.color_depth(name)?.max()));
        let depths: BTreeMap<String, u16> = channels.names().filter_map(depth).collect();
        let has = (this.weights(py), this.channels(py)?, depths, this.descriptors(py)?);
        let state = (points, origin, frame_origin, normals, viewpoint, dropped, has);
        (slf.get_type().getattr("_from_parts")?, state).into_pyobject(py)
    }

    /// Return a cloud from its pickle.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "the parts of a cloud")]
    fn _from_parts(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        origin: Vec3,
        frame_origin: Vec3,
        normals: Option<&Bound<'_, PyAny>>,
        viewpoint: Option<Vec3>,
        left_out: (usize, usize),
        has: PickledAttributes<'_>,
    ) -> PyResult<Self> {
        let rows = |any: &Bound<'_, PyAny>, name| match NumericArray::read(any, name, Some(3))? {
            NumericArray::F32(table) => {
                let rows = table.as_slice()?.as_chunks::<3>().0;
                detach(py, || rows.to_vec())
            }
            NumericArray::F64(_) => Err(to_pyerr(Error::config(name, "float64", "is float32"))),
        };
        let points = rows(points, "points")?;
        let normals = normals.map(|normals| rows(normals, "normals")).transpose()?;
        let own = RowSelection::new(points.len());
        let weights = has.0.map(|any| own.channel(&any, "weights")).transpose()?;
        let channels = own.channels(&has.1, &has.2)?;
        let descriptors = has.3.map(|any| own.descriptors(&any, "descriptors")).transpose()?;
        let (dropped, no_returns) = left_out;
        let parts = Parts {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            descriptors: descriptors.map(Arc::new),
            viewpoint,
            dropped,
            no_returns,
        };
        detach(py, || Cloud::from_parts(parts))?.map(Self::from).map_err(to_pyerr)
    }
}

/// Reads channels by name: a dict, or an object that can be converted to one, such as a data frame.
fn mapping<'py>(any: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    if let Ok(dict) = any.cast::<PyDict>() {
        return Ok(dict.clone());
    }
    let made = any.py().get_type::<PyDict>().call1((any,));
    let made = made.ok().and_then(|made| made.cast_into::<PyDict>().ok());
    made.ok_or_else(|| {
        let given = format_value(any);
        PyTypeError::new_err(format!(
            "channels: must be {{name: numbers, one a point}}, not {given}"
        ))
    })
}

/// Three numbers, six digits each.
fn format_position(at: Vec3) -> String {
    let digits = |x: f64| {
        if x.abs() >= 1e15 {
            return format!("{x:.3e}");
        }
        let text = format!("{x:.6}");
        let text = text.trim_end_matches('0').trim_end_matches('.');
        if x != 0.0 && text.trim_start_matches('-') == "0" {
            format!("{x:.3e}")
        } else {
            text.into()
        }
    };
    format!("[{}]", at.map(digits).join(", "))
}
