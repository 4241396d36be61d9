//! Arrays to rows of numbers, and back.
//!
//! What is read is copied once, by numpy: other threads may then write into the array while
//! it is worked with, and nothing is read from it that they wrote.

use numpy::ndarray::{Array2, Dimension};
use numpy::prelude::*;
use numpy::{Element, PyArray, PyArray2, PyReadonlyArray2, PyUntypedArray, dtype};
use pyo3::PyTypeInfo;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use super::errors::{ShapeError, about, non_finite};
use crate::cloud::Descriptors;
use crate::math::Vec3;

/// A table of numbers in row order that nobody else holds: float32 or float64.
pub(super) enum Table<'py> {
    F32(PyReadonlyArray2<'py, f32>),
    F64(PyReadonlyArray2<'py, f64>),
}

impl<'py> Table<'py> {
    /// Reads an array (N, `width`), any width where that is `None`; `name` is what errors
    /// call it.
    pub(super) fn read(
        any: &Bound<'py, PyAny>,
        name: &str,
        width: Option<usize>,
    ) -> PyResult<Self> {
        let Ok(array) = any.cast::<PyUntypedArray>() else {
            let class = any.get_type().name()?;
            let message =
                format!("{name} must be a numpy array of float32 or float64, not {class}");
            return Err(PyTypeError::new_err(message));
        };
        if !matches!(*array.shape(), [_, columns] if width.is_none_or(|width| width == columns)) {
            let width = width.map_or("D".into(), |width| width.to_string());
            let shape = any.getattr("shape")?;
            let message = format!("{name}: expected shape (N, {width}), found {shape}");
            return Err(ShapeError::new_err(message));
        }
        let (py, found) = (any.py(), array.dtype());
        if found.is_equiv_to(&dtype::<f32>(py)) {
            return Ok(Table::F32(own_copy(any)?));
        }
        if found.is_equiv_to(&dtype::<f64>(py)) {
            return Ok(Table::F64(own_copy(any)?));
        }
        let message =
            format!("{name} must be float32 or float64, not {found}: convert with astype");
        Err(PyTypeError::new_err(message))
    }

    /// Refuses a NaN or an infinity in any row.
    pub(super) fn check_finite(&self, py: Python<'_>, name: &str) -> PyResult<()> {
        fn bad_row<T: Copy>(values: &[T], finite: impl Fn(T) -> bool) -> Option<usize> {
            values.as_chunks::<3>().0.iter().position(|row| !row.iter().all(|&x| finite(x)))
        }
        let bad = match self {
            Table::F32(table) => {
                let values = table.as_slice()?;
                py.detach(|| bad_row(values, f32::is_finite))
            }
            Table::F64(table) => {
                let values = table.as_slice()?;
                py.detach(|| bad_row(values, f64::is_finite))
            }
        };
        bad.map_or(Ok(()), |row| Err(non_finite(name, row)))
    }

    /// Rows of three in f64.
    pub(super) fn triples(&self, py: Python<'_>) -> PyResult<Vec<Vec3>> {
        Ok(match self {
            Table::F32(table) => {
                let rows = table.as_slice()?.as_chunks::<3>().0;
                py.detach(|| rows.iter().map(|row| row.map(f64::from)).collect())
            }
            Table::F64(table) => {
                let rows = table.as_slice()?.as_chunks::<3>().0;
                py.detach(|| rows.to_vec())
            }
        })
    }
}

/// A copy in row order. numpy lets other threads run while it makes one.
fn own_copy<'py, T: Element>(any: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray2<'py, T>> {
    let copy = any.call_method1("copy", ("C",))?;
    Ok(copy.cast::<PyArray2<T>>()?.try_readonly()?)
}

/// The array itself, or what stands for one: masked arrays, tensors, data frames.
pub(super) fn as_array<'py>(any: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    if any.get_type().is(PyUntypedArray::type_object(any.py())) {
        return Ok(any.clone());
    }
    interop(any.py())?.call_method1("array", (any, name))
}

/// The Python side's knowledge of other libraries.
pub(super) fn interop(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let import = || Ok::<_, PyErr>(py.import("cfreg._interop")?.unbind());
    Ok(MODULE.get_or_try_init(py, import)?.bind(py))
}

/// Descriptors (N, D), one row for each of the `points` of `owner`.
pub(super) fn descriptors(
    any: &Bound<'_, PyAny>,
    name: &str,
    points: usize,
    owner: &str,
) -> PyResult<Descriptors> {
    let (py, array) = (any.py(), as_array(any, name)?);
    let table = Table::read(&array, name, None)?;
    let rows = match &table {
        Table::F32(table) => {
            let (width, values) = (table.shape()[1], table.as_slice()?);
            py.detach(|| Descriptors::new(width, values.to_vec()))
        }
        Table::F64(table) => {
            let (width, values) = (table.shape()[1], table.as_slice()?);
            // Too large for f32 becomes infinite, which is refused.
            py.detach(|| Descriptors::new(width, values.iter().map(|&x| x as f32).collect()))
        }
    };
    let rows = rows.map_err(|error| about(name, error))?;
    if rows.len() != points {
        let found = rows.len();
        let message = format!("{name}: expected {points} rows, as {owner} has, found {found}");
        return Err(ShapeError::new_err(message));
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
pub(super) fn read_only<'py, T: Element, D: Dimension>(
    array: Bound<'py, PyArray<T, D>>,
) -> Bound<'py, PyArray<T, D>> {
    array.readwrite().make_nonwriteable();
    array
}
