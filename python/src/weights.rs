//! Weights from Python: a name, a composite of kernels, or a function on tiles.

use std::sync::Mutex;

use numpy::prelude::*;
use numpy::{PyArray1, PyArray2, dtype};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyType;

use super::arrays::{interop_module, to_array2};
use super::errors::{SettingError, ShapeError, argument_error, settings_error, to_pyerr};
use super::gil::Pool;
use super::panics::catch_panic;
use super::shutdown::detach;
use cfreg::error::Result;
use cfreg::moments::{FullConnection, Moments};
use cfreg::par;
use cfreg::weight::{Bandwidth, Composite, Normalization, WeightKernel, WeightScheme};

/// Weights of connections.
pub(super) enum Weights {
    /// A kernel of the catalogue, whose bandwidth is passed separately.
    Named(WeightScheme),
    /// Something that needs no bandwidth beside it.
    Custom(CustomWeights),
}

/// Weights that carry all they need.
pub(super) enum CustomWeights {
    Composite(Composite),
    Function(PythonKernel),
}

impl Weights {
    /// Reads `"gaussian"`, a kernel of `cfreg.weights`, or any callable; `name` is the name of the
    /// argument in errors.
    pub(super) fn read(any: &Bound<'_, PyAny>, name: &str) -> PyResult<Self> {
        if let Ok(text) = any.extract::<String>() {
            return text.parse().map(Weights::Named).map_err(|error| argument_error(name, error));
        }
        if let Ok(class) = any.cast::<PyType>() {
            let class = class.name()?;
            let rule = "is a class: make a kernel of it first";
            return Err(PyTypeError::new_err(format!("{name}: {class} {rule}, {class}(...)")));
        }
        if let Some(json) = any.getattr_opt("_json")?
            && let Some(json) = json.call0()?.extract::<Option<String>>()?
        {
            return Ok(Weights::Custom(CustomWeights::Composite(composite(&json, name)?)));
        }
        if any.is_callable() {
            return Ok(Weights::Custom(CustomWeights::Function(PythonKernel::new(
                any.clone().unbind(),
            ))));
        }
        let class = any.get_type().name()?;
        let rule = "must be a name, a kernel of cfreg.weights or a function of squared distances";
        Err(PyTypeError::new_err(format!("{name} {rule}, not {class}")))
    }
}

impl CustomWeights {
    /// Where to weigh: a function may take a lock that other calls are made under.
    pub(super) fn pool(&self) -> Pool {
        match self {
            CustomWeights::Composite(_) => Pool::Shared,
            CustomWeights::Function(_) => Pool::Own,
        }
    }

    pub(super) fn moments(
        &self,
        connection: &FullConnection,
        normalization: Normalization,
    ) -> Result<Moments> {
        match self {
            CustomWeights::Composite(composite) => {
                let kernel = composite.resolve(|beta| connection.bandwidth(beta))?;
                connection.moments(&kernel, normalization)
            }
            CustomWeights::Function(function) => connection.moments(function, normalization),
        }
    }

    /// The exception that a function of these weights has raised, if one has; else `outcome`.
    pub(super) fn reraise<T>(&self, outcome: PyResult<T>) -> PyResult<T> {
        let raised = match self {
            CustomWeights::Function(function) => {
                function.raised.lock().ok().and_then(|mut raised| raised.take())
            }
            CustomWeights::Composite(_) => None,
        };
        raised.map_or(outcome, Err)
    }
}

/// A Python function from an array (sources, targets) of squared distances to as many
/// weights.
pub(super) struct PythonKernel {
    function: Py<PyAny>,
    /// The first exception that the function raised.
    raised: Mutex<Option<PyErr>>,
}

impl PythonKernel {
    fn new(function: Py<PyAny>) -> Self {
        PythonKernel { function, raised: Mutex::new(None) }
    }

    fn call(&self, py: Python<'_>, d2: &mut [f32], width: usize) -> PyResult<()> {
        let given = to_array2(py, width, d2.to_vec());
        let found = self.function.call1(py, (&given,))?;
        let found = interop_module(py)?.call_method1("weights", (found,))?;
        // Truths and whole numbers are weights, complex numbers are not.
        let refused = |_| {
            let found = found.getattr("dtype").unwrap_or_else(|_| found.clone());
            let rule = "must be real numbers";
            PyTypeError::new_err(format!("weights: the function returned {found}: weights {rule}"))
        };
        let arguments = (dtype::<f32>(py), "C", "same_kind");
        let found = found.call_method1("astype", arguments).map_err(refused)?;
        let (shape, own) = (given.getattr("shape")?, found.getattr("shape")?);
        if !own.eq(&shape)? {
            return Err(ShapeError::new_err(format!(
                "weights: the function returned shape {own}, expected {shape}: return one weight \
                 for every squared distance"
            )));
        }
        d2.copy_from_slice(found.cast::<PyArray2<f32>>()?.try_readonly()?.as_slice()?);
        match d2.iter().find(|w| !(w.is_finite() && **w >= 0.0)) {
            None => Ok(()),
            Some(bad) => Err(SettingError::new_err(format!(
                "weights: the function returned {bad}: weights must be finite and not negative"
            ))),
        }
    }
}

impl WeightKernel for PythonKernel {
    fn weight(&self, d2: f32) -> f32 {
        let mut tile = [d2];
        self.fill_tile(&mut tile, 1);
        tile[0]
    }

    fn takes_tiles(&self) -> bool {
        true
    }

    fn fill_tile(&self, d2: &mut [f32], width: usize) {
        match Python::try_attach(|py| self.call(py, d2, width)) {
            Some(Ok(())) => {}
            Some(Err(error)) => {
                if let Ok(mut raised) = self.raised.lock() {
                    raised.get_or_insert(error);
                }
                par::stop()
            }
            // The interpreter is gone.
            None => par::stop(),
        }
    }
}

/// Return weights (N,) of squared distances (N,) float32, as the connection computes them, for a
/// kernel in JSON.
#[pyfunction]
pub(super) fn kernel_weights<'py>(
    py: Python<'py>,
    kernel: &str,
    squared_distances: &Bound<'py, PyArray1<f32>>,
) -> PyResult<Bound<'py, PyArray1<f32>>> {
    let kernel = composite(kernel, "kernel")?.resolve(Ok).map_err(to_pyerr)?;
    let mut d2 = squared_distances.to_vec()?;
    detach(py, || kernel.fill(&mut d2))?;
    Ok(PyArray1::from_vec(py, d2))
}

/// Refuse a kernel, in JSON, that cannot weight connections.
#[pyfunction]
pub(super) fn check_kernel(kernel: &str) -> PyResult<()> {
    // Bandwidths derived from descriptors are within the range.
    let any = |bandwidth: Bandwidth| match bandwidth {
        Bandwidth::Fixed(beta) => Ok(beta),
        Bandwidth::Auto(_) => bandwidth.validate().map(|()| 1.0),
    };
    let kernel = composite(kernel, "kernel")?;
    catch_panic(|| kernel.resolve(any).map(|_| ()))?.map_err(to_pyerr)
}

/// Parses a kernel in JSON, with kernels' names and numbers; `name` is the name of the argument in
/// errors.
fn composite(json: &str, name: &str) -> PyResult<Composite> {
    serde_json::from_str(json).map_err(|error| settings_error(name, error))
}
