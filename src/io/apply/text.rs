//! Rows of text: the numbers of positions and normals move, and all else stays as it is.

use std::borrow::Cow;
use std::io::Write;
use std::ops::Range;

use super::numbers::{move_slots, write_words};
use super::{Moved, WriteFault};
use crate::cloud::Transform;
use crate::io::cells::{Separator, split_comment};
use crate::io::content_error::ContentError;
use crate::io::text::{TextColumns, TextReader, decode_latin1};

/// Moves the rows of a file as [`crate::io::text::parse`] finds them.
pub(super) fn apply(
    content: &[u8],
    default: TextColumns,
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    let text = decode_latin1(content);
    let is_latin = matches!(text, Cow::Owned(_));
    // A whole number before the first decimal comma needs one, too.
    let mut has_commas = false;
    if text.contains(&b',') {
        let mut first = TextReader::new(default);
        for raw in RawLines::new(&text) {
            raw.read(&mut first)?;
        }
        has_commas = first.has_decimal_commas();
    }
    let mut reader = TextReader::new(default);
    let (mut moved, mut buffer) = (Moved::default(), Vec::new());
    for raw in RawLines::new(&text) {
        if !raw.read(&mut reader)? {
            write(out, raw.whole, is_latin)?;
            continue;
        }
        moved.points += 1;
        buffer.clear();
        move_row(raw.text()?, &reader, transform, has_commas, &mut buffer)?;
        buffer.extend_from_slice(&raw.whole[raw.line.len()..]);
        write(out, &buffer, is_latin)?;
    }
    Ok(moved)
}

/// A line with its ending, its number, and what follows.
struct RawLine<'a> {
    line: &'a [u8],
    whole: &'a [u8],
    number: usize,
    rest: &'a [u8],
}

impl<'a> RawLine<'a> {
    fn text(&self) -> Result<&'a str, ContentError> {
        let refuse = |_| ContentError::line(self.number, "is no text");
        std::str::from_utf8(self.line).map_err(refuse)
    }

    /// Has `reader` take the line up, and returns whether it is a row.
    fn read(&self, reader: &mut TextReader) -> Result<bool, ContentError> {
        let bare = bare(self.text()?);
        Ok(!bare.is_empty() && reader.next_row(bare, self.number, self.rest)?)
    }
}

/// The lines of a text, as [`crate::io::lines::Lines`] ends them.
struct RawLines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> RawLines<'a> {
    fn new(text: &'a [u8]) -> Self {
        RawLines { rest: text, number: 0 }
    }
}

impl<'a> Iterator for RawLines<'a> {
    type Item = RawLine<'a>;

    fn next(&mut self) -> Option<RawLine<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let end = self.rest.iter().position(|&byte| byte == b'\n' || byte == b'\r');
        let (line, after) = self.rest.split_at(end.unwrap_or(self.rest.len()));
        let ending = if after.starts_with(b"\r\n") { 2 } else { after.len().min(1) };
        let (whole, rest) = self.rest.split_at(line.len() + ending);
        self.number += 1;
        self.rest = rest;
        Some(RawLine { line, whole, number: self.number, rest })
    }
}

/// Returns a line without a byte order mark and white space around it.
fn bare(line: &str) -> &str {
    line.trim_start_matches('\u{feff}').trim()
}

/// Writes text as it was read: in UTF-8, or a byte a letter.
fn write(out: &mut dyn Write, text: &[u8], is_latin: bool) -> std::io::Result<()> {
    if !is_latin {
        return out.write_all(text);
    }
    let letters = String::from_utf8_lossy(text);
    let bytes: Vec<u8> = letters.chars().map(|letter| letter as u32 as u8).collect();
    out.write_all(&bytes)
}

fn move_row(
    line: &str,
    reader: &TextReader,
    transform: &Transform,
    has_commas: bool,
    out: &mut Vec<u8>,
) -> std::io::Result<()> {
    let Some((separator, columns)) = reader.layout() else { return out.write_all(line.as_bytes()) };
    let vertex = reader.vertex();
    let mut slots = [None; 6];
    let values = vertex.place.iter().chain(&vertex.normal);
    for ((slot, value), column) in slots.iter_mut().zip(values).zip(columns) {
        *slot = column.map(|_| *value);
    }
    let moved = move_slots(transform, slots);
    let ranges = cell_ranges(line, separator);
    let mut words: Vec<(Range<usize>, f64)> = (0..6)
        .filter_map(|slot| Some((ranges.get(columns[slot]?)?.clone(), moved[slot]?)))
        .collect();
    words.sort_by_key(|(range, _)| range.start);
    write_words(out, line, &words, has_commas)
}

/// Returns the byte ranges of the numbers in the cells of a row, without white space and quotes.
fn cell_ranges(line: &str, separator: Separator) -> Vec<Range<usize>> {
    let start = line.as_ptr() as usize;
    let (data, _) = split_comment(bare(line));
    let ranges = separator.words(data).map(|word| {
        let at = word.as_ptr() as usize - start;
        at..at + word.len()
    });
    ranges.collect()
}
