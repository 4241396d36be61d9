//! Rows that are kept in a file, such that a run which was cut short goes on from them.

use std::collections::HashMap;
use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::{Pair, Row, Settings};
use crate::error::{Error, Result};

/// Rows in a file, and those that join them.
#[derive(Default)]
pub(super) struct Kept {
    rows: HashMap<[String; 3], Row>,
    file: Option<(PathBuf, fs::File)>,
    /// Whether the file has the names of its columns.
    titled: bool,
}

impl Kept {
    /// Reads the rows of `path` if it is there; a last row that was cut short is dropped.
    pub(super) fn open(path: &Path, settings: &Settings) -> Result<Kept> {
        let failed = |error| Error::io(path, error);
        let first = format!("# {}\n", serde_json::to_string(settings).unwrap_or_default());
        let text = match fs::read_to_string(path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(failed(error)),
        };
        if !text.is_empty() && !text.starts_with(&first) {
            let rule = "was made by other settings: name another file or remove it";
            return Err(Error::config("output", path.display(), rule));
        }
        let whole = text.rfind('\n').map_or("", |end| &text[..=end]);
        let body = whole.strip_prefix(&first).unwrap_or("");
        let mut reader = csv::Reader::from_reader(body.as_bytes());
        let rows: Vec<Row> = reader.deserialize().filter_map(Result::ok).collect();
        // Written anew, whole: what comes is appended to it.
        let mut file = OpenOptions::new()
            .create(true)
            .write(true)
            .truncate(true)
            .open(path)
            .map_err(failed)?;
        file.write_all(first.as_bytes()).map_err(failed)?;
        let mut kept = Kept { file: Some((path.into(), file)), ..Kept::default() };
        kept.write(&rows)?;
        kept.rows = rows.into_iter().map(|row| (key(&row), row)).collect();
        Ok(kept)
    }

    pub(super) fn find(&self, pair: &Pair, method: &str) -> Option<Row> {
        let path = |path: &Path| path.display().to_string();
        self.rows.get(&[path(&pair.source), path(&pair.target), method.into()]).cloned()
    }

    pub(super) fn add(&mut self, row: &Row) -> Result<()> {
        self.write(std::slice::from_ref(row))
    }

    /// Appends rows, the names of their columns before the first.
    fn write(&mut self, rows: &[Row]) -> Result<()> {
        let Some((path, file)) = &mut self.file else { return Ok(()) };
        let mut table = csv::WriterBuilder::new().has_headers(!self.titled).from_writer(Vec::new());
        let failed = |error: csv::Error| Error::io(&*path, std::io::Error::other(error));
        for row in rows {
            table.serialize(row).map_err(failed)?;
        }
        self.titled |= !rows.is_empty();
        let bytes = table
            .into_inner()
            .map_err(|error| Error::io(&*path, std::io::Error::other(error.to_string())))?;
        file.write_all(&bytes).map_err(|error| Error::io(&*path, error))
    }
}

fn key(row: &Row) -> [String; 3] {
    [row.source.clone(), row.target.clone(), row.method.clone()]
}
