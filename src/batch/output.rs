//! Results as a file: CSV, JSON Lines or Parquet.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::columns::FlatRow;
use super::journal::Journal;
use super::run_file::{RUN_HEADER_SUFFIX, is_run_header, with_suffix};
use super::{PairList, Row};
use crate::error::{Error, Result};
use crate::io::limited_file;
use crate::io::outputs::{self, FileIdentity};

/// File formats of results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ResultsFormat {
    Csv,
    JsonLines,
    Parquet,
}

impl ResultsFormat {
    /// Returns the format by the extension of `path`.
    pub(super) fn from_path(path: &Path) -> Result<ResultsFormat> {
        let end = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match end.as_str() {
            "csv" => Ok(ResultsFormat::Csv),
            "jsonl" => Ok(ResultsFormat::JsonLines),
            "parquet" if cfg!(feature = "parquet") => Ok(ResultsFormat::Parquet),
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

    /// Returns the inputs of the run that wrote `path`: Parquet has them inside, the other formats
    /// in a file beside them. `None` if they are missing.
    pub(super) fn read_run_header(self, path: &Path) -> Result<Option<Value>> {
        match self {
            #[cfg(feature = "parquet")]
            ResultsFormat::Parquet => super::parquet::read_run_header(path),
            #[cfg(not(feature = "parquet"))]
            ResultsFormat::Parquet => Ok(None),
            ResultsFormat::Csv | ResultsFormat::JsonLines => {
                const WHAT: &str = "what a run was asked for";
                let path = with_suffix(path, RUN_HEADER_SUFFIX);
                match path.exists() {
                    true => Ok(serde_json::from_slice(&limited_file::read_bytes(
                        &path,
                        limited_file::MAX_DOCUMENT_BYTES,
                        WHAT,
                    )?)
                    .ok()),
                    false => Ok(None),
                }
            }
        }
    }

    /// Writes rows to `path`, with the inputs of the run inside or beside. Files have a temporary
    /// name until they are completely on the disk, so that no file is partial; the inputs are
    /// written before the rows.
    pub(super) fn write(
        self,
        path: &Path,
        rows: impl Iterator<Item = Result<Row>>,
        times: bool,
        asked_for: &Value,
    ) -> Result<()> {
        if self != ResultsFormat::Parquet {
            write_atomically(&with_suffix(path, RUN_HEADER_SUFFIX), |mut file, failed| {
                file.write_all(format!("{asked_for:#}\n").as_bytes()).map_err(failed)
            })?;
        }
        write_atomically(path, |file, failed| match self {
            ResultsFormat::Csv => write_csv(file, rows, times, &failed),
            ResultsFormat::JsonLines => write_json_lines(file, rows, times, &failed),
            #[cfg(feature = "parquet")]
            ResultsFormat::Parquet => super::parquet::write(file, rows, times, asked_for, &failed),
            #[cfg(not(feature = "parquet"))]
            ResultsFormat::Parquet => Ok(()),
        })
    }
}

/// Refuses an output that would replace another file: a file beside the output that no earlier run
/// wrote, the list, or one of its clouds.
pub(super) fn check(output: &Path, format: ResultsFormat, list: &PairList) -> Result<()> {
    let refuse = |path: &Path, rule: &str| Err(Error::config("output", path.display(), rule));
    let journal = Journal::path_for(output);
    Journal::check(&journal)?;
    let mut written = vec![output.to_path_buf(), journal];
    if format != ResultsFormat::Parquet {
        let run = with_suffix(output, RUN_HEADER_SUFFIX);
        if run.exists() && !format.read_run_header(output)?.is_some_and(|run| is_run_header(&run)) {
            return refuse(
                &run,
                "is there and was not written by this program: move it, or name another output",
            );
        }
        written.push(run);
    }
    // A missing file is no input.
    written.retain(|path| path.is_file());
    let taken: Vec<(Option<FileIdentity>, PathBuf)> =
        written.into_iter().map(|path| (FileIdentity::from_path(&path), path)).collect();
    if taken.is_empty() {
        return Ok(());
    }
    for input in list.file().map(Path::to_path_buf).into_iter().chain(list.files()) {
        let input = FileIdentity::from_path(&input);
        if let Some((_, path)) = taken.iter().find(|(file, _)| file.is_some() && *file == input) {
            return refuse(
                path,
                "is the list, or one of its clouds, and would be overwritten: name another output",
            );
        }
    }
    Ok(())
}

/// Writes `path` by `write`, under an unused temporary name until it is on the disk.
fn write_atomically(
    path: &Path,
    write: impl FnOnce(&File, &dyn Fn(io::Error) -> Error) -> Result<()>,
) -> Result<()> {
    let failed = |error| Error::io(path, error);
    // Resolves a link, so that the link remains.
    let target = fs::canonicalize(path).unwrap_or_else(|_| path.to_path_buf());
    let beside = outputs::create_temporary(&target).map_err(failed)?;
    write(beside.as_file(), &failed)?;
    beside.as_file().sync_all().map_err(failed)?;
    beside.persist(&target).map_err(|error| failed(error.error))?;
    sync_folder(&target);
    Ok(())
}

/// Flushes the new name to disk too, on systems that support this for folders.
fn sync_folder(path: &Path) {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    if let Ok(folder) = File::open(folder.unwrap_or(Path::new("."))) {
        let _ = folder.sync_all();
    }
}

fn write_csv(
    file: &File,
    rows: impl Iterator<Item = Result<Row>>,
    times: bool,
    failed: &impl Fn(io::Error) -> Error,
) -> Result<()> {
    let mut table = csv::Writer::from_writer(file);
    let refuse = |error: csv::Error| failed(error.into());
    let titles = Row::default();
    table.write_record(titles.column_values(times).iter().map(|(name, _)| name)).map_err(refuse)?;
    for row in rows {
        let row = row?;
        table
            .write_record(row.column_values(times).iter().map(|(_, cell)| cell.to_csv()))
            .map_err(refuse)?;
    }
    table.flush().map_err(failed)
}

fn write_json_lines(
    file: &File,
    rows: impl Iterator<Item = Result<Row>>,
    times: bool,
    failed: &impl Fn(io::Error) -> Error,
) -> Result<()> {
    let mut out = BufWriter::new(file);
    for row in rows {
        let row = row?;
        serde_json::to_writer(&mut out, &FlatRow(&row.column_values(times)))
            .map_err(|error| failed(error.into()))?;
        out.write_all(b"\n").map_err(failed)?;
    }
    out.flush().map_err(failed)
}
