//! Conversion of arrays to rows of numbers, and back.
//!
//! Numpy copies the input once: other threads may then write into the array while it is processed,
//! and their changes are never read.

use std::borrow::Cow;

use numpy::ndarray::{Array2, Dimension};
use numpy::prelude::*;
use numpy::{Element, PyArray, PyArray2, PyReadonlyArray2, PyUntypedArray, dtype};
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use super::errors::{Error, SettingError, ShapeError, about, exception, non_finite, shown};
use super::shutdown::detached;
use cfreg::cloud::{Descriptors, Transform};
use cfreg::error::Error as Failure;
use cfreg::math::Vec3;

/// A table of numbers in row order without other owners: float32 input as it is, all else float64.
pub(super) enum Table<'py> {
    F32(PyReadonlyArray2<'py, f32>),
    F64(PyReadonlyArray2<'py, f64>),
}

impl<'py> Table<'py> {
    /// Reads an array (N, `width`), any width if that is `None`; `name` is the name of the argument
    /// in errors.
    pub(super) fn read(
        any: &Bound<'py, PyAny>,
        name: &str,
        width: Option<usize>,
    ) -> PyResult<Self> {
        let Ok(array) = any.cast::<PyUntypedArray>() else {
            let class = any.get_type().name()?;
            return Err(Error::new_err(format!("{name} must be an array of numbers, not {class}")));
        };
        let (py, found) = (any.py(), array.dtype());
        if found.has_fields() {
            let fields = shown(&found.getattr("names")?);
            let rule = "put those that are meant beside each other, as rows of numbers";
            return Err(Error::new_err(format!("{name} has the fields {fields}: {rule}")));
        }
        if !matches!(*array.shape(), [_, columns] if width.is_none_or(|width| width == columns)) {
            let width = width.map_or("D".into(), |width| width.to_string());
            let shape = any.getattr("shape")?;
            let message = format!("{name}: expected shape (N, {width}), found {shape}");
            return Err(ShapeError::new_err(message));
        }
        if found.is_equiv_to(&dtype::<f32>(py)) {
            return Ok(Table::F32(own_copy(any)?));
        }
        if found.is_equiv_to(&dtype::<f64>(py)) {
            return Ok(Table::F64(own_copy(any)?));
        }
        // Integers and floats of other kinds; neither booleans nor complex numbers.
        match found.kind() {
            b'i' | b'u' | b'f' => {
                let converted = any.call_method1("astype", ("float64", "C"))?;
                Ok(Table::F64(converted.cast::<PyArray2<f64>>()?.try_readonly()?))
            }
            _ => Err(Error::new_err(format!("{name} must be numbers, not {found}"))),
        }
    }

    /// Returns rows and columns.
    pub(super) fn shape(&self) -> [usize; 2] {
        match self {
            Table::F32(table) => [table.shape()[0], table.shape()[1]],
            Table::F64(table) => [table.shape()[0], table.shape()[1]],
        }
    }

    /// Refuses a NaN or an infinity in any row.
    pub(super) fn check_finite(&self, py: Python<'_>, name: &str) -> PyResult<()> {
        let [_, width] = self.shape();
        fn bad<T: Copy>(values: &[T], finite: impl Fn(T) -> bool) -> Option<usize> {
            values.iter().position(|&x| !finite(x))
        }
        let bad = match self {
            Table::F32(table) => {
                let values = table.as_slice()?;
                detached(py, || bad(values, f32::is_finite))?
            }
            Table::F64(table) => {
                let values = table.as_slice()?;
                detached(py, || bad(values, f64::is_finite))?
            }
        };
        bad.map_or(Ok(()), |at| Err(non_finite(name, at / width)))
    }

    /// Returns the values in f64, row after row.
    pub(super) fn values(&self, py: Python<'_>) -> PyResult<Cow<'_, [f64]>> {
        Ok(match self {
            Table::F32(table) => {
                let values = table.as_slice()?;
                detached(py, || values.iter().map(|&x| f64::from(x)).collect())?
            }
            Table::F64(table) => Cow::Borrowed(table.as_slice()?),
        })
    }
}

/// Copies in row order. Numpy lets other threads run during the copy.
fn own_copy<'py, T: Element>(any: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray2<'py, T>> {
    let copy = any.call_method1("copy", ("C",))?;
    Ok(copy.cast::<PyArray2<T>>()?.try_readonly()?)
}

/// Returns the array itself, or converts an array-like object: masked arrays, tensors, data frames.
pub(super) fn as_array<'py>(any: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    if any.get_type().is(PyUntypedArray::type_object(any.py())) {
        return Ok(any.clone());
    }
    interop(any.py())?.call_method1("array", (any, name))
}

/// Returns the Python module that supports other libraries.
pub(super) fn interop(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let import = || Ok::<_, PyErr>(py.import("cfreg._interop")?.unbind());
    Ok(MODULE.get_or_try_init(py, import)?.bind(py))
}

/// Reads a finite table (N, D), one row for each of the `points` of `owner`.
pub(super) fn table_for<'py>(
    any: &Bound<'py, PyAny>,
    name: &str,
    points: usize,
    owner: &str,
) -> PyResult<Table<'py>> {
    let py = any.py();
    let table = Table::read(&as_array(any, name)?, name, None)?;
    let [found, width] = table.shape();
    if width == 0 {
        return Err(ShapeError::new_err(format!("{name}: has no column")));
    }
    if found != points {
        let message = format!("{name}: expected {points} rows, as {owner} has, found {found}");
        return Err(ShapeError::new_err(message));
    }
    table.check_finite(py, name)?;
    Ok(table)
}

/// Reads numbers (N,), one for each of the `points` of `owner`.
pub(super) fn column_for(
    any: &Bound<'_, PyAny>,
    name: &str,
    points: usize,
    owner: &str,
) -> PyResult<Vec<f64>> {
    let array = as_array(any, name)?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    if shape.len() != 1 && shape != [points, 1] {
        let found = array.getattr("shape")?;
        let message =
            format!("{name}: expected shape ({points},), as {owner} has rows, found {found}");
        return Err(ShapeError::new_err(message));
    }
    let column = array.call_method1("reshape", (-1, 1))?;
    Ok(table_for(&column, name, points, owner)?.values(any.py())?.into_owned())
}

/// Reads the descriptors of both sides.
pub(super) fn descriptors(
    py: Python<'_>,
    source: &Table<'_>,
    target: &Table<'_>,
) -> PyResult<[Descriptors; 2]> {
    let ([_, from], [_, to]) = (source.shape(), target.shape());
    if from != to {
        let what = "columns of target_descriptors, against source_descriptors".into();
        return Err(exception(Failure::Shape { what, expected: from, found: to }));
    }
    let both = match (source, target) {
        (Table::F32(source), Table::F32(target)) => {
            let (source, target) = (source.as_slice()?, target.as_slice()?);
            let side = |values: &[f32]| Descriptors::new(from, values.to_vec());
            detached(py, || Ok([side(source)?, side(target)?]))?
        }
        _ => {
            let (source, target) = (source.values(py)?, target.values(py)?);
            detached(py, || Descriptors::from_f64_pair(from, &source, &target))?
        }
    };
    both.map_err(exception)
}

/// Reads three numbers.
pub(super) fn place(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec3> {
    any.extract().map_err(|_| {
        SettingError::new_err(format!("{name} = {}: must be three numbers", shown(any)))
    })
}

/// Reads a (4, 4) matrix, of any kind of number.
pub(super) fn pose(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Transform> {
    // A registration result is accepted for its pose; data frames have a method of that name.
    let matrix = any.getattr_opt("transform")?.filter(|matrix| !matrix.is_callable());
    let matrix = matrix.unwrap_or_else(|| any.clone());
    let found = as_array(&matrix, name).and_then(|array| Table::read(&array, name, Some(4)));
    let refused = || {
        let given = shown(&matrix);
        ShapeError::new_err(format!("{name}: must be a (4, 4) matrix of numbers, not {given}"))
    };
    let table = found.map_err(|_| refused())?;
    let rows: [[f64; 4]; 4] =
        table.values(any.py())?.as_chunks().0.try_into().map_err(|_| refused())?;
    Transform::from_matrix(rows).map_err(|error| about(name, error))
}

/// Creates an array (N, `width`) of `values`, row after row.
pub(super) fn table<T: Element>(
    py: Python<'_>,
    width: usize,
    values: Vec<T>,
) -> Bound<'_, PyArray2<T>> {
    let shape = (values.len() / width, width);
    let table = Array2::from_shape_vec(shape, values).expect("whole rows");
    PyArray2::from_owned_array(py, table)
}

/// Makes `array`, which has no other owner yet, read-only.
pub(super) fn read_only<'py, T: Element, D: Dimension>(
    array: Bound<'py, PyArray<T, D>>,
) -> Bound<'py, PyArray<T, D>> {
    array.readwrite().make_nonwriteable();
    array
}
