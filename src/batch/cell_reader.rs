//! Cells of results that are read again: JSON, or words of CSV.

use serde_json::Value;

use crate::io;

/// The cells of one row. Errors are messages with the column and its error.
pub(super) struct CellReader<F> {
    get: F,
}

impl<F: Fn(&str) -> Option<Value>> CellReader<F> {
    /// Reads the cells that `get` returns for the names of columns.
    pub(super) fn new(get: F) -> Self {
        CellReader { get }
    }

    /// Returns a cell; `None` for null and for an empty word too.
    fn cell(&self, name: &str) -> Option<Value> {
        match (self.get)(name) {
            None | Some(Value::Null) => None,
            Some(Value::String(word)) if word.is_empty() => None,
            Some(value) => Some(value),
        }
    }

    /// Returns the value that `read` makes of a cell which must not be empty.
    pub(super) fn needed<T: Default>(
        &self,
        name: &str,
        read: impl Fn(&str) -> Result<Option<T>, String>,
    ) -> Result<T, String> {
        match self.cell(name) {
            None => Err(format!("column {name}: nothing in it")),
            Some(_) => read(name).map(Option::unwrap_or_default),
        }
    }

    pub(super) fn text(&self, name: &str) -> Result<Option<String>, String> {
        match self.cell(name) {
            None => Ok(None),
            Some(Value::String(text)) => Ok(Some(text)),
            Some(value) => Err(format!("column {name}: {value} is not a text")),
        }
    }

    pub(super) fn flag(&self, name: &str) -> Result<Option<bool>, String> {
        match self.cell(name) {
            None => Ok(None),
            Some(Value::Bool(flag)) => Ok(Some(flag)),
            Some(Value::String(word)) if word == "true" => Ok(Some(true)),
            Some(Value::String(word)) if word == "false" => Ok(Some(false)),
            Some(value) => {
                Err(format!("column {name}: {} is neither true nor false", format_value(&value)))
            }
        }
    }

    /// Returns a finite number.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, String> {
        let Some(value) = self.cell(name) else { return Ok(None) };
        let found = value.as_f64().or_else(|| value.as_str()?.parse().ok());
        match found.filter(|number| number.is_finite()) {
            Some(number) => Ok(Some(number)),
            None => Err(format!("column {name}: {} is not a number", format_value(&value))),
        }
    }

    /// Returns a whole number, 0 or more.
    pub(super) fn count(&self, name: &str) -> Result<Option<usize>, String> {
        match self.number(name)? {
            Some(count) if count < 0.0 || count.fract() != 0.0 => {
                Err(format!("column {name}: {count} is not a count"))
            }
            count => Ok(count.map(|count| count as usize)),
        }
    }
}

/// Returns the start of a value for messages.
fn format_value(value: &Value) -> String {
    match value {
        Value::String(text) => io::quote_start(text),
        other => other.to_string(),
    }
}
