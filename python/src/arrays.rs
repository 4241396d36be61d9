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

use super::errors::{
    Error, SettingError, ShapeError, argument_error, format_value, non_finite_error, to_pyerr,
};
use super::shutdown::detach;
use cfreg::cloud::{Descriptors, Transform};
use cfreg::error::Error as Failure;
use cfreg::math::Vec3;

/// A table of numbers in row order that nobody else holds: float32 as it came, all else float64.
pub(super) enum NumericArray<'py> {
    F32(PyReadonlyArray2<'py, f32>),
    F64(PyReadonlyArray2<'py, f64>),
}

impl<'py> NumericArray<'py> {
    /// Reads an array (N, `width`), any width where that is `None`; `name` is what errors
    /// call it.
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
            let fields = format_value(&found.getattr("names")?);
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
            return Ok(NumericArray::F32(contiguous_copy(any)?));
        }
        if found.is_equiv_to(&dtype::<f64>(py)) {
            return Ok(NumericArray::F64(contiguous_copy(any)?));
        }
        // Integers and floats of other kinds; neither booleans nor complex numbers.
        match found.kind() {
            b'i' | b'u' | b'f' => {
                let converted = any.call_method1("astype", ("float64", "C"))?;
                Ok(NumericArray::F64(converted.cast::<PyArray2<f64>>()?.try_readonly()?))
            }
            _ => Err(Error::new_err(format!("{name} must be numbers, not {found}"))),
        }
    }

    /// Returns rows and columns.
    pub(super) fn shape(&self) -> [usize; 2] {
        match self {
            NumericArray::F32(table) => [table.shape()[0], table.shape()[1]],
            NumericArray::F64(table) => [table.shape()[0], table.shape()[1]],
        }
    }

    /// Refuses a NaN or an infinity in any row.
    pub(super) fn check_finite(&self, py: Python<'_>, name: &str) -> PyResult<()> {
        let [_, width] = self.shape();
        fn bad<T: Copy>(values: &[T], finite: impl Fn(T) -> bool) -> Option<usize> {
            values.iter().position(|&x| !finite(x))
        }
        let bad = match self {
            NumericArray::F32(table) => {
                let values = table.as_slice()?;
                detach(py, || bad(values, f32::is_finite))?
            }
            NumericArray::F64(table) => {
                let values = table.as_slice()?;
                detach(py, || bad(values, f64::is_finite))?
            }
        };
        bad.map_or(Ok(()), |at| Err(non_finite_error(name, at / width)))
    }

    /// Returns the values in f64, row after row.
    pub(super) fn values(&self, py: Python<'_>) -> PyResult<Cow<'_, [f64]>> {
        Ok(match self {
            NumericArray::F32(table) => {
                let values = table.as_slice()?;
                detach(py, || values.iter().map(|&x| f64::from(x)).collect())?
            }
            NumericArray::F64(table) => Cow::Borrowed(table.as_slice()?),
        })
    }
}

/// A copy in row order. numpy lets other threads run while it makes one.
fn contiguous_copy<'py, T: Element>(any: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArray2<'py, T>> {
    let copy = any.call_method1("copy", ("C",))?;
    Ok(copy.cast::<PyArray2<T>>()?.try_readonly()?)
}

/// Returns the array itself, or converts an array-like object: masked arrays, tensors, data frames.
pub(super) fn as_array<'py>(any: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    if any.get_type().is(PyUntypedArray::type_object(any.py())) {
        return Ok(any.clone());
    }
    interop_module(any.py())?.call_method1("array", (any, name))
}

/// The Python side's knowledge of other libraries.
pub(super) fn interop_module(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let import = || Ok::<_, PyErr>(py.import("cfreg._interop")?.unbind());
    Ok(MODULE.get_or_try_init(py, import)?.bind(py))
}

/// A table (N, D) that is finite, one row for each of the `points` of `owner`.
pub(super) fn array_for_points<'py>(
    any: &Bound<'py, PyAny>,
    name: &str,
    points: usize,
    owner: &str,
) -> PyResult<NumericArray<'py>> {
    let py = any.py();
    let table = NumericArray::read(&as_array(any, name)?, name, None)?;
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

/// Numbers (N,), one for each of the `points` of `owner`.
pub(super) fn values_for_points(
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
    Ok(array_for_points(&column, name, points, owner)?.values(any.py())?.into_owned())
}

/// Reads the descriptors of both sides.
pub(super) fn descriptors(
    py: Python<'_>,
    source: &NumericArray<'_>,
    target: &NumericArray<'_>,
) -> PyResult<[Descriptors; 2]> {
    let ([_, from], [_, to]) = (source.shape(), target.shape());
    if from != to {
        let what = "columns of target_descriptors, against source_descriptors".into();
        return Err(to_pyerr(Failure::Shape { what, expected: from, found: to }));
    }
    let both = match (source, target) {
        (NumericArray::F32(source), NumericArray::F32(target)) => {
            let (source, target) = (source.as_slice()?, target.as_slice()?);
            let side = |values: &[f32]| Descriptors::new(from, values.to_vec());
            detach(py, || Ok([side(source)?, side(target)?]))?
        }
        _ => {
            let (source, target) = (source.values(py)?, target.values(py)?);
            detach(py, || Descriptors::from_f64_pair(from, &source, &target))?
        }
    };
    both.map_err(to_pyerr)
}

/// Three numbers.
pub(super) fn parse_vec3(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec3> {
    any.extract().map_err(|_| {
        SettingError::new_err(format!("{name} = {}: must be three numbers", format_value(any)))
    })
}

/// A (4, 4) matrix, of any kind of number.
pub(super) fn parse_pose(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Transform> {
    // A registration stands for its pose; data frames have a method of that name.
    let matrix = any.getattr_opt("transform")?.filter(|matrix| !matrix.is_callable());
    let matrix = matrix.unwrap_or_else(|| any.clone());
    let found = as_array(&matrix, name).and_then(|array| NumericArray::read(&array, name, Some(4)));
    let refused = || {
        let given = format_value(&matrix);
        ShapeError::new_err(format!("{name}: must be a (4, 4) matrix of numbers, not {given}"))
    };
    let table = found.map_err(|_| refused())?;
    let rows: [[f64; 4]; 4] =
        table.values(any.py())?.as_chunks().0.try_into().map_err(|_| refused())?;
    Transform::from_matrix(rows).map_err(|error| argument_error(name, error))
}

/// An array (N, `width`) of `values`, row after row.
pub(super) fn to_array2<T: Element>(
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
