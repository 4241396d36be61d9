//! Report pages and pictures of results.

use pyo3::prelude::*;
use pyo3::types::PyBytes;

use super::cloud_arg::CloudArg;
use super::errors::settings_error;
use super::gil::run_interruptible;
use super::interop::BadRows;
use cfreg::method::Registration;
use cfreg::report::PairReport;

/// Create the page of a result, given as JSON, and of its clouds.
#[pyfunction]
pub(super) fn report(
    py: Python<'_>,
    result: &str,
    source: &Bound<'_, PyAny>,
    target: &Bound<'_, PyAny>,
) -> PyResult<String> {
    let source = CloudArg::read(source, "source", None, BadRows::Drop)?;
    let target = CloudArg::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    let found = parse(result)?;
    run_interruptible(py, || PairReport::new(&found, source, target).html())
}

/// The result in JSON.
fn parse(result: &str) -> PyResult<Registration> {
    serde_json::from_str(result).map_err(|error| settings_error("the result", error))
}

/// Draw the aligned clouds as a small PNG.
#[pyfunction]
pub(super) fn thumbnail<'py>(
    py: Python<'py>,
    result: &str,
    source: &Bound<'py, PyAny>,
    target: &Bound<'py, PyAny>,
    size: (u32, u32),
) -> PyResult<Bound<'py, PyBytes>> {
    let source = CloudArg::read(source, "source", None, BadRows::Drop)?;
    let target = CloudArg::read(target, "target", None, BadRows::Drop)?;
    let (source, target) = (source.get(), target.get());
    let found = parse(result)?;
    let bytes = run_interruptible(py, || {
        let mut pair = PairReport::new(&found, source, target);
        pair.points = (size.0 * size.1 / 4) as usize;
        pair.thumbnail(size)?.png()
    })?;
    Ok(PyBytes::new(py, &bytes))
}
