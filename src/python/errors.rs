//! The doorway: released interpreter, crate errors as exceptions.

use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::error::{Error, Result};

pyo3::create_exception!(
    cfreg,
    RegistrationError,
    PyValueError,
    "The clouds do not determine an answer: too few usable points, no connection with any\n\
     weight, or weights that leave the rotation open."
);

/// Runs `work` without the interpreter, so that other Python threads go on.
pub(super) fn released<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    py.detach(work).map_err(exception)
}

/// The exception for `error`, with its message.
pub(super) fn exception(error: Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::TooFewPoints { .. } | Error::NoWeight | Error::Degenerate { .. } => {
            RegistrationError::new_err(message)
        }
        // Three arguments make the subclass that belongs to the number: FileNotFoundError.
        Error::Io { path, source } => match source.raw_os_error() {
            Some(number) => PyOSError::new_err((number, source.to_string(), path)),
            None => PyOSError::new_err(message),
        },
        _ => PyValueError::new_err(message),
    }
}

/// The exception for an `error` about the argument of that name.
pub(super) fn about(argument: &str, error: Error) -> PyErr {
    match error {
        // Settings may have another name in the structs.
        Error::Config { value, rule, .. } => {
            PyValueError::new_err(format!("{argument} = {value}: {rule}"))
        }
        Error::NonFinite { index, .. } => non_finite(argument, index),
        other => PyValueError::new_err(format!("{argument}: {other}")),
    }
}

/// The exception for a NaN or infinity in a row of an array.
pub(super) fn non_finite(argument: &str, row: usize) -> PyErr {
    PyValueError::new_err(format!(
        "{argument} has a NaN or infinite value in row {row}: remove or repair it first"
    ))
}

/// A number of things that Python gave as an integer of any sign.
pub(super) fn count(argument: &'static str, value: Option<i64>) -> PyResult<Option<usize>> {
    let Some(value) = value else { return Ok(None) };
    let negative = |_| exception(Error::config(argument, value, "must not be negative"));
    usize::try_from(value).map(Some).map_err(negative)
}
