//! Clouds from arrays, and from the point clouds of other libraries.

use numpy::PyUntypedArray;
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{NumericArray, interop_module};
use super::cloud::PyCloud;
use super::errors::{ShapeError, argument_error, to_pyerr};
use super::rows::RowSelection;
use super::shutdown::detach;
use cfreg::cloud::{Channels, ColorDepth, PointCloud};
use cfreg::math::Vec3;

/// Treatment of rows that are not finite.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum BadRows {
    /// These rows are dropped and counted.
    Drop,
    /// The first is an error: data of the following rows would shift.
    Refuse,
}

/// The cloud that `any` stands for; `name` is what errors call it, `normals` take the place of
/// its own.
pub(super) fn read_cloud<'py>(
    any: &Bound<'py, PyAny>,
    name: &str,
    normals: Option<&Bound<'py, PyAny>>,
    bad_rows: BadRows,
) -> PyResult<PointCloud> {
    let py = any.py();
    let (points, own): (Bound<'py, PyAny>, Option<Bound<'py, PyAny>>) =
        match any.get_type().is(PyUntypedArray::type_object(py)) {
            true => (any.clone(), None),
            false => interop_module(py)?.call_method1("parts", (any, name))?.extract()?,
        };
    let points = NumericArray::read(&points, name, Some(3))?;
    if bad_rows == BadRows::Refuse {
        points.check_finite(py, name)?;
    }
    let Some(normals) = normals.or(own.as_ref()) else {
        let cloud = match &points {
            NumericArray::F32(table) => {
                let rows = table.as_slice()?.as_chunks().0;
                detach(py, || PointCloud::from_f32(rows))?
            }
            NumericArray::F64(table) => {
                let rows = table.as_slice()?.as_chunks().0;
                detach(py, || PointCloud::new(rows))?
            }
        };
        let cloud = cloud.map_err(|error| argument_error(name, error))?;
        return with_attributes(cloud, any);
    };
    let normals = interop_module(py)?.call_method1("normals", (normals,))?;
    let normals = NumericArray::read(&normals, "normals", Some(3))?;
    if bad_rows == BadRows::Refuse {
        normals.check_finite(py, "normals")?;
    }
    let (points, normals) = (points.values(py)?, normals.values(py)?);
    let (points, normals) = (points.as_chunks().0, normals.as_chunks().0);
    if points.len() != normals.len() {
        let (expected, found) = (points.len(), normals.len());
        let hint = dropped_rows_hint(any, name, points, found);
        return Err(ShapeError::new_err(format!(
            "normals: expected {expected} rows, as {name} has, found {found}{hint}"
        )));
    }
    let cloud = detach(py, || PointCloud::with_normals(points, normals))?;
    let cloud = cloud.map_err(|error| argument_error(name, error))?;
    with_attributes(cloud, any)
}

/// A hint where normals seem to be those of the points without, or with, the rows that a cloud leaves
/// out.
fn dropped_rows_hint(
    any: &Bound<'_, PyAny>,
    name: &str,
    points: &[Vec3],
    normals: usize,
) -> String {
    let bad = points.iter().filter(|point| point.iter().any(|x| !x.is_finite())).count();
    let dropped = any.cast::<PyCloud>().map_or(0, |given| given.get().cloud().dropped());
    if bad > 0 && normals + bad == points.len() {
        return format!(
            ": {bad} rows of {name} are not finite; give the PointCloud without them that the normals \
             were estimated of, in place of {name}"
        );
    }
    if dropped > 0 && normals == points.len() + dropped {
        return format!(
            ": this PointCloud has left out {dropped} rows; estimate normals of it, or give them \
             together with the points that it was made of"
        );
    }
    String::new()
}

/// Adds the colours, weights and channels of the input object, if it has any.
fn with_attributes(cloud: PointCloud, any: &Bound<'_, PyAny>) -> PyResult<PointCloud> {
    let py = any.py();
    if any.get_type().is(PyUntypedArray::type_object(py)) || any.cast::<PyCloud>().is_ok() {
        return Ok(cloud);
    }
    let found = interop_module(py)?.call_method1("attributes", (any,))?;
    let (weights, columns): (Option<Bound<'_, PyAny>>, Bound<'_, PyDict>) = found.extract()?;
    if weights.is_none() && columns.is_empty() {
        return Ok(cloud);
    }
    let rows = RowSelection::from_points(any, &cloud)?;
    let mut cloud = cloud;
    // Nobody has requested these: invalid ones are left out.
    if let Some(weights) = weights {
        let weights = rows.column(&weights, "weights")?;
        if weights.iter().all(|w| w.is_finite() && *w >= 0.0) && weights.iter().any(|w| *w > 0.0) {
            cloud = cloud.with_weights(weights).map_err(to_pyerr)?;
        }
    }
    let mut channels = Channels::default();
    for (name, column) in columns {
        let name: String = name.extract()?;
        let column = rows.channel(&column, &name)?;
        if !column.iter().all(|x| x.is_finite()) {
            continue;
        }
        let in_range = column.iter().all(|x| (0.0..=1.0).contains(x));
        let color = in_range && ["red", "green", "blue"].contains(&name.as_str());
        // Files store colours as integers, as in that library's own files.
        channels = match color {
            true => channels.with_color(&name, column, ColorDepth::Eight),
            false => channels.with(&name, column),
        }
        .map_err(to_pyerr)?;
    }
    cloud.with_channels(channels).map_err(to_pyerr)
}
