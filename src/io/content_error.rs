//! What can be wrong with a file's content.

use std::path::Path;

use crate::error::Error;

/// The longest header, or line of names, that is read, bytes.
pub(super) const MAX_HEADER_BYTES: usize = 1 << 20;

/// The most memory that a file of `size` bytes may take when it says itself how much its content
/// becomes: ten times as much, and 64 MiB, in which depth images have room that are nearly empty.
pub(super) fn max_memory(size: usize) -> usize {
    size.saturating_mul(10).saturating_add(64 << 20)
}

/// What is wrong with a file's content, and where; the path is added at the door.
#[derive(Debug)]
pub(super) struct ContentError {
    line: Option<usize>,
    byte: Option<u64>,
    what: String,
}

impl ContentError {
    /// A fault of the file as a whole.
    pub fn new(what: impl Into<String>) -> Self {
        ContentError { line: None, byte: None, what: what.into() }
    }

    /// A fault in `line`, from 1.
    pub fn line(line: usize, what: impl Into<String>) -> Self {
        ContentError { line: Some(line), ..ContentError::new(what) }
    }

    /// A fault at `byte`, from 0.
    pub fn byte(byte: usize, what: impl Into<String>) -> Self {
        ContentError { byte: Some(byte as u64), ..ContentError::new(what) }
    }

    /// The fault as an error about the file `path`.
    pub fn into_error(self, path: &Path) -> Error {
        let ContentError { line, byte, what } = self;
        Error::Parse { path: path.to_path_buf(), line, byte, what }
    }
}

/// The start of `text`, quoted and escaped for a message.
pub(crate) fn quote_start(text: &str) -> String {
    const LONGEST: usize = 40;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{:?}...", &text[..end]),
        None => format!("{text:?}"),
    }
}

/// The beginning of a message of another crate, which may repeat all that is in a file.
pub(crate) fn truncate_message(said: &str) -> String {
    const LONGEST: usize = 200;
    match said.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}...", &said[..end]),
        None => said.into(),
    }
}

/// Checks what a header says against the bytes that are there, before anything is
/// allocated: `count` rows, each of at least `smallest` bytes, in `left` bytes.
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
