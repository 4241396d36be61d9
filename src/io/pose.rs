//! Poses: a 4×4 matrix as text or JSON.

use std::path::Path;

use serde::Deserialize;

use super::content_error::{ContentError, quote_start};
use super::lines::{Lines, number};
use super::{limited_file, write_atomically};
use crate::cloud::Transform;
use crate::error::Result;

/// Most bytes of a pose file, including the JSON of a registration. Chosen by hand.
const MAX_POSE_BYTES: u64 = 4 << 20;

/// Reads a pose: four lines of four numbers (spaces or commas between, comments after `#`), a JSON
/// array of four rows, or a JSON object with such an array in its field `transform`.
///
/// # Errors
/// [`crate::Error::Io`] when the file cannot be read, [`crate::Error::Parse`] when it has no 4×4
/// matrix or one that [`Transform::from_matrix`] refuses.
///
/// ```no_run
/// let target_source = cfreg::io::read_transform("pose.txt")?;
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn read_transform(path: impl AsRef<Path>) -> Result<Transform> {
    let path = path.as_ref();
    let content = limited_file::read_bytes(path, MAX_POSE_BYTES, "a pose")?;
    if content.is_empty() {
        return Err(ContentError::new("is empty").into_error(path));
    }
    let matrix = match content.trim_ascii_start().first() {
        Some(b'[' | b'{') => parse_json(&content),
        _ => parse_rows(&content),
    };
    let transform = matrix.and_then(|matrix| {
        Transform::from_matrix(matrix).map_err(|error| ContentError::new(error.to_string()))
    });
    transform.map_err(|fault| fault.into_error(path))
}

/// Writes a pose as four lines of four numbers, with enough digits to read each back exactly.
///
/// # Errors
/// [`crate::Error::Io`] when the system refuses; an existing file is then unchanged.
pub fn write_transform(path: impl AsRef<Path>, transform: &Transform) -> Result<()> {
    write_atomically(path.as_ref(), |out| {
        let rows = transform.matrix();
        rows.iter().try_for_each(|[a, b, c, d]| writeln!(out, "{a:?} {b:?} {c:?} {d:?}"))
    })
}

type Matrix = [[f64; 4]; 4];

/// The JSON forms of a pose.
#[derive(Deserialize)]
#[serde(untagged)]
enum Document {
    Bare(Matrix),
    Named { transform: Matrix },
}

fn parse_json(content: &[u8]) -> Result<Matrix, ContentError> {
    // In two steps, because an untagged enum loses the line of a syntax error.
    let value: serde_json::Value = serde_json::from_slice(content)
        .map_err(|error| ContentError::line(error.line(), format!("is not JSON: {error}")))?;
    match serde_json::from_value(value) {
        Ok(Document::Bare(matrix) | Document::Named { transform: matrix }) => Ok(matrix),
        Err(_) => Err(ContentError::new(
            "expected a JSON array of 4 rows of 4 numbers, or an object with such a field \
             \"transform\"",
        )),
    }
}

fn parse_rows(content: &[u8]) -> Result<Matrix, ContentError> {
    let mut matrix = [[0.0; 4]; 4];
    let mut rows = matrix.iter_mut();
    for line in Lines::new(content, 0, 0) {
        let (number, line) = line?;
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let row =
            rows.next().ok_or_else(|| ContentError::line(number, "there is a fifth row of 4"))?;
        *row = parse_row(line).map_err(|what| ContentError::line(number, what))?;
    }
    match rows.len() {
        0 => Ok(matrix),
        missing => Err(ContentError::new(format!("there are {} rows, expected 4", 4 - missing))),
    }
}

fn parse_row(line: &str) -> Result<[f64; 4], String> {
    let words: Vec<&str> = line.split([',', ' ', '\t']).filter(|word| !word.is_empty()).collect();
    let words: [&str; 4] = words
        .try_into()
        .map_err(|words: Vec<_>| format!("the row has {} numbers, expected 4", words.len()))?;
    let mut row = [0.0; 4];
    for (value, word) in row.iter_mut().zip(words) {
        *value = number(word).ok_or_else(|| format!("{} is not a number", quote_start(word)))?;
    }
    Ok(row)
}
