//! Errors in a file's content.

use std::fmt;
use std::path::Path;

use crate::error::Error;

/// The longest header, or line of column names, that is read, in bytes. Chosen by hand.
pub(super) const MAX_HEADER_BYTES: usize = 1 << 20;

/// Returns the memory limit for a file of `size` bytes that itself declares the size of its
/// content: ten times the file, plus 64 MiB for depth images that are nearly empty.
pub(super) fn max_memory(size: usize) -> usize {
    size.saturating_mul(10).saturating_add(64 << 20)
}

/// An error in a file's content and its position; the public functions add the path.
#[derive(Debug)]
pub(super) struct ContentError {
    line: Option<usize>,
    byte: Option<u64>,
    what: String,
}

impl ContentError {
    /// Creates an error of the file as a whole.
    pub fn new(what: impl Into<String>) -> Self {
        ContentError { line: None, byte: None, what: what.into() }
    }

    /// Creates an error in `line`, from 1.
    pub fn line(line: usize, what: impl Into<String>) -> Self {
        ContentError { line: Some(line), ..ContentError::new(what) }
    }

    /// Creates an error at `byte`, from 0.
    pub fn byte(byte: usize, what: impl Into<String>) -> Self {
        ContentError { byte: Some(byte as u64), ..ContentError::new(what) }
    }

    /// Returns the message alone.
    #[cfg(feature = "formats")]
    pub fn message(&self) -> &str {
        &self.what
    }

    /// Puts the name of a part of the file before the message; the position, which is one within
    /// that part, goes.
    pub fn within(self, part: &str) -> Self {
        ContentError::new(format!("{part}: {}", self.what))
    }

    /// Puts the name of the format before the message.
    pub fn in_format(self, format: impl fmt::Display) -> Self {
        ContentError { what: format!("{format}: {}", self.what), ..self }
    }

    /// Converts to an [`Error`] about the file `path`.
    pub fn into_error(self, path: &Path) -> Error {
        let ContentError { line, byte, what } = self;
        Error::Parse { path: path.to_path_buf(), line, byte, what }
    }
}

/// Returns the start of `text`, quoted and escaped for a message.
pub(crate) fn quote_start(text: &str) -> String {
    const LONGEST: usize = 40;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{:?}...", &text[..end]),
        None => format!("{text:?}"),
    }
}

/// Returns the start of a message of another crate, which may repeat the whole file.
pub(crate) fn truncate_message(said: &str) -> String {
    const LONGEST: usize = 200;
    match said.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &said[..end]),
        None => said.into(),
    }
}

/// Checks the size in a header against the bytes present, before any allocation: `count` rows, each
/// of at least `smallest` bytes, in `left` bytes.
pub(super) fn check_claim(
    what: &str,
    count: u64,
    smallest: u64,
    left: usize,
) -> Result<usize, String> {
    let needed = u128::from(count) * u128::from(smallest);
    match usize::try_from(count) {
        Ok(count) if needed <= left as u128 => Ok(count),
        _ => Err(format!(
            "the header claims {count} {what} of at least {smallest} bytes each, but {left} bytes \
             are left, enough for {}",
            left as u64 / smallest.max(1)
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claims_are_weighed_without_overflow() {
        assert_eq!(check_claim("points", 3, 12, 36), Ok(3));
        assert!(check_claim("points", 4, 12, 47).unwrap_err().contains("enough for 3"));
        assert!(check_claim("points", u64::MAX, u64::MAX, 1).is_err());
    }
}
