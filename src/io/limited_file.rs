//! Limits on the bytes read from a file and on the memory for its content.
//!
//! Lists, tables and JSON may have any length, come from a pipe, or be the wrong file. A stream is
//! read up to [`MAX_STREAM_BYTES`] bytes and one record up to [`MAX_RECORD_BYTES`]. The content of
//! a file may take [`MEMORY_FACTOR`] times its size plus [`BASE_MEMORY`] bytes.

use std::fs::{self, File};
use std::io::{self, BufRead, ErrorKind, Read};
use std::path::Path;

use super::content_error::ContentError;
use crate::error::{Error, Result};

/// Most bytes of an input without a size: a pipe or a device. Chosen by hand: a list of half a
/// million pairs is shorter.
pub(crate) const MAX_STREAM_BYTES: u64 = 64 << 20;
/// Most bytes of one row or line. Chosen by hand: a header of 70,000 columns is 1 MB.
pub(crate) const MAX_RECORD_BYTES: usize = 16 << 20;
/// Most bytes of one JSON document. Chosen by hand: `cfreg register --json` prints some
/// kilobytes, with a trace some megabytes.
pub(crate) const MAX_DOCUMENT_BYTES: u64 = 64 << 20;
/// Bytes of memory for each byte of a file. Chosen by hand, the same factor as for clouds.
const MEMORY_FACTOR: u64 = 10;
/// Additional bytes of memory. Chosen by hand: rows that contain only an error are short in
/// Parquet, and a quarter of a million of them fit.
const BASE_MEMORY: u64 = 256 << 20;

/// An open file: a regular one, or a stream of which at most [`MAX_STREAM_BYTES`] bytes are read.
#[derive(Debug)]
pub(crate) struct LimitedFile {
    file: File,
    /// Bytes that may still be read from a stream; `None` for a regular file.
    left: Option<u64>,
    size: u64,
}

impl LimitedFile {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Error::Io`], also for a folder.
    pub(crate) fn open(path: &Path) -> Result<LimitedFile> {
        let failed = |error| Error::io(path, error);
        let facts = fs::metadata(path).map_err(failed)?;
        if facts.is_dir() {
            return Err(failed(ErrorKind::IsADirectory.into()));
        }
        let file = File::open(path).map_err(failed)?;
        let regular = facts.is_file();
        let size = if regular { facts.len() } else { MAX_STREAM_BYTES };
        Ok(LimitedFile { file, left: (!regular).then_some(MAX_STREAM_BYTES), size })
    }

    /// Returns the memory budget of the file.
    pub(crate) fn budget(&self) -> MemoryBudget {
        MemoryBudget::new(self.size)
    }
}

impl Read for LimitedFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(left) = self.left else { return self.file.read(buffer) };
        if left == 0 {
            // One byte beyond the limit.
            return match self.file.read(&mut [0])? {
                0 => Ok(0),
                _ => Err(too_large(format!(
                    "is a stream of more than {}: write it to a file first, if it has an end",
                    mebibytes(MAX_STREAM_BYTES)
                ))),
            };
        }
        let most = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        let read = self.file.read(&mut buffer[..most])?;
        self.left = Some(left - read as u64);
        Ok(read)
    }
}

/// Reads a file of at most `most` bytes; `what` names its content in errors.
///
/// # Errors
/// [`Error::Io`]; [`Error::Parse`] for a larger file.
pub(crate) fn read_bytes(path: &Path, most: u64, what: &str) -> Result<Vec<u8>> {
    let mut content = Vec::new();
    let mut file = LimitedFile::open(path)?.take(most + 1);
    file.read_to_end(&mut content).map_err(|error| Error::io(path, error))?;
    if content.len() as u64 > most {
        let most = mebibytes(most);
        let what = format!("has more than {most}, and {what} is short: is it the right file?");
        return Err(ContentError::new(what).into_error(path));
    }
    Ok(content)
}

/// Reads a text file of at most `most` bytes; `what` names its content in errors.
///
/// # Errors
/// As [`bytes`], and [`Error::Parse`] for text that is not UTF-8.
pub(crate) fn read_text(path: &Path, most: u64, what: &str) -> Result<String> {
    String::from_utf8(read_bytes(path, most, what)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        ContentError::byte(at, "is not UTF-8 text").into_error(path)
    })
}

/// Reads the next line, including its end, into `line`; returns whether there was one.
///
/// # Errors
/// Read errors, and a line of more than [`MAX_RECORD_BYTES`] bytes.
pub(crate) fn read_line(reader: &mut impl BufRead, line: &mut Vec<u8>) -> io::Result<bool> {
    line.clear();
    reader.take(MAX_RECORD_BYTES as u64 + 1).read_until(b'\n', line)?;
    if line.len() > MAX_RECORD_BYTES {
        return Err(too_large(format!(
            "has a line of more than {}",
            mebibytes(MAX_RECORD_BYTES as u64)
        )));
    }
    Ok(!line.is_empty())
}

pub(super) fn too_large(what: String) -> io::Error {
    io::Error::new(ErrorKind::FileTooLarge, what)
}

/// Formats a number of bytes for messages.
pub(crate) fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", bytes >> 20)
}

/// Peak memory of a growing list, relative to its size: capacity doubles, and both copies exist
/// during the move.
pub(crate) const GROWTH_FACTOR: usize = 3;

/// The memory budget for the content of a file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MemoryBudget {
    most: u64,
    left: u64,
}

impl MemoryBudget {
    /// Creates the budget for a file of that many bytes.
    pub(crate) fn new(size: u64) -> MemoryBudget {
        let most = size.saturating_mul(MEMORY_FACTOR).saturating_add(BASE_MEMORY);
        MemoryBudget { most, left: most }
    }

    /// Takes bytes from the budget.
    ///
    /// # Errors
    /// When fewer are left.
    pub(crate) fn reserve(&mut self, bytes: usize) -> Result<(), String> {
        self.left = self.left.checked_sub(bytes as u64).ok_or_else(|| {
            let most = mebibytes(self.most);
            format!(
                "would take more than {most} of memory, ten times its size and {}: it is damaged, or \
                 holds something else; split it, if it is right",
                mebibytes(BASE_MEMORY)
            )
        })?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_end() {
        let mut budget = MemoryBudget::new(1 << 20);
        budget.reserve(266 << 20).unwrap();
        assert!(budget.reserve(1).unwrap_err().contains("266 MiB"));
        assert!(MemoryBudget::new(u64::MAX).reserve(usize::MAX).is_ok());
    }

    #[test]
    fn a_document_has_a_most() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        fs::write(&path, [b'x'; 9]).unwrap();
        assert_eq!(read_bytes(&path, 9, "it").unwrap().len(), 9);
        assert!(read_bytes(&path, 8, "it").unwrap_err().to_string().contains("it is short"));
    }

    #[cfg(unix)]
    #[test]
    fn a_stream_without_end_is_refused() {
        let said = read_text(Path::new("/dev/zero"), u64::MAX - 1, "it").unwrap_err().to_string();
        assert!(said.contains("stream of more than 64 MiB"), "{said}");
        let mut endless = io::BufReader::new(LimitedFile::open(Path::new("/dev/zero")).unwrap());
        let said = read_line(&mut endless, &mut Vec::new()).unwrap_err().to_string();
        assert!(said.contains("line of more than 16 MiB"), "{said}");
    }
}
