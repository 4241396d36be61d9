//! Clouds made of arrays, and of what other libraries have for a cloud.

use numpy::PyUntypedArray;
use pyo3::PyTypeInfo;
use pyo3::prelude::*;

use super::arrays::{Table, as_array, interop};
use super::detached::detached;
use super::errors::{ShapeError, about, exception};
use super::rows::Rows;
use crate::cloud::{Channels, ColorDepth, PointCloud};

/// What becomes of rows that are not finite.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum BadRows {
    /// They are left out and counted.
    Drop,
    /// The first is an error: what belongs to the others would shift.
    Refuse,
}

/// The cloud that `any` stands for; `name` is what errors call it, `normals` take the place of
/// its own.
pub(super) fn read<'py>(
    any: &Bound<'py, PyAny>,
    name: &str,
    normals: Option<&Bound<'py, PyAny>>,
    bad_rows: BadRows,
) -> PyResult<PointCloud> {
    let py = any.py();
    let (points, own): (Bound<'py, PyAny>, Option<Bound<'py, PyAny>>) =
        match any.get_type().is(PyUntypedArray::type_object(py)) {
            true => (any.clone(), None),
            false => interop(py)?.call_method1("parts", (any, name))?.extract()?,
        };
    let points = Table::read(&points, name, Some(3))?;
    if bad_rows == BadRows::Refuse {
        points.check_finite(py, name)?;
    }
    let Some(normals) = normals.or(own.as_ref()) else {
        let cloud = match &points {
            Table::F32(table) => {
                let rows = table.as_slice()?.as_chunks().0;
                detached(py, || PointCloud::from_f32(rows))
            }
            Table::F64(table) => {
                let rows = table.as_slice()?.as_chunks().0;
                detached(py, || PointCloud::new(rows))
            }
        };
        let cloud = cloud.map_err(|error| about(name, error))?;
        return colored(cloud, any);
    };
    let normals = Table::read(&as_array(normals, "normals")?, "normals", Some(3))?;
    if bad_rows == BadRows::Refuse {
        normals.check_finite(py, "normals")?;
    }
    let (points, normals) = (points.values(py)?, normals.values(py)?);
    let (points, normals) = (points.as_chunks().0, normals.as_chunks().0);
    if points.len() != normals.len() {
        let (expected, found) = (points.len(), normals.len());
        return Err(ShapeError::new_err(format!(
            "normals: expected {expected} rows, as {name} has, found {found}"
        )));
    }
    let cloud = detached(py, || PointCloud::with_normals(points, normals));
    let cloud = cloud.map_err(|error| about(name, error))?;
    colored(cloud, any)
}

/// The cloud with the colours of what it was made from, where that has any.
fn colored(cloud: PointCloud, any: &Bound<'_, PyAny>) -> PyResult<PointCloud> {
    let py = any.py();
    if any.get_type().is(PyUntypedArray::type_object(py)) {
        return Ok(cloud);
    }
    let colors = interop(py)?.call_method1("colors", (any,))?;
    if colors.is_none() {
        return Ok(cloud);
    }
    let rows = Rows::of(any, &cloud)?;
    let mut channels = Channels::default();
    for (axis, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let column = colors.get_item((py.Ellipsis(), axis))?;
        // Files have them as whole numbers, as that library's own.
        let values = rows.channel(&column, "colors")?;
        channels = channels.with_color(name, values, ColorDepth::Eight).map_err(exception)?;
    }
    cloud.with_channels(channels).map_err(exception)
}
