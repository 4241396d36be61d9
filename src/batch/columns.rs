//! Columns of rows.

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

/// A column of many rows, by its type; `None` for a row without a value.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "said by their types")]
pub enum Column {
    Text(Vec<Option<String>>),
    Flag(Vec<Option<bool>>),
    Count(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
}

impl Column {
    pub(super) fn push(&mut self, cell: CellValue<'_>) {
        match (self, cell) {
            (Column::Text(column), CellValue::Text(text)) => column.push(text.map(String::from)),
            (Column::Flag(column), CellValue::Flag(flag)) => column.push(flag),
            (Column::Count(column), CellValue::Count(count)) => column.push(count),
            (Column::Number(column), CellValue::Number(number)) => column.push(number),
            // Every row has the same columns of the same types.
            _ => {}
        }
    }
}

/// A cell of a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum CellValue<'a> {
    Text(Option<&'a str>),
    Flag(Option<bool>),
    Count(Option<i64>),
    Number(Option<f64>),
}

impl CellValue<'_> {
    /// Formats the cell for CSV with every digit; empty for `None`.
    pub(super) fn to_csv(self) -> String {
        match self {
            CellValue::Text(text) => text.unwrap_or_default().into(),
            CellValue::Flag(flag) => flag.map_or_else(String::new, |flag| flag.to_string()),
            CellValue::Count(count) => count.map_or_else(String::new, |count| count.to_string()),
            CellValue::Number(number) => number.map_or_else(String::new, |x| format!("{x:?}")),
        }
    }
}

impl Serialize for CellValue<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            CellValue::Text(text) => text.serialize(serializer),
            CellValue::Flag(flag) => flag.serialize(serializer),
            CellValue::Count(count) => count.serialize(serializer),
            CellValue::Number(number) => number.serialize(serializer),
        }
    }
}

/// A row as one flat object, for JSON Lines.
pub(super) struct FlatRow<'a>(pub(super) &'a [(String, CellValue<'a>)]);

impl Serialize for FlatRow<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, cell) in self.0 {
            map.serialize_entry(name, cell)?;
        }
        map.end()
    }
}
