//! The crate's errors as exceptions.

use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyValueError};
use pyo3::prelude::*;

use crate::error::Error as Failure;

pyo3::create_exception!(cfreg, Error, PyValueError, "What all errors of cfreg's own are.");
pyo3::create_exception!(cfreg, RegistrationError, Error, "The clouds do not determine an answer.");
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
    Error,
    "An argument that must be whole has a NaN or an infinity."
);
pyo3::create_exception!(
    cfreg,
    ShapeError,
    Error,
    "An array has another shape than it must, or two that do not fit each other."
);
pyo3::create_exception!(
    cfreg,
    SettingError,
    Error,
    "A setting is out of its range, unknown, or contradicts another."
);
pyo3::create_exception!(cfreg, FileFormatError, Error, "A file is not what it claims to be.");
pyo3::create_exception!(
    cfreg,
    ExtentError,
    Error,
    "Coordinates span more, or less, than can be computed with, or one is beyond 1e75: stray points, or the unit."
);

/// The exception for `error`, with its message.
pub(super) fn exception(error: Failure) -> PyErr {
    match error {
        // Three arguments make the subclass that belongs to the number: FileNotFoundError.
        Failure::Io { path, source } => match source.raw_os_error() {
            Some(number) => {
                let message = source.to_string();
                let message = message.split(" (os error").next().unwrap_or_default().to_string();
                PyOSError::new_err((number, message, path.display().to_string()))
            }
            None => PyOSError::new_err(format!("{}: {source}", path.display())),
        },
        error => worded(&error, error.to_string()),
    }
}

/// The exception for an `error` about the argument of that name.
pub(super) fn about(argument: &str, error: Failure) -> PyErr {
    match &error {
        // Settings may have another name in the structs.
        Failure::Config { value, rule, .. } => {
            worded(&error, format!("{argument} = {value}: {rule}"))
        }
        Failure::NonFinite { index, .. } => non_finite(argument, *index),
        other => worded(other, format!("{argument}: {other}")),
    }
}

/// The class that belongs to `error`, with this message.
fn worded(error: &Failure, message: String) -> PyErr {
    match error {
        Failure::TooFewPoints { .. } => TooFewPointsError::new_err(message),
        Failure::NoWeight { .. } => NoWeightError::new_err(message),
        Failure::Degenerate { .. } => DegenerateError::new_err(message),
        Failure::NonFinite { .. } => NonFiniteError::new_err(message),
        Failure::Shape { .. } => ShapeError::new_err(message),
        Failure::Config { .. } | Failure::Setting { .. } => SettingError::new_err(message),
        Failure::Parse { .. } => FileFormatError::new_err(message),
        Failure::Extent { .. } | Failure::Coordinate { .. } => ExtentError::new_err(message),
        Failure::Interrupted => PyKeyboardInterrupt::new_err(message),
        _ => Error::new_err(message),
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
    let negative = |_| exception(Failure::config(argument, value, "must not be negative"));
    usize::try_from(value).map_err(negative)
}
