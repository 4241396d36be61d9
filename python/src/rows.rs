//! Data per input row of points: a column of numbers for each.

use std::collections::BTreeMap;

use numpy::prelude::*;
use numpy::{PyArray1, PyUntypedArray};
use pyo3::PyTypeInfo;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arrays::{NumericArray, as_array, interop_module};
use super::errors::{Error, ShapeError, argument_error, format_value, non_finite_error, to_pyerr};
use super::shutdown::detach;
use cfreg::cloud::{Channels, ColorDepth, Descriptors, PointCloud};

/// The rows of points that were handed over, and which of them a cloud keeps.
pub(super) struct RowSelection {
    number: usize,
    /// Indices of the kept rows; `None` if all are kept.
    kept: Option<Vec<usize>>,
}

impl RowSelection {
    /// `number` rows, all of them kept.
    pub(super) fn new(number: usize) -> Self {
        RowSelection { number, kept: None }
    }

    /// The rows of `points`, of which `cloud` was made.
    pub(super) fn from_points(points: &Bound<'_, PyAny>, cloud: &PointCloud) -> PyResult<Self> {
        let number = cloud.len() + cloud.dropped();
        if cloud.dropped() == 0 {
            return Ok(RowSelection::new(number));
        }
        let py = points.py();
        let array = match points.get_type().is(PyUntypedArray::type_object(py)) {
            true => points.clone(),
            false => interop_module(py)?.call_method1("parts", (points, "points"))?.get_item(0)?,
        };
        let finite = py.import("numpy")?.call_method1("isfinite", (array,))?;
        let finite: Vec<bool> =
            finite.call_method1("all", (1,))?.call_method0("tolist")?.extract()?;
        Ok(RowSelection { number, kept: Some((0..number).filter(|&row| finite[row]).collect()) })
    }

    /// Reads numbers (N,), of any kind and one a row, and returns those of the kept rows.
    pub(super) fn column(&self, any: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<f64>> {
        let array = as_array(any, name)?;
        let refused = || {
            let given = format_value(&array);
            Error::new_err(format!("{name}: must be numbers, one a point, not {given}"))
        };
        let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
        // Neither strings nor complex numbers, both of which numpy would convert.
        if !"biufO".contains(&kind) {
            return Err(refused());
        }
        let column = array.call_method1("astype", ("float64",)).map_err(|_| refused())?;
        let shape: Vec<usize> = column.getattr("shape")?.extract()?;
        if shape != [self.number] {
            let (expected, found) = (self.number, column.getattr("shape")?);
            let message =
                format!("{name}: expected shape ({expected},), one a point, found {found}");
            return Err(ShapeError::new_err(message));
        }
        let column = column.cast::<PyArray1<f64>>()?.try_readonly()?;
        let all = column.as_slice().map(<[f64]>::to_vec).or_else(|_| column.to_vec())?;
        Ok(match &self.kept {
            Some(kept) => kept.iter().map(|&row| all[row]).collect(),
            None => all,
        })
    }

    /// Reads descriptors (N, D), numbers of any kind, one row a row, and returns those of the kept
    /// rows in f32.
    pub(super) fn descriptors(&self, any: &Bound<'_, PyAny>, name: &str) -> PyResult<Descriptors> {
        let py = any.py();
        let table = NumericArray::read(&as_array(any, name)?, name, None)?;
        let [found, width] = table.shape();
        if found != self.number {
            let expected = self.number;
            let message = format!(
                "{name}: expected shape ({expected}, D), one row a point, found ({found}, {width})"
            );
            return Err(ShapeError::new_err(message));
        }
        let values: Vec<f32> = match &table {
            NumericArray::F32(table) => table.as_slice()?.to_vec(),
            NumericArray::F64(table) => table.as_slice()?.iter().map(|&x| x as f32).collect(),
        };
        let kept = self.kept.as_ref();
        let values = match kept {
            Some(kept) => {
                kept.iter().flat_map(|&i| &values[i * width..][..width]).copied().collect()
            }
            None => values,
        };
        detach(py, || Descriptors::new(width, values))?.map_err(|error| match error {
            cfreg::Error::NonFinite { index, .. } => {
                non_finite_error(name, kept.map_or(index, |kept| kept[index]))
            }
            other => argument_error(name, other),
        })
    }

    /// Reads a column as f32 values of a channel.
    pub(super) fn channel(&self, any: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<f32>> {
        Ok(self.column(any, name)?.into_iter().map(|x| x as f32).collect())
    }

    /// Reads the channels {name: numbers (N,)}; channels with a largest integer are colours.
    pub(super) fn channels(
        &self,
        given: &Bound<'_, PyDict>,
        depths: &BTreeMap<String, u16>,
    ) -> PyResult<Channels> {
        let mut channels = Channels::default();
        for (name, values) in given {
            let Ok(name) = name.extract::<String>() else {
                let message = format!("channels: names must be texts, not {}", format_value(&name));
                return Err(PyTypeError::new_err(message));
            };
            let values = self.channel(&values, &format!("channels[{name:?}]"))?;
            let of_max = |&depth: &ColorDepth| depths.get(&name) == Some(&depth.max());
            let depth = [ColorDepth::Eight, ColorDepth::Sixteen].into_iter().find(of_max);
            channels = match depth {
                Some(depth) => channels.with_color(&name, values, depth),
                None => channels.with(&name, values),
            }
            .map_err(to_pyerr)?;
        }
        Ok(channels)
    }
}
