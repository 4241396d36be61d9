//! Arrays to clouds and descriptors, and back.

use numpy::ndarray::Array2;
use numpy::prelude::*;
use numpy::{Element, PyArray, PyArray2, PyUntypedArray, dtype};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use super::errors::{about, non_finite};
use crate::cloud::{Descriptors, PointCloud};
use crate::math::Vec3;

/// A table of numbers as Python gave it: float32 or float64, in row order.
pub(super) enum Table {
    F32 { width: usize, values: Vec<f32> },
    F64 { width: usize, values: Vec<f64> },
}

impl Table {
    /// Reads an array (N, `width`), any width where that is `None`.
    fn read(any: &Bound<'_, PyAny>, name: &str, width: Option<usize>) -> PyResult<Self> {
        let Ok(array) = any.cast::<PyUntypedArray>() else {
            let class = any.get_type().name()?;
            let message =
                format!("{name} must be a numpy array of float32 or float64, not {class}");
            return Err(PyTypeError::new_err(message));
        };
        let columns = match *array.shape() {
            [_, columns] if width.is_none_or(|width| width == columns) => columns,
            _ => {
                let width = width.map_or("D".into(), |width| width.to_string());
                let shape = any.getattr("shape")?;
                let message = format!("{name}: expected shape (N, {width}), found {shape}");
                return Err(PyValueError::new_err(message));
            }
        };
        let (py, found) = (any.py(), array.dtype());
        if found.is_equiv_to(&dtype::<f32>(py)) {
            return Ok(Table::F32 { width: columns, values: in_row_order(any)? });
        }
        if found.is_equiv_to(&dtype::<f64>(py)) {
            return Ok(Table::F64 { width: columns, values: in_row_order(any)? });
        }
        let message =
            format!("{name} must be float32 or float64, not {found}: convert with astype");
        Err(PyTypeError::new_err(message))
    }

    /// Rows of three in f64.
    fn triples(self) -> Vec<Vec3> {
        match self {
            Table::F32 { values, .. } => triples(&values, f64::from),
            Table::F64 { values, .. } => triples(&values, |x| x),
        }
    }
}

/// The values row by row. Python's copy comes first where the array is strided, and where
/// its fields are packed so that strides are no multiple of a value's size.
fn in_row_order<T: Element + Copy>(any: &Bound<'_, PyAny>) -> PyResult<Vec<T>> {
    let array = any.cast::<PyArray2<T>>()?.try_readonly()?;
    if array.is_c_contiguous()
        && let Ok(values) = array.as_slice()
    {
        return Ok(values.to_vec());
    }
    let copy = any.call_method1("copy", ("C",))?;
    Ok(copy.cast::<PyArray2<T>>()?.try_readonly()?.as_slice()?.to_vec())
}

fn triples<T: Copy>(values: &[T], widen: impl Fn(T) -> f64) -> Vec<Vec3> {
    values.as_chunks::<3>().0.iter().map(|row| row.map(&widen)).collect()
}

/// Rows (N, 3) of an array; an error names the first that is not finite.
pub(super) fn rows(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<Vec3>> {
    let rows = Table::read(any, name, Some(3))?.triples();
    match rows.iter().position(|row| row.iter().any(|x| !x.is_finite())) {
        Some(row) => Err(non_finite(name, row)),
        None => Ok(rows),
    }
}

/// A cloud that keeps every row: one that is not finite is an error, since what belongs to
/// the others would shift.
pub(super) fn whole_cloud(any: &Bound<'_, PyAny>, name: &str) -> PyResult<PointCloud> {
    PointCloud::new(&rows(any, name)?).map_err(|error| about(name, error))
}

/// A cloud that drops and counts rows that are not finite.
pub(super) fn cloud(any: &Bound<'_, PyAny>, name: &str) -> PyResult<PointCloud> {
    let rows = Table::read(any, name, Some(3))?.triples();
    PointCloud::new(&rows).map_err(|error| about(name, error))
}

/// Descriptors (N, D), one row for each of the `points` of `owner`.
pub(super) fn descriptors(
    any: &Bound<'_, PyAny>,
    name: &str,
    points: usize,
    owner: &str,
) -> PyResult<Descriptors> {
    let (width, values) = match Table::read(any, name, None)? {
        Table::F32 { width, values } => (width, values),
        // Too large for f32 becomes infinite, which is refused below.
        Table::F64 { width, values } => (width, values.iter().map(|&x| x as f32).collect()),
    };
    let rows = Descriptors::new(width, values).map_err(|error| about(name, error))?;
    if rows.len() != points {
        let found = rows.len();
        let message = format!("{name}: expected {points} rows, as {owner} has, found {found}");
        return Err(PyValueError::new_err(message));
    }
    Ok(rows)
}

/// An array (N, `width`) of `values`, row after row.
pub(super) fn table<T: Element>(
    py: Python<'_>,
    width: usize,
    values: Vec<T>,
) -> Bound<'_, PyArray2<T>> {
    let shape = (values.len() / width, width);
    let table = Array2::from_shape_vec(shape, values).expect("whole rows");
    PyArray2::from_owned_array(py, table)
}

/// `array`, which nobody else holds yet, made read-only.
pub(super) fn read_only<'py, T: Element, D: numpy::ndarray::Dimension>(
    array: Bound<'py, PyArray<T, D>>,
) -> Bound<'py, PyArray<T, D>> {
    array.readwrite().make_nonwriteable();
    array
}
