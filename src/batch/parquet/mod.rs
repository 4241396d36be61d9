//! Parquet: the only module that uses the crate `parquet`.
//!
//! Files are not trusted. The crate reserves the sizes claimed in footers and page headers, and a
//! claim of 599 bytes may be 844 TB: footer and headers are read and checked here ([`footer`],
//! [`pages`]), columns that were not requested are ignored, and the crate decodes only pages that
//! were checked. A panic within it is an [`Error`] and prints nothing.

mod footer;
mod pages;
mod thrift;
mod write;

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Repetition, Type as Encoded};
use parquet::column::reader::ColumnReaderImpl;
use parquet::data_type::{
    BoolType, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type,
};
use parquet::schema::types::{ColumnDescriptor, ColumnPath, Type};
use serde_json::Value;

use self::footer::{Footer, LeafColumn, PhysicalType};
use self::pages::Pages;
pub(super) use self::write::write;
use super::Row;
use crate::error::{Error, Result};
use crate::io::limited_file::MemoryBudget;
use crate::par;

/// Metadata key of the run's inputs.
const METADATA_KEY: &str = "cfreg";
/// Most rows that are decoded at once, and bytes of their texts. Chosen by hand.
const MAX_ROWS_AT_ONCE: usize = 1024;
const MAX_TEXT_BYTES_AT_ONCE: usize = 8 << 20;
/// Most bytes of a text. Chosen by hand: names and reasons are some hundred bytes long.
const MAX_TEXT_BYTES: usize = 1 << 20;

/// Calls `take` with the number (from 1) and the two `columns` of each row.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for a file that is not Parquet or has no text columns of these
/// names.
pub(super) fn read_pairs(
    path: &Path,
    columns: [&str; 2],
    mut take: impl FnMut(usize, [&str; 2]) -> Result<()>,
) -> Result<()> {
    with_open_file(path, |table| {
        let mut table = table.open(&columns)?;
        for (wanted, name) in columns.iter().enumerate() {
            match table.footer.leaf(wanted) {
                None => return Err(parse_error(path, format!("no column {name}"))),
                Some(leaf) if leaf.physical != Some(PhysicalType::Text) => {
                    return Err(parse_error(path, format!("the column {name} is not of strings")));
                }
                Some(_) => {}
            }
        }
        table.for_each_row(|number, cells| {
            let text = |wanted: usize| match cells(wanted) {
                Some(Value::String(text)) => text.as_str(),
                _ => "",
            };
            take(number, [text(0), text(1)])
        })
    })
}

/// Calls `take` with the number (from 1) and the cells of each row, by the names of their columns.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for a file that is not Parquet.
pub(super) fn read_rows(
    path: &Path,
    mut take: impl FnMut(usize, &dyn Fn(&str) -> Option<Value>) -> Result<()>,
) -> Result<()> {
    with_open_file(path, |table| {
        let row = Row::default();
        let cells = row.column_values(true);
        let names: Vec<&str> = cells.iter().map(|(name, _)| name.as_str()).collect();
        let wanted: HashMap<&str, usize> = names.iter().copied().zip(0..).collect();
        table
            .open(&names)?
            .for_each_row(|number, cells| take(number, &|name| cells(*wanted.get(name)?).cloned()))
    })
}

/// Returns the settings that a run wrote into its file.
///
/// # Errors
/// Those of [`rows`].
pub(super) fn read_run_header(path: &Path) -> Result<Option<Value>> {
    with_open_file(path, |table| {
        let fact = table.open(&[])?.footer.metadata_value;
        Ok(fact.and_then(|fact| serde_json::from_str(&fact).ok()))
    })
}

/// Calls `work` with a file. Panics are caught, because a malformed file may make the crate panic.
fn with_open_file<T>(path: &Path, work: impl FnOnce(UnreadFile<'_>) -> Result<T>) -> Result<T> {
    let failed = |error| Error::io(path, error);
    let facts = fs::metadata(path).map_err(failed)?;
    if !facts.is_file() {
        // The position of its end, which holds the footer, must be known.
        let what = if facts.is_dir() { "is a directory" } else { "is not a regular file" };
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, what)));
    }
    let file = File::open(path).map_err(failed)?;
    par::catch_panic(|| work(UnreadFile { path, file, size: facts.len() }))
        .unwrap_or_else(|_| Err(unreadable_error(path, "the decoder fails on it".into())))
}

fn unreadable_error(path: &Path, what: String) -> Error {
    parse_error(path, format!("is not Parquet that can be read: {what}"))
}

fn parse_error(path: &Path, what: String) -> Error {
    Error::parse(path, None, what)
}

/// A file whose footer is not read yet.
struct UnreadFile<'a> {
    path: &'a Path,
    file: File,
    size: u64,
}

impl<'a> UnreadFile<'a> {
    fn open(mut self, wanted: &[&str]) -> Result<ParquetTable<'a>> {
        let path = self.path;
        let footer = Footer::read(&mut self.file, self.size, wanted, METADATA_KEY)
            .map_err(|error| Error::io(path, error))?
            .map_err(|what| unreadable_error(path, what))?;
        let named = |leaf: &LeafColumn| wanted[leaf.wanted].to_string();
        if let Some(other) = footer.leaves.iter().find(|leaf| leaf.physical.is_none()) {
            let what = format!("the column {} has values of another kind", named(other));
            return Err(parse_error(path, what));
        }
        let names = footer.leaves.iter().map(named).collect();
        Ok(ParquetTable {
            path,
            file: self.file,
            footer,
            names,
            budget: MemoryBudget::new(self.size),
        })
    }
}

/// A file with the requested columns.
struct ParquetTable<'a> {
    path: &'a Path,
    file: File,
    footer: Footer,
    /// Names of the columns present.
    names: Vec<String>,
    budget: MemoryBudget,
}

impl ParquetTable<'_> {
    /// Calls `take` with the number (from 1) of each row and a function that returns its cell in a
    /// requested column.
    fn for_each_row<'c>(
        &mut self,
        mut take: impl for<'r> FnMut(usize, &'r dyn Fn(usize) -> Option<&'r Value>) -> Result<()>,
    ) -> Result<()> {
        let path = self.path;
        let groups = std::mem::take(&mut self.footer.groups);
        let mut number = 0;
        for group in groups {
            let mut budget = self.budget;
            let (mut columns, mut longest) = (Vec::new(), 0);
            for ((leaf, chunk), name) in
                self.footer.leaves.iter().zip(&group.chunks).zip(&self.names)
            {
                let refuse = |what| unreadable_error(path, format!("column {name}: {what}"));
                let mut bytes = vec![0; chunk.length];
                let failed = |error| Error::io(path, error);
                self.file.seek(SeekFrom::Start(chunk.start)).map_err(failed)?;
                self.file.read_exact(&mut bytes).map_err(failed)?;
                let physical = leaf.physical.unwrap_or(PhysicalType::Text);
                let pages =
                    Pages::new(bytes.into(), chunk.snappy, group.rows, physical, leaf.optional);
                let pages = pages.map_err(refuse)?;
                budget.reserve(pages.memory()).map_err(refuse)?;
                if physical == PhysicalType::Text {
                    longest = longest.max(pages.largest().min(MAX_TEXT_BYTES));
                }
                columns.push(column_decoder(leaf, physical, pages).map_err(refuse)?);
            }
            let most = (MAX_TEXT_BYTES_AT_ONCE / longest.max(1)).clamp(8, MAX_ROWS_AT_ONCE);
            let mut left = group.rows;
            while left > 0 {
                let count = most.min(usize::try_from(left).unwrap_or(most));
                let mut cells: Vec<Option<Vec<Value>>> = vec![None; 128];
                for ((leaf, column), name) in
                    self.footer.leaves.iter().zip(&mut columns).zip(&self.names)
                {
                    let refuse = |what| unreadable_error(path, format!("column {name}: {what}"));
                    if cells.len() <= leaf.wanted {
                        cells.resize(leaf.wanted + 1, None);
                    }
                    cells[leaf.wanted] = Some(column(count).map_err(refuse)?);
                }
                for row in 0..count {
                    number += 1;
                    let cell = |wanted: usize| cells.get(wanted)?.as_ref()?.get(row);
                    take(number, &cell)?;
                }
                left -= count as u64;
            }
        }
        Ok(())
    }
}

/// Reads the given number of next values of a column.
type ColumnDecoder = Box<dyn FnMut(usize) -> std::result::Result<Vec<Value>, String>>;

fn column_decoder(
    leaf: &LeafColumn,
    physical: PhysicalType,
    pages: Pages,
) -> std::result::Result<ColumnDecoder, String> {
    let unsigned = leaf.unsigned;
    let optional = leaf.optional;
    match physical {
        PhysicalType::Flag => values::<BoolType>(optional, pages, |&flag| Ok(flag.into())),
        PhysicalType::Int32 => values::<Int32Type>(optional, pages, move |&number| {
            Ok(if unsigned { (number as u32).into() } else { number.into() })
        }),
        PhysicalType::Int64 => values::<Int64Type>(optional, pages, move |&number| {
            Ok(if unsigned { (number as u64).into() } else { number.into() })
        }),
        PhysicalType::Float => {
            values::<FloatType>(optional, pages, |&number| Ok(f64::from(number).into()))
        }
        PhysicalType::Double => values::<DoubleType>(optional, pages, |&number| Ok(number.into())),
        PhysicalType::Text => values::<ByteArrayType>(optional, pages, |bytes| {
            let bytes = bytes.data();
            if bytes.len() > MAX_TEXT_BYTES {
                return Err(format!("a text of {} bytes", bytes.len()));
            }
            let text = std::str::from_utf8(bytes).map_err(|_| "what is no UTF-8 text")?;
            Ok(text.into())
        }),
    }
}

fn values<D: DataType>(
    optional: bool,
    pages: Pages,
    make: impl Fn(&D::T) -> std::result::Result<Value, String> + 'static,
) -> std::result::Result<ColumnDecoder, String>
where
    ColumnReaderImpl<D>: 'static,
{
    let repetition = if optional { Repetition::OPTIONAL } else { Repetition::REQUIRED };
    let physical: Encoded = D::get_physical_type();
    let leaf = Type::primitive_type_builder("", physical).with_repetition(repetition).build();
    let leaf = Arc::new(leaf.map_err(|error| error.to_string())?);
    let path = ColumnPath::new(Vec::new());
    let leaf = Arc::new(ColumnDescriptor::new(leaf, i16::from(optional), 0, path));
    let mut reader = ColumnReaderImpl::<D>::new(leaf, Box::new(pages));
    Ok(Box::new(move |count| {
        let (mut there, mut found) = (Vec::new(), Vec::new());
        let (read, ..) = reader
            .read_records(count, optional.then_some(&mut there), None, &mut found)
            .map_err(|error| error.to_string())?;
        if read != count {
            return Err("has fewer values than rows".into());
        }
        let mut found = found.iter();
        let mut next = || found.next().map_or(Ok(Value::Null), &make);
        match optional {
            true => there
                .iter()
                .map(|&there| if there == 0 { Ok(Value::Null) } else { next() })
                .collect(),
            false => (0..count).map(|_| next()).collect(),
        }
    }))
}
