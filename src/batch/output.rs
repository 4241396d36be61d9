//! Results as a file: CSV, JSON Lines or Parquet.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use serde_json::Value;

use super::Row;
use super::cells::Flat;
use crate::error::{Error, Result};

/// Kinds of files that results are written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Csv,
    JsonLines,
    Parquet,
}

impl Format {
    /// By the extension of `path`.
    pub(super) fn of(path: &Path) -> Result<Format> {
        let end = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match end.as_str() {
            "csv" => Ok(Format::Csv),
            "jsonl" => Ok(Format::JsonLines),
            "parquet" if cfg!(feature = "parquet") => Ok(Format::Parquet),
            "parquet" => {
                let rule = "was built without the feature parquet: name a .csv or .jsonl";
                Err(Error::config("output", path.display(), rule))
            }
            _ => {
                let rule = "the extension must be .csv, .jsonl or .parquet";
                Err(Error::config("output", path.display(), rule))
            }
        }
    }

    /// What the run that wrote `path` was asked for, of kinds that keep it.
    pub(super) fn asked_for(self, path: &Path) -> Result<Option<Value>> {
        match self {
            #[cfg(feature = "parquet")]
            Format::Parquet => super::parquet::asked_for(path),
            _ => Ok(None),
        }
    }

    /// Writes rows to `path`, which may have in it what they were asked for by, under another name until all of them are on the disk: the file is
    /// there whole or not at all.
    pub(super) fn write(
        self,
        path: &Path,
        rows: impl Iterator<Item = Result<Row>>,
        times: bool,
        asked_for: &Value,
    ) -> Result<()> {
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(".tmp");
        let beside = path.with_file_name(name);
        let failed = |error| Error::io(&beside, error);
        let written = File::create(&beside).map_err(failed).and_then(|file| {
            match self {
                Format::Csv => csv(&file, rows, times, &failed)?,
                Format::JsonLines => json_lines(&file, rows, times, &failed)?,
                #[cfg(feature = "parquet")]
                Format::Parquet => super::parquet::write(&file, rows, times, asked_for, &failed)?,
                #[cfg(not(feature = "parquet"))]
                Format::Parquet => {}
            }
            file.sync_all().map_err(failed)?;
            fs::rename(&beside, path).map_err(|error| Error::io(path, error))
        });
        written.inspect_err(|_| {
            // The first error is the one to tell.
            let _ = fs::remove_file(&beside);
        })?;
        sync_folder(path);
        Ok(())
    }
}

/// Has the new name on the disk too, on systems whose folders can be asked for that.
fn sync_folder(path: &Path) {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    if let Ok(folder) = File::open(folder.unwrap_or(Path::new("."))) {
        let _ = folder.sync_all();
    }
}

fn csv(
    file: &File,
    rows: impl Iterator<Item = Result<Row>>,
    times: bool,
    failed: &impl Fn(io::Error) -> Error,
) -> Result<()> {
    let mut table = csv::Writer::from_writer(file);
    let refuse = |error: csv::Error| failed(error.into());
    let titles = Row::default();
    table.write_record(titles.cells(times).iter().map(|(name, _)| name)).map_err(refuse)?;
    for row in rows {
        let row = row?;
        table.write_record(row.cells(times).iter().map(|(_, cell)| cell.word())).map_err(refuse)?;
    }
    table.flush().map_err(failed)
}

fn json_lines(
    file: &File,
    rows: impl Iterator<Item = Result<Row>>,
    times: bool,
    failed: &impl Fn(io::Error) -> Error,
) -> Result<()> {
    let mut out = BufWriter::new(file);
    for row in rows {
        let row = row?;
        serde_json::to_writer(&mut out, &Flat(&row.cells(times)))
            .map_err(|error| failed(error.into()))?;
        out.write_all(b"\n").map_err(failed)?;
    }
    out.flush().map_err(failed)
}
