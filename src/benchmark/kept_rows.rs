//! Rows that are kept in a file, from which an interrupted run resumes.

use std::collections::HashMap;
use std::fs::{self, OpenOptions};
use std::io::{BufReader, Write as _};
use std::path::{Path, PathBuf};

use super::{BenchmarkRow, Pair, Settings};
use crate::error::{Error, Result};
use crate::io;
use crate::io::limited_file::{self, LimitedFile};

/// Rows in a file, and rows added in this run.
#[derive(Default)]
pub(super) struct KeptRows {
    rows: HashMap<[String; 3], BenchmarkRow>,
    file: Option<(PathBuf, fs::File)>,
    /// Whether the file has a header.
    has_header: bool,
}

impl KeptRows {
    /// Reads the rows of `path` if it exists; an incomplete last row, or any invalid one, is
    /// dropped. The file is replaced at once by one with the valid rows.
    pub(super) fn open(path: &Path, settings: &Settings) -> Result<KeptRows> {
        let failed = |error| Error::io(path, error);
        let refuse = |rule: &str| Err(Error::config("output", path.display(), rule));
        let first = format!("# {}\n", serde_json::to_string(settings).unwrap_or_default());
        let there = path.exists();
        if there && !path.is_file() {
            return refuse("is not a regular file");
        }
        const NOT_THESE_ROWS: &str = "is there and has no rows of this benchmark, or those of other \
                               settings: name another file, or move it";
        let mut text = String::new();
        if there {
            let (mut start, mut line) = (BufReader::new(LimitedFile::open(path)?), Vec::new());
            // Before the rest of an unknown file is read.
            let read = limited_file::read_line(&mut start, &mut line);
            if read.is_err() || !(line == first.as_bytes() || first.as_bytes().starts_with(&line)) {
                return refuse(NOT_THESE_ROWS);
            }
            text = limited_file::read_text(path, MAX_FILE_BYTES, "a table of rows")?;
        }
        if !first.starts_with(&text) && !text.starts_with(&first) {
            return refuse(NOT_THESE_ROWS);
        }
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let body = whole.strip_prefix(&first).unwrap_or("");
        let mut reader = csv::Reader::from_reader(body.as_bytes());
        let rows: Vec<BenchmarkRow> = reader.deserialize().filter_map(Result::ok).collect();
        let mut content = first.into_bytes();
        content.extend(to_csv(&rows, true).map_err(|error| failed(error.into()))?);
        if text.as_bytes() != content {
            io::write_bytes(path, &content)?;
        }
        let file = OpenOptions::new().append(true).open(path).map_err(failed)?;
        match file.try_lock() {
            Err(std::fs::TryLockError::WouldBlock) => {
                return refuse("another process is at work on it");
            }
            // Some network file systems have no locks.
            Ok(()) | Err(std::fs::TryLockError::Error(_)) => {}
        }
        let titled = !rows.is_empty();
        let rows = rows.into_iter().map(|row| (row_key(&row), row)).collect();
        Ok(KeptRows { file: Some((path.into(), file)), rows, has_header: titled })
    }

    pub(super) fn find(&self, pair: &Pair, method: &str) -> Option<BenchmarkRow> {
        let path = |path: &Path| path.display().to_string();
        self.rows.get(&[path(&pair.source), path(&pair.target), method.into()]).cloned()
    }

    /// Appends a row, and the header before the first.
    pub(super) fn add(&mut self, row: &BenchmarkRow) -> Result<()> {
        let Some((path, file)) = &mut self.file else { return Ok(()) };
        let failed = |error| Error::io(&*path, error);
        let bytes =
            to_csv(std::slice::from_ref(row), !self.has_header).map_err(|e| failed(e.into()))?;
        self.has_header = true;
        file.write_all(&bytes).map_err(failed)
    }
}

/// Formats rows as CSV, with or without a header.
fn to_csv(rows: &[BenchmarkRow], titled: bool) -> std::result::Result<Vec<u8>, csv::Error> {
    let mut table = csv::WriterBuilder::new().has_headers(titled).from_writer(Vec::new());
    rows.iter().try_for_each(|row| table.serialize(row))?;
    table.into_inner().map_err(|error| error.into_error().into())
}

/// Most bytes of the file of rows. Chosen by hand: four million rows.
const MAX_FILE_BYTES: u64 = 1 << 30;

fn row_key(row: &BenchmarkRow) -> [String; 3] {
    [row.source.clone(), row.target.clone(), row.method.clone()]
}
