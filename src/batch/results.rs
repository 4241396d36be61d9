//! Results that were written, read again.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::Row;
use super::output::Format;
use crate::error::{Error, Result};

/// Reads the rows of a `.csv`, `.jsonl` or `.parquet`, or of a folder with `.parquet` in it, as
/// clusters write them: then in the order of their index.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for what are no such rows, with the line or row and the column,
/// and for a folder in which a pair has two rows; [`Error::Config`] for another extension.
pub fn read(path: &Path) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    if !path.is_dir() {
        each(path, |row| {
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
    let row =
        |(line, number)| json_row(line).map_err(|what| Error::parse(path, Some(number), what));
    json_lines.lines().zip(1..).map(row).collect()
}

/// Gives each row of a file to `take`, in the order of the file.
///
/// # Errors
/// Those of [`read`], and the first of `take`.
pub(super) fn each(path: &Path, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    match Format::of(path)? {
        Format::Csv => csv(path, take),
        Format::JsonLines => json_lines(path, take),
        #[cfg(feature = "parquet")]
        Format::Parquet => super::parquet::rows(path, |number, cells| {
            let row = Row::read(|name| cells.get(name).cloned());
            take(row.map_err(|what| Error::parse(path, None, format!("row {number}: {what}")))?)
        }),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => Ok(()),
    }
}

fn csv(path: &Path, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    let failed = |error| super::list::csv_error(path, error);
    let mut reader = csv::Reader::from_path(path).map_err(failed)?;
    let header = reader.headers().map_err(failed)?.clone();
    let places = header.iter().zip(0..).collect::<std::collections::HashMap<&str, usize>>();
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(failed)? {
        let get = |name: &str| record.get(*places.get(name)?).map(Value::from);
        let line = record.position().map(|at| at.line() as usize);
        take(Row::read(get).map_err(|what| Error::parse(path, line, what))?)?;
    }
    Ok(())
}

fn json_lines(path: &Path, mut take: impl FnMut(Row) -> Result<()>) -> Result<()> {
    let file = File::open(path).map_err(|error| Error::io(path, error))?;
    for (line, number) in BufReader::new(file).lines().zip(1..) {
        let line = line.map_err(|error| Error::io(path, error))?;
        take(json_row(&line).map_err(|what| Error::parse(path, Some(number), what))?)?;
    }
    Ok(())
}

fn json_row(line: &str) -> std::result::Result<Row, String> {
    let cells: Map<String, Value> =
        serde_json::from_str(line).map_err(|error| error.to_string())?;
    Row::read(|name| cells.get(name).cloned())
}
