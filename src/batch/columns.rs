//! What stands in the columns of rows.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

/// A column of many rows, by its kind; `None` where a row has nothing in it.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "said by their types")]
pub enum Column {
    Text(Vec<Option<String>>),
    Flag(Vec<Option<bool>>),
    Count(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
}

impl Column {
    pub(super) fn push(&mut self, cell: Cell<'_>) {
        match (self, cell) {
            (Column::Text(column), Cell::Text(text)) => column.push(text.map(String::from)),
            (Column::Flag(column), Cell::Flag(flag)) => column.push(flag),
            (Column::Count(column), Cell::Count(count)) => column.push(count),
            (Column::Number(column), Cell::Number(number)) => column.push(number),
            // Every row has the same columns of the same kinds.
            _ => {}
        }
    }
}

/// What stands in a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell<'a> {
    Text(Option<&'a str>),
    Flag(Option<bool>),
    Count(Option<i64>),
    Number(Option<f64>),
}

impl Cell<'_> {
    /// As CSV has it, every digit kept; nothing for `None`.
    pub(super) fn word(&self) -> String {
        match self {
            Cell::Text(text) => text.unwrap_or_default().into(),
            Cell::Flag(flag) => flag.map_or_else(String::new, |flag| flag.to_string()),
            Cell::Count(count) => count.map_or_else(String::new, |count| count.to_string()),
            Cell::Number(number) => number.map_or_else(String::new, |x| format!("{x:?}")),
        }
    }
}

impl Serialize for Cell<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Cell::Text(text) => text.serialize(serializer),
            Cell::Flag(flag) => flag.serialize(serializer),
            Cell::Count(count) => count.serialize(serializer),
            Cell::Number(number) => number.serialize(serializer),
        }
    }
}

/// A row as one object without any within, as JSON Lines have it.
pub(super) struct Flat<'a>(pub(super) &'a [(String, Cell<'a>)]);

impl Serialize for Flat<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, cell) in self.0 {
            map.serialize_entry(name, cell)?;
        }
        map.end()
    }
}
