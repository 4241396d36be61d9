//! Rows of numbers as text: .xyz, .txt, .csv, .asc, .pts, .xyzn.

use std::io::{self, Write};

use super::columns::{ColumnKind, ColumnMap, Vertex, color};
use super::content_error::{ContentError, MAX_HEADER_BYTES, quote_start};
use super::differences::Differences;
use super::layout::{FieldLayout, is_single};
use super::lines::{Lines, number};
use super::table::PointTable;
use crate::cloud::PointCloud;

/// Byte order mark that some editors put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads one point a line, with the columns of `default` unless a line of names gives others.
///
/// Before the first point there may be one line of names and, in .pts, one with the number of
/// points. Names may be in a comment (`//X Y Z`, `# x y z`): they count if their number is the
/// number of columns of the first point.
pub(super) fn parse(content: &[u8], default: ColumnMap) -> Result<PointTable, ContentError> {
    let start = if content.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    let mut preamble = Preamble::default();
    let mut table: Option<(ColumnMap, PointTable)> = None;
    let mut vertex = Vertex::default();
    let mut lines = Lines::new(content, start, 0);
    let mut comments = 0;
    while let Some(line) = lines.next() {
        let (number, line) = line?;
        let (line, comment) = split_comment(line);
        if let Some(comment) = comment {
            comments += 1;
            if table.is_none() {
                preamble.read_comment(comment);
            }
        }
        if line.is_empty() {
            continue;
        }
        let words = words(line);
        let (columns, table) = match &mut table {
            Some(table) => table,
            None if preamble.read_line(line, number)? => continue,
            None => {
                let width = words.clone().count();
                let columns = preamble.columns(Some(width));
                let columns = columns.unwrap_or_else(|| default.clone().without_names(width));
                // Rows may lack columns that are not required; the columns are then left out.
                let needed = if columns.has_normals() { 6 } else { 3 };
                let [most, full] = [needed, width].map(|words| max_rows(lines.rest(), words));
                let empty = PointTable::new(most, &columns).with_column_capacity(full);
                table.insert((columns, empty))
            }
        };
        columns.parse(&mut vertex, words, number)?;
        table.push(&vertex).map_err(|what| ContentError::line(number, what))?;
    }
    let table = table
        .map(|(_, table)| table)
        .unwrap_or_else(|| PointTable::new(0, &preamble.columns(None).unwrap_or(default)));
    if let Some((line, count)) = preamble.claimed.filter(|(_, count)| *count != table.len() as u64)
    {
        let what = format!("the line claims {count} points, the file has {}", table.len());
        return Err(ContentError::line(line, what));
    }
    let mut differences = Differences::default();
    differences.leave_out_all(comments - preamble.used_comments, "comment");
    Ok(table.with_differences(differences))
}

/// Returns the most rows of `width` words that fit: one row and the `rest` after it.
fn max_rows(rest: &[u8], width: usize) -> usize {
    let ends = rest.iter().filter(|&&byte| byte == b'\n' || byte == b'\r').count();
    // One digit per word, and a separator.
    1 + (1 + ends).min(rest.len() / (2 * width.max(1)))
}

/// The lines before the first point.
#[derive(Default)]
struct Preamble {
    /// Columns from a line of names.
    named: Option<ColumnMap>,
    /// Columns from a comment that may be a line of names, and the number of names.
    noted: Option<(ColumnMap, usize)>,
    /// The line with the declared number of points, and that number.
    claimed: Option<(usize, u64)>,
    /// Number of comments used as lines of names.
    used_comments: usize,
}

impl Preamble {
    /// Reads a comment as a possible line of names.
    fn read_comment(&mut self, comment: &str) {
        if comment.len() > MAX_HEADER_BYTES {
            return;
        }
        if let Ok(columns) = columns_from_names(comment) {
            self.noted = Some((columns, words(comment).count()));
        }
    }

    /// Reads a line of the preamble; returns `false` if the line must be the first point.
    fn read_line(&mut self, line: &str, number: usize) -> Result<bool, ContentError> {
        if self.named.is_none() && is_header(words(line)) {
            if line.len() > MAX_HEADER_BYTES {
                let what = format!("the line of names takes more than {MAX_HEADER_BYTES} bytes");
                return Err(ContentError::line(number, what));
            }
            self.named =
                Some(columns_from_names(line).map_err(|what| ContentError::line(number, what))?);
            return Ok(true);
        }
        let mut words = words(line);
        if let (None, Some(word), None) = (self.claimed, words.next(), words.next()) {
            let count = word.parse().map_err(|_| {
                let what =
                    format!("{} is neither a point nor a number of points", quote_start(word));
                ContentError::line(number, what)
            })?;
            self.claimed = Some((number, count));
            return Ok(true);
        }
        Ok(false)
    }

    /// Returns the named columns, for points of `width` columns if there are any.
    fn columns(&mut self, width: Option<usize>) -> Option<ColumnMap> {
        let noted = self.noted.take();
        let fits = noted.filter(|(_, names)| width.is_none_or(|width| width == *names));
        self.named.take().or_else(|| {
            self.used_comments = usize::from(fits.is_some());
            fits.map(|(columns, _)| columns)
        })
    }
}

/// Parses the columns that a line names.
fn columns_from_names(line: &str) -> Result<ColumnMap, String> {
    // The first column of a pandas table is its index, without a name.
    let named = |word: &&str| !word.is_empty();
    let unnamed = words(line).filter(|word| word.is_empty()).count();
    let columns = ColumnMap::from_names(words(line).map(|word| Some(word).filter(named)))?;
    Ok(columns
        .without_unnamed(unnamed)
        .with_kinds(|name, _| color(name).map_or(ColumnKind::Number, ColumnKind::Text)))
}

/// Writes a line of names after `comment`, then a point a line, each number with enough digits to
/// read it back exactly.
pub(super) fn write(
    out: &mut dyn Write,
    cloud: &PointCloud,
    layout: &FieldLayout<'_>,
    comment: &str,
    separator: &str,
) -> io::Result<()> {
    let single = is_single(cloud);
    let mut names = match cloud.normals() {
        Some(_) => vec!["x", "y", "z", "nx", "ny", "nz"],
        None => vec!["x", "y", "z"],
    };
    names.extend(layout.fields.iter().map(|field| field.name.as_str()));
    writeln!(out, "{comment}{}", names.join(separator))?;
    for (i, ([x, y, z], position)) in cloud.points().iter().zip(cloud.positions()).enumerate() {
        if single {
            write!(out, "{x:?}{separator}{y:?}{separator}{z:?}")?;
        } else {
            let [x, y, z] = position;
            write!(out, "{x:?}{separator}{y:?}{separator}{z:?}")?;
        }
        if let Some(normals) = cloud.normals() {
            let [x, y, z] = normals[i];
            write!(out, "{separator}{x:?}{separator}{y:?}{separator}{z:?}")?;
        }
        for field in &layout.fields {
            out.write_all(separator.as_bytes())?;
            field.write_text(out, i)?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Splits a line into data and comment. A mark within a word starts no comment: some libraries
/// write a NaN as `1.#QNAN`.
fn split_comment(line: &str) -> (&str, Option<&str>) {
    let starts = |&(at, _): &(usize, &str)| at == 0 || line[..at].ends_with([' ', '\t', ',', ';']);
    let marks = ["#", "//"].into_iter().filter_map(|mark| line.match_indices(mark).find(starts));
    match marks.min() {
        Some((at, mark)) => (line[..at].trim_end(), Some(&line[at + mark.len()..])),
        None => (line, None),
    }
}

/// Splits a line into words: at semicolons if there are any, else at commas, else at white space.
/// Decimal commas then give words like `1,5` or `5 2`, which are refused.
fn words(line: &str) -> Words<'_> {
    match [';', ','].into_iter().find(|&separator| line.contains(separator)) {
        Some(separator) => Words::Separated(line.split(separator)),
        None => Words::Spaced(line.split_whitespace()),
    }
}

#[derive(Clone)]
enum Words<'a> {
    Separated(std::str::Split<'a, char>),
    Spaced(std::str::SplitWhitespace<'a>),
}

impl<'a> Iterator for Words<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        match self {
            Words::Separated(words) => words.next().map(|word| word.trim().trim_matches('"')),
            Words::Spaced(words) => words.next().map(|word| word.trim_matches('"')),
        }
    }
}

/// Returns whether a line has names, and no word like a number: a line with both is a broken point.
fn is_header<'a>(mut words: impl Iterator<Item = &'a str>) -> bool {
    let mut some = false;
    let mut is_name = |word: &str| {
        some |= !word.is_empty();
        number(word).is_none() && !word.starts_with(|c: char| c.is_ascii_digit())
    };
    words.all(&mut is_name) && some
}
