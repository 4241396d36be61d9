//! The crate's errors as exceptions.

use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyOverflowError, PyValueError};
use pyo3::prelude::*;

use super::arrays::interop;
use cfreg::error::Error as Failure;

/// Maximum number of characters of a user's value in a message. Chosen by hand: a line of a
/// terminal.
const LONGEST_VALUE: usize = 80;
/// Maximum number of characters of a message's own text, which may contain a value, as in messages
/// of serde. Chosen by hand: the longest list of settings of a method fits.
const LONGEST_RULE: usize = 600;

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
pyo3::create_exception!(
    cfreg,
    InternalError,
    Error,
    "A bug in cfreg: the message says what to report. Other calls are not affected."
);

/// Returns the exception for `error`, with its message.
pub(super) fn exception(error: Failure) -> PyErr {
    match error {
        // Three arguments create the subclass for the number: FileNotFoundError.
        Failure::Io { path, source } => match source.raw_os_error() {
            Some(number) => {
                let message = source.to_string();
                let message = message.split(" (os error").next().unwrap_or_default().to_string();
                PyOSError::new_err((number, message, path.display().to_string()))
            }
            None => PyOSError::new_err(format!("{}: {source}", path.display())),
        },
        Failure::Setting { name, value, rule } => {
            let name = shortened(&name);
            SettingError::new_err(setting(&name, &value, &rule))
        }
        Failure::Config { field, value, rule } => {
            SettingError::new_err(setting(field, &value, &rule))
        }
        error => worded(&error, error.to_string()),
    }
}

/// Returns the exception for a setting with invalid JSON.
pub(super) fn refused(argument: &str, error: serde_json::Error) -> PyErr {
    let message = ends(&error.to_string(), LONGEST_RULE);
    SettingError::new_err(format!("{argument}: {message}"))
}

/// Formats a message about a setting, its value cut to a line.
fn setting(name: &str, value: &str, rule: &str) -> String {
    let (value, rule) = (shortened(value), ends(rule, LONGEST_RULE));
    format!("{name} = {value}: {rule}")
}

/// Formats a value for messages: for an array its type, shape and first numbers.
pub(super) fn shown(any: &Bound<'_, PyAny>) -> String {
    let shown = interop(any.py()).and_then(|interop| interop.call_method1("shown", (any,)));
    shown.and_then(|text| text.extract()).unwrap_or_else(|_| "a value without words".into())
}

/// Formats a text for messages: its two ends if it is longer than a line.
pub(super) fn shortened(text: &str) -> String {
    ends(text, LONGEST_VALUE)
}

/// Returns `text`, or its two ends if it is longer than `most` characters.
fn ends(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.into();
    }
    let end = most / 4;
    let first: String = text.chars().take(most - end - 5).collect();
    let last: String = text.chars().skip(count - end).collect();
    format!("{first} ... {last}")
}

/// Returns the exception for an `error` about the argument of that name.
pub(super) fn about(argument: &str, error: Failure) -> PyErr {
    match &error {
        // Settings may have another name in the structs.
        Failure::Config { value, rule, .. } => {
            SettingError::new_err(setting(argument, value, rule))
        }
        Failure::NonFinite { index, .. } => non_finite(argument, *index),
        other => worded(other, format!("{argument}: {other}")),
    }
}

/// Returns an exception of the class for `error`, with this message.
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

/// Returns the exception for a NaN or infinity in a row of an array.
pub(super) fn non_finite(argument: &str, row: usize) -> PyErr {
    NonFiniteError::new_err(format!(
        "{argument} has a NaN or infinite value in row {row}: remove or repair it first"
    ))
}

/// Reads an integer of any size; beyond 64 bits the largest or the smallest 64-bit integer.
pub(super) fn whole(any: &Bound<'_, PyAny>) -> PyResult<i64> {
    any.extract().or_else(|error| beyond(any, error, [i64::MIN, i64::MAX]))
}

/// Reads a number of any size; beyond 64 bits an infinity.
pub(super) fn real(any: &Bound<'_, PyAny>) -> PyResult<f64> {
    any.extract().or_else(|error| beyond(any, error, [f64::NEG_INFINITY, f64::INFINITY]))
}

/// Reads a number of any size, or None.
pub(super) fn optional_real(any: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    if any.is_none() { Ok(None) } else { real(any).map(Some) }
}

/// Returns the smallest or the largest value for an overflow, another error unchanged.
fn beyond<T>(any: &Bound<'_, PyAny>, error: PyErr, [least, largest]: [T; 2]) -> PyResult<T> {
    match error.is_instance_of::<PyOverflowError>(any.py()) {
        true => Ok(if any.lt(0)? { least } else { largest }),
        false => Err(error),
    }
}

/// Reads a count, which Python passes as an integer of any sign.
pub(super) fn count(argument: &'static str, value: i64) -> PyResult<usize> {
    let negative = |_| exception(Failure::config(argument, value, "must not be negative"));
    usize::try_from(value).map_err(negative)
}
