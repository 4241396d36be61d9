//! Parquet: the only place that names the crate.

use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::record::Field;
use parquet::schema::types::Type;

use serde_json::Value;

use super::Row;
use super::cells::Cell;
use crate::error::{Error, Result};

/// Rows that are in memory at once, when they are written.
const GROUP: usize = 8192;

/// Calls `take` with the number (from 1) and the two `columns` of each row.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for a file that is not Parquet or has no such columns of text.
pub(super) fn pairs(
    path: &Path,
    columns: [&str; 2],
    mut take: impl FnMut(usize, [Option<String>; 2]) -> Result<()>,
) -> Result<()> {
    let wrong = |what: String| wrong(path, what);
    guarded(path, |reader| {
        let schema = reader.metadata().file_metadata().schema();
        let mut fields = Vec::new();
        for name in columns {
            let field = schema.get_fields().iter().find(|field| field.name() == name);
            let field = field.ok_or_else(|| wrong(format!("no column {name}")))?;
            if !field.is_primitive() || field.get_physical_type() != Physical::BYTE_ARRAY {
                return Err(wrong(format!("the column {name} is not of strings")));
            }
            fields.push(field.clone());
        }
        let narrow = Type::group_type_builder(schema.name()).with_fields(fields).build();
        let rows = reader.get_row_iter(Some(narrow.map_err(refuse(path))?));
        let rows = rows.map_err(refuse(path))?;
        for (row, number) in rows.zip(1..) {
            let row = row.map_err(refuse(path))?;
            let find = |name: &str| {
                let field = row.get_column_iter().find(|(column, _)| *column == name);
                match field.map(|(_, field)| field) {
                    Some(Field::Str(text)) => Ok(Some(text.clone())),
                    Some(Field::Bytes(bytes)) => {
                        let text = String::from_utf8(bytes.data().to_vec());
                        text.map(Some)
                            .map_err(|_| wrong(format!("row {number}: {name} is no text")))
                    }
                    _ => Ok(None),
                }
            };
            take(number, [find(columns[0])?, find(columns[1])?])?;
        }
        Ok(())
    })
}

/// Calls `take` with the number (from 1) and the cells of each row, by the names of their columns.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for a file that is not Parquet.
pub(super) fn rows(
    path: &Path,
    mut take: impl FnMut(usize, HashMap<&str, Value>) -> Result<()>,
) -> Result<()> {
    guarded(path, |reader| {
        for (row, number) in reader.get_row_iter(None).map_err(refuse(path))?.zip(1..) {
            let row = row.map_err(refuse(path))?;
            let cells = row.get_column_iter().map(|(name, field)| {
                let cell = match field {
                    Field::Str(text) => text.as_str().into(),
                    Field::Bool(flag) => (*flag).into(),
                    Field::Int(count) => (*count).into(),
                    Field::Long(count) => (*count).into(),
                    Field::Float(number) => f64::from(*number).into(),
                    Field::Double(number) => (*number).into(),
                    _ => Value::Null,
                };
                (name.as_str(), cell)
            });
            take(number, cells.collect())?;
        }
        Ok(())
    })
}

/// What a run wrote into its file of what it was asked for.
///
/// # Errors
/// Those of [`rows`].
pub(super) fn asked_for(path: &Path) -> Result<Option<Value>> {
    guarded(path, |reader| {
        let facts = reader.metadata().file_metadata().key_value_metadata();
        let fact = facts.and_then(|facts| facts.iter().find(|fact| fact.key == KEY));
        Ok(fact.and_then(|fact| serde_json::from_str(fact.value.as_ref()?).ok()))
    })
}

/// Under which a file has what its run was asked for.
const KEY: &str = "cfreg";

/// Calls `work` with a file. The crate is not proof against every file that was made to break it.
fn guarded<T>(
    path: &Path,
    work: impl FnOnce(SerializedFileReader<File>) -> Result<T>,
) -> Result<T> {
    let file = File::open(path).map_err(|error| Error::io(path, error))?;
    let guarded = AssertUnwindSafe(|| work(SerializedFileReader::new(file).map_err(refuse(path))?));
    let broken = |_| Err(wrong(path, "is not Parquet that can be read".into()));
    catch_unwind(guarded).unwrap_or_else(broken)
}

fn refuse(path: &Path) -> impl Fn(ParquetError) -> Error {
    move |error| wrong(path, format!("is not Parquet that can be read: {error}"))
}

fn wrong(path: &Path, what: String) -> Error {
    Error::parse(path, None, what)
}

/// Writes rows, every column but `index`, `source` and `target` nullable.
pub(super) fn write(
    file: &File,
    mut rows: impl Iterator<Item = Result<Row>>,
    times: bool,
    asked_for: &Value,
    failed: &impl Fn(io::Error) -> Error,
) -> Result<()> {
    let refuse = |error: ParquetError| failed(system(error));
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(vec![KeyValue::new(KEY.into(), asked_for.to_string())]))
        .set_created_by(concat!("cfreg ", env!("CARGO_PKG_VERSION")).into())
        .build();
    let schema = schema(times).map_err(refuse)?;
    let mut writer =
        SerializedFileWriter::new(file, schema.into(), Arc::new(properties)).map_err(refuse)?;
    loop {
        let group = rows.by_ref().take(GROUP).collect::<Result<Vec<Row>>>()?;
        if group.is_empty() {
            break;
        }
        let cells: Vec<_> = group.iter().map(|row| row.cells(times)).collect();
        let mut columns = writer.next_row_group().map_err(refuse)?;
        for k in 0..cells[0].len() {
            column(&mut columns, cells.iter().map(|row| row[k].1)).map_err(refuse)?;
        }
        columns.close().map_err(refuse)?;
    }
    writer.close().map_err(refuse)?;
    Ok(())
}

/// What the system said, where it was the system.
fn system(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(error) => *error,
            Err(source) => io::Error::other(source),
        },
        other => io::Error::other(other),
    }
}

/// Columns that every row has.
const REQUIRED: [&str; 3] = ["index", "source", "target"];

fn schema(times: bool) -> parquet::errors::Result<Type> {
    let field = |(name, cell): &(String, Cell)| {
        let (physical, logical) = match cell {
            Cell::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Cell::Flag(_) => (Physical::BOOLEAN, None),
            Cell::Count(_) => (Physical::INT64, None),
            Cell::Number(_) => (Physical::DOUBLE, None),
        };
        let required = REQUIRED.contains(&name.as_str());
        let repetition = if required { Repetition::REQUIRED } else { Repetition::OPTIONAL };
        let builder = Type::primitive_type_builder(name, physical);
        builder.with_repetition(repetition).with_logical_type(logical).build().map(Arc::new)
    };
    let fields = Row::default().cells(times).iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder("pairs").with_fields(fields).build()
}

/// Writes the next column.
fn column<'a>(
    columns: &mut SerializedRowGroupWriter<'_, &File>,
    cells: impl Iterator<Item = Cell<'a>> + Clone,
) -> parquet::errors::Result<()> {
    match cells.clone().next() {
        Some(Cell::Text(_)) => values::<ByteArrayType>(
            columns,
            cells.map(|cell| match cell {
                Cell::Text(text) => text.map(ByteArray::from),
                _ => None,
            }),
        ),
        Some(Cell::Flag(_)) => values::<BoolType>(
            columns,
            cells.map(|cell| match cell {
                Cell::Flag(flag) => flag,
                _ => None,
            }),
        ),
        Some(Cell::Count(_)) => values::<Int64Type>(
            columns,
            cells.map(|cell| match cell {
                Cell::Count(count) => count,
                _ => None,
            }),
        ),
        Some(Cell::Number(_)) => values::<DoubleType>(
            columns,
            cells.map(|cell| match cell {
                Cell::Number(number) => number,
                _ => None,
            }),
        ),
        None => Ok(()),
    }
}

fn values<D: DataType>(
    columns: &mut SerializedRowGroupWriter<'_, &File>,
    cells: impl Iterator<Item = Option<D::T>>,
) -> parquet::errors::Result<()> {
    let (mut values, mut there) = (Vec::new(), Vec::new());
    for cell in cells {
        there.push(i16::from(cell.is_some()));
        values.extend(cell);
    }
    let missing = || ParquetError::General("more columns than the schema has".into());
    let mut column = columns.next_column()?.ok_or_else(missing)?;
    column.typed::<D>().write_batch(&values, Some(&there), None)?;
    column.close()
}
