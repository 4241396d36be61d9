//! The crate's errors as exceptions.

use pyo3::PyTypeInfo;
use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::error::Error;

pyo3::create_exception!(
    cfreg,
    RegistrationError,
    PyValueError,
    "The clouds do not determine an answer."
);
pyo3::create_exception!(
    cfreg,
    TooFewPointsError,
    RegistrationError,
    "A cloud is empty, or has fewer usable points than the step needs."
);
pyo3::create_exception!(
    cfreg,
    NoWeightError,
    RegistrationError,
    "No connection has any weight, so that there is nothing to solve."
);
pyo3::create_exception!(
    cfreg,
    DegenerateError,
    RegistrationError,
    "The weighted connections leave the rotation open: points on a line or in a plane, or\n\
     weights that do not tell points apart."
);
pyo3::create_exception!(
    cfreg,
    NonFiniteError,
    PyValueError,
    "An argument that must be whole has a NaN or an infinity."
);
pyo3::create_exception!(
    cfreg,
    ShapeError,
    PyValueError,
    "An array has another shape than it must, or two that do not fit each other."
);
pyo3::create_exception!(
    cfreg,
    SettingError,
    PyValueError,
    "A setting is out of its range, unknown, or contradicts another."
);
pyo3::create_exception!(cfreg, FileFormatError, PyValueError, "A file is not what it claims to be.");

/// The exception for `error`, with its message.
pub(super) fn exception(error: Error) -> PyErr {
    told(&error, error.to_string()).unwrap_or_else(|| match error {
        // Three arguments make the subclass that belongs to the number: FileNotFoundError.
        Error::Io { path, source } => match source.raw_os_error() {
            Some(number) => PyOSError::new_err((number, source.to_string(), path)),
            None => PyOSError::new_err(format!("{}: {source}", path.display())),
        },
        error => PyValueError::new_err(error.to_string()),
    })
}

/// The exception for an `error` about the argument of that name.
pub(super) fn about(argument: &str, error: Error) -> PyErr {
    let message = match &error {
        // Settings may have another name in the structs.
        Error::Config { value, rule, .. } => format!("{argument} = {value}: {rule}"),
        Error::NonFinite { index, .. } => return non_finite(argument, *index),
        other => format!("{argument}: {other}"),
    };
    told(&error, message).unwrap_or_else(|| exception(error))
}

/// The exception of the crate that belongs to `error`.
fn told(error: &Error, message: String) -> Option<PyErr> {
    fn of<E: PyTypeInfo>(message: String) -> Option<PyErr> {
        Some(PyErr::new::<E, _>(message))
    }
    match error {
        Error::TooFewPoints { .. } => of::<TooFewPointsError>(message),
        Error::NoWeight => of::<NoWeightError>(message),
        Error::Degenerate { .. } => of::<DegenerateError>(message),
        Error::NonFinite { .. } => of::<NonFiniteError>(message),
        Error::Shape { .. } => of::<ShapeError>(message),
        Error::Config { .. } | Error::Setting { .. } => of::<SettingError>(message),
        Error::Parse { .. } => of::<FileFormatError>(message),
        Error::Interrupted => of::<PyKeyboardInterrupt>(message),
        _ => None,
    }
}

/// The exception for a NaN or infinity in a row of an array.
pub(super) fn non_finite(argument: &str, row: usize) -> PyErr {
    NonFiniteError::new_err(format!(
        "{argument} has a NaN or infinite value in row {row}: remove or repair it first"
    ))
}

/// A number of things that Python gave as an integer of any sign.
pub(super) fn count(argument: &'static str, value: i64) -> PyResult<usize> {
    let negative = |_| exception(Error::config(argument, value, "must not be negative"));
    usize::try_from(value).map_err(negative)
}
