//! The crate's errors as exceptions.

use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyOverflowError, PyValueError};
use pyo3::prelude::*;

use super::arrays::interop_module;
use cfreg::error::Error as Failure;

/// Most characters of a user's value in a message. Chosen by hand: a line of a terminal.
const MAX_VALUE_CHARS: usize = 80;
/// Most characters of a message's own words, which may have a value in them, as those of serde do.
/// Chosen by hand: the longest list of settings that a method has fits.
const MAX_RULE_CHARS: usize = 600;

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

/// The exception for `error`, with its message.
pub(super) fn to_pyerr(error: Failure) -> PyErr {
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
            let name = shorten(&name);
            SettingError::new_err(setting_message(&name, &value, &rule))
        }
        Failure::Config { field, value, rule } => {
            SettingError::new_err(setting_message(field, &value, &rule))
        }
        error => error_with_message(&error, error.to_string()),
    }
}

/// The exception for a setting that JSON does not have as it should be.
pub(super) fn settings_error(argument: &str, error: serde_json::Error) -> PyErr {
    let message = truncate_middle(&error.to_string(), MAX_RULE_CHARS);
    SettingError::new_err(format!("{argument}: {message}"))
}

/// A message about a setting, its value cut to a line.
fn setting_message(name: &str, value: &str, rule: &str) -> String {
    let (value, rule) = (shorten(value), truncate_middle(rule, MAX_RULE_CHARS));
    format!("{name} = {value}: {rule}")
}

/// A value as messages have it: of an array its type, shape and first numbers.
pub(super) fn format_value(any: &Bound<'_, PyAny>) -> String {
    let shown = interop_module(any.py()).and_then(|interop| interop.call_method1("shown", (any,)));
    shown.and_then(|text| text.extract()).unwrap_or_else(|_| "a value without words".into())
}

/// A text as messages have it: its ends, where it is longer than a line.
pub(super) fn shorten(text: &str) -> String {
    truncate_middle(text, MAX_VALUE_CHARS)
}

/// `text`, or its ends where it is longer than `most` characters.
fn truncate_middle(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.into();
    }
    let end = most / 4;
    let first: String = text.chars().take(most - end - 5).collect();
    let last: String = text.chars().skip(count - end).collect();
    format!("{first} ... {last}")
}

/// The exception for an `error` about the argument of that name.
pub(super) fn argument_error(argument: &str, error: Failure) -> PyErr {
    match &error {
        // Settings may have another name in the structs.
        Failure::Config { value, rule, .. } => {
            SettingError::new_err(setting_message(argument, value, rule))
        }
        Failure::NonFinite { index, .. } => non_finite_error(argument, *index),
        other => error_with_message(other, format!("{argument}: {other}")),
    }
}

/// The class that belongs to `error`, with this message.
fn error_with_message(error: &Failure, message: String) -> PyErr {
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
pub(super) fn non_finite_error(argument: &str, row: usize) -> PyErr {
    NonFiniteError::new_err(format!(
        "{argument} has a NaN or infinite value in row {row}: remove or repair it first"
    ))
}

/// Reads an integer of any size; beyond 64 bits the largest or the smallest 64-bit integer.
pub(super) fn whole(any: &Bound<'_, PyAny>) -> PyResult<i64> {
    any.extract().or_else(|error| saturate(any, error, [i64::MIN, i64::MAX]))
}

/// Reads a number of any size; beyond 64 bits an infinity.
pub(super) fn real(any: &Bound<'_, PyAny>) -> PyResult<f64> {
    any.extract().or_else(|error| saturate(any, error, [f64::NEG_INFINITY, f64::INFINITY]))
}

/// Reads a number of any size, or None.
pub(super) fn optional_real(any: &Bound<'_, PyAny>) -> PyResult<Option<f64>> {
    if any.is_none() { Ok(None) } else { real(any).map(Some) }
}

/// The least or the largest for what is beyond, another error as it is.
fn saturate<T>(any: &Bound<'_, PyAny>, error: PyErr, [least, largest]: [T; 2]) -> PyResult<T> {
    match error.is_instance_of::<PyOverflowError>(any.py()) {
        true => Ok(if any.lt(0)? { least } else { largest }),
        false => Err(error),
    }
}

/// A number of things that Python gave as an integer of any sign.
pub(super) fn parse_count(argument: &'static str, value: i64) -> PyResult<usize> {
    let negative = |_| to_pyerr(Failure::config(argument, value, "must not be negative"));
    usize::try_from(value).map_err(negative)
}
