//! Reading of written results.

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, Visitor};
use serde_json::Value;

use super::Row;
use super::output::ResultsFormat;
use crate::error::{Error, Result};
use crate::io::CsvReader;
use crate::io::limited_file::{self, LimitedFile};

/// Reads the rows of a `.csv`, `.jsonl` or `.parquet`, or of a folder with `.parquet` in it, as
/// clusters write them: then in the order of their index.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for invalid rows, with the line or row and the column, for a
/// file whose rows take more memory than ten times its size and 256 MiB, and for a folder in which
/// a pair has two rows; [`Error::Config`] for another extension.
pub fn read(path: &Path) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    if !path.is_dir() {
        ResultsFormat::from_path(path)?;
        let mut budget = LimitedFile::open(path)?.budget();
        for_each_row(path, |row| {
            let bytes = limited_file::GROWTH_FACTOR * size_of::<Row>() + row.text_bytes();
            budget.reserve(bytes).map_err(|what| Error::parse(path, None, what))?;
            rows.push(row);
            Ok(())
        })?;
        return Ok(rows);
    }
    let failed = |error| Error::io(path, error);
    let files = fs::read_dir(path).map_err(failed)?;
    let files = files.map(|entry| entry.map(|entry| entry.path()).map_err(failed));
    let mut files = files.collect::<Result<Vec<PathBuf>>>()?;
    files.retain(|file| file.extension().is_some_and(|end| end == "parquet"));
    files.sort();
    let wrong = |what: String| Error::parse(path, None, what);
    if files.is_empty() {
        return Err(wrong("no .parquet in this folder".into()));
    }
    for file in files {
        rows.extend(read(&file)?);
    }
    rows.sort_by_key(|row| row.index);
    match rows.windows(2).find(|two| two[0].index == two[1].index) {
        Some(two) => Err(wrong(format!("two rows of pair {}", two[0].index))),
        None => Ok(rows),
    }
}

/// Reads rows from text, as in a `.jsonl`.
///
/// # Errors
/// [`Error::Parse`] as [`read`].
pub fn parse(json_lines: &str) -> Result<Vec<Row>> {
    let path = Path::new("rows");
    let row = |(line, number): (&str, usize)| {
        json_row(line.as_bytes()).map_err(|what| Error::parse(path, Some(number), what))
    };
    json_lines.lines().zip(1..).map(row).collect()
}

/// Passes each row of a file to `take`, in the order of the file.
///
/// # Errors
/// Those of [`read`], and the first of `take`.
pub(super) fn for_each_row(path: &Path, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    match ResultsFormat::from_path(path)? {
        ResultsFormat::Csv => read_csv(path, take),
        ResultsFormat::JsonLines => read_json_lines(path, take),
        #[cfg(feature = "parquet")]
        ResultsFormat::Parquet => super::parquet::read_rows(path, |number, cells| {
            let row = Row::read(cells);
            take(row.map_err(|what| Error::parse(path, None, format!("row {number}: {what}")))?)
        }),
        #[cfg(not(feature = "parquet"))]
        ResultsFormat::Parquet => Ok(()),
    }
}

fn read_csv(path: &Path, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    let mut sheet = CsvReader::open(path)?;
    while sheet.next()? {
        let row = Row::read(|name| sheet.find(name).map(Value::from));
        take(row.map_err(|what| sheet.parse_error(what))?)?;
    }
    Ok(())
}

fn read_json_lines(path: &Path, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    let mut reader = BufReader::new(LimitedFile::open(path)?);
    let mut line = Vec::new();
    for number in 1.. {
        if !limited_file::read_line(&mut reader, &mut line)
            .map_err(|error| Error::io(path, error))?
        {
            break;
        }
        take(json_row(&line).map_err(|what| Error::parse(path, Some(number), what))?)?;
    }
    Ok(())
}

fn json_row(line: &[u8]) -> std::result::Result<Row, String> {
    let RowCells(cells) = serde_json::from_slice(line).map_err(|error| error.to_string())?;
    Row::read(|name| cells.get(name).cloned())
}

/// The cells of a row that are columns; all others are ignored.
struct RowCells(HashMap<String, Value>);

/// Names of the columns.
static COLUMNS: LazyLock<HashSet<String>> = LazyLock::new(|| {
    Row::default().column_values(true).into_iter().map(|(name, _)| name).collect()
});

impl<'de> Deserialize<'de> for RowCells {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<RowCells, D::Error> {
        struct RowCellsVisitor;
        impl<'de> Visitor<'de> for RowCellsVisitor {
            type Value = RowCells;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a row, as {\"index\": 0, ...}")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<RowCells, A::Error> {
                let mut cells = HashMap::new();
                while let Some(name) = map.next_key::<String>()? {
                    match COLUMNS.contains(&name) {
                        true => _ = cells.insert(name, map.next_value::<Scalar>()?.0),
                        false => _ = map.next_value::<IgnoredAny>()?,
                    }
                }
                Ok(RowCells(cells))
            }
        }
        deserializer.deserialize_map(RowCellsVisitor)
    }
}

/// The value of a cell, neither a list nor an object.
struct Scalar(Value);

impl<'de> Deserialize<'de> for Scalar {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Scalar, D::Error> {
        struct ScalarVisitor;
        impl Visitor<'_> for ScalarVisitor {
            type Value = Scalar;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a text, a number, true, false or null")
            }

            fn visit_bool<E>(self, flag: bool) -> Result<Scalar, E> {
                Ok(Scalar(flag.into()))
            }

            fn visit_i64<E>(self, number: i64) -> Result<Scalar, E> {
                Ok(Scalar(number.into()))
            }

            fn visit_u64<E>(self, number: u64) -> Result<Scalar, E> {
                Ok(Scalar(number.into()))
            }

            fn visit_f64<E>(self, number: f64) -> Result<Scalar, E> {
                Ok(Scalar(number.into()))
            }

            fn visit_str<E>(self, text: &str) -> Result<Scalar, E> {
                Ok(Scalar(text.into()))
            }

            fn visit_unit<E>(self) -> Result<Scalar, E> {
                Ok(Scalar(Value::Null))
            }
        }
        deserializer.deserialize_any(ScalarVisitor)
    }
}
