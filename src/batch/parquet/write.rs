//! Results written as Parquet.

use std::fs::File;
use std::io;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

use serde_json::Value;

use super::METADATA_KEY;
use crate::batch::Row;
use crate::batch::columns::CellValue;
use crate::error::{Error, Result};

/// Rows in memory at once while writing. Chosen by hand.
const ROW_GROUP_SIZE: usize = 8192;

/// Writes rows, every column but `index`, `source` and `target` nullable.
pub(in crate::batch) fn write(
    file: &File,
    mut rows: impl Iterator<Item = Result<Row>>,
    times: bool,
    asked_for: &Value,
    failed: &impl Fn(io::Error) -> Error,
) -> Result<()> {
    let refuse = |error: ParquetError| failed(into_io_error(error));
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_key_value_metadata(Some(vec![KeyValue::new(
            METADATA_KEY.into(),
            asked_for.to_string(),
        )]))
        .set_created_by(concat!("cfreg ", env!("CARGO_PKG_VERSION")).into())
        .build();
    let schema = schema(times).map_err(refuse)?;
    let mut writer =
        SerializedFileWriter::new(file, schema.into(), Arc::new(properties)).map_err(refuse)?;
    loop {
        let group = rows.by_ref().take(ROW_GROUP_SIZE).collect::<Result<Vec<Row>>>()?;
        if group.is_empty() {
            break;
        }
        let cells: Vec<_> = group.iter().map(|row| row.column_values(times)).collect();
        let mut columns = writer.next_row_group().map_err(refuse)?;
        for k in 0..cells[0].len() {
            column(&mut columns, cells.iter().map(|row| row[k].1)).map_err(refuse)?;
        }
        columns.close().map_err(refuse)?;
    }
    writer.close().map_err(refuse)?;
    Ok(())
}

/// Extracts the operating system's error, if there is one.
fn into_io_error(error: ParquetError) -> io::Error {
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
    let field = |(name, cell): &(String, CellValue)| {
        let (physical, logical) = match cell {
            CellValue::Text(_) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            CellValue::Flag(_) => (Physical::BOOLEAN, None),
            CellValue::Count(_) => (Physical::INT64, None),
            CellValue::Number(_) => (Physical::DOUBLE, None),
        };
        let required = REQUIRED.contains(&name.as_str());
        let repetition = if required { Repetition::REQUIRED } else { Repetition::OPTIONAL };
        let builder = Type::primitive_type_builder(name, physical);
        builder.with_repetition(repetition).with_logical_type(logical).build().map(Arc::new)
    };
    let fields = Row::default().column_values(times).iter().map(field).collect::<Result<_, _>>()?;
    Type::group_type_builder("pairs").with_fields(fields).build()
}

/// Writes the next column.
fn column<'a>(
    columns: &mut SerializedRowGroupWriter<'_, &File>,
    cells: impl Iterator<Item = CellValue<'a>> + Clone,
) -> parquet::errors::Result<()> {
    match cells.clone().next() {
        Some(CellValue::Text(_)) => values::<ByteArrayType>(
            columns,
            cells.map(|cell| match cell {
                CellValue::Text(text) => text.map(ByteArray::from),
                _ => None,
            }),
        ),
        Some(CellValue::Flag(_)) => values::<BoolType>(
            columns,
            cells.map(|cell| match cell {
                CellValue::Flag(flag) => flag,
                _ => None,
            }),
        ),
        Some(CellValue::Count(_)) => values::<Int64Type>(
            columns,
            cells.map(|cell| match cell {
                CellValue::Count(count) => count,
                _ => None,
            }),
        ),
        Some(CellValue::Number(_)) => values::<DoubleType>(
            columns,
            cells.map(|cell| match cell {
                CellValue::Number(number) => number,
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
