//! Rows of numbers as text: .xyz, .txt, .csv, .asc, .pts, .xyzn.

use std::io::{self, Write};

use super::columns::Columns;
use super::fault::{Fault, shown};
use super::fields::{extra_names, extra_values, is_single};
use super::lines::{Lines, number};
use super::table::Table;
use crate::cloud::PointCloud;

/// What some editors put before UTF-8 text.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads one point a line; `default` says where, unless a line of names does.
///
/// Before the first point there may be one line of names and, in .pts, one with the
/// number of points. Names may stand in a comment (`//X Y Z`, `# x y z`): they count
/// when there is one for each column of the first point.
pub(super) fn parse(content: &[u8], default: Columns) -> Result<Table, Fault> {
    let start = if content.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    let mut preamble = Preamble::default();
    let mut table: Option<(Columns, Table)> = None;
    let mut words = Vec::new();
    for line in Lines::new(content, start, 0) {
        let (number, line) = line?;
        let (line, comment) = split_comment(line);
        if let (None, Some(comment)) = (&table, comment) {
            split(comment, &mut words);
            preamble.note(&words);
        }
        if line.is_empty() {
            continue;
        }
        split(line, &mut words);
        let (columns, table) = match &mut table {
            Some(table) => table,
            None if preamble.takes(&words, number)? => continue,
            None => {
                let columns = preamble.columns(Some(words.len()));
                let columns = columns.unwrap_or_else(|| default.clone());
                let empty = Table::new(0, &columns);
                table.insert((columns, empty))
            }
        };
        table.push(columns.parse(&words, number)?);
    }
    let table = table
        .map(|(_, table)| table)
        .unwrap_or_else(|| Table::new(0, &preamble.columns(None).unwrap_or(default)));
    match preamble.claimed {
        Some((line, count)) if count != table.len() as u64 => {
            let what = format!("the line claims {count} points, the file has {}", table.len());
            Err(Fault::line(line, what))
        }
        _ => Ok(table),
    }
}

/// What stands before the first point.
#[derive(Default)]
struct Preamble {
    /// From a line of names.
    named: Option<Columns>,
    /// From a comment that may be a line of names, and how many there are.
    noted: Option<(Columns, usize)>,
    /// The number of points that is claimed, and in which line.
    claimed: Option<(usize, u64)>,
}

impl Preamble {
    /// Looks at a comment.
    fn note(&mut self, words: &[&str]) {
        if let Ok(columns) = Columns::named(words.iter().copied()) {
            self.noted = Some((columns, words.len()));
        }
    }

    /// Takes a line, or says that it must be the first point.
    fn takes(&mut self, words: &[&str], number: usize) -> Result<bool, Fault> {
        if self.named.is_none() && is_header(words) {
            let named = Columns::named(words.iter().copied());
            self.named = Some(named.map_err(|what| Fault::line(number, what))?);
            return Ok(true);
        }
        if let (None, [word]) = (self.claimed, words) {
            let count = word.parse().map_err(|_| {
                let what = format!("{} is neither a point nor a number of points", shown(word));
                Fault::line(number, what)
            })?;
            self.claimed = Some((number, count));
            return Ok(true);
        }
        Ok(false)
    }

    /// The columns that names say, for points of `width` columns if there are any.
    fn columns(&mut self, width: Option<usize>) -> Option<Columns> {
        let noted = self.noted.take();
        let fits = noted.filter(|(_, names)| width.is_none_or(|width| width == *names));
        self.named.take().or(fits.map(|(columns, _)| columns))
    }
}

/// Writes a line of names after `comment`, then a point a line, each number with as
/// many digits as it takes to read it back.
pub(super) fn write(
    out: &mut dyn Write,
    cloud: &PointCloud,
    comment: &str,
    separator: &str,
) -> io::Result<()> {
    let single = is_single(cloud);
    let mut names = match cloud.normals() {
        Some(_) => vec!["x", "y", "z", "nx", "ny", "nz"],
        None => vec!["x", "y", "z"],
    };
    names.extend(extra_names(cloud));
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
        extra_values(cloud, i).try_for_each(|x| write!(out, "{separator}{x:?}"))?;
        writeln!(out)?;
    }
    Ok(())
}

/// What stands before a comment, and the comment. A mark within a word starts none:
/// `1.#QNAN` is how some libraries write a NaN.
fn split_comment(line: &str) -> (&str, Option<&str>) {
    let starts = |&(at, _): &(usize, &str)| at == 0 || line[..at].ends_with([' ', '\t', ',', ';']);
    let marks = ["#", "//"].into_iter().filter_map(|mark| line.match_indices(mark).find(starts));
    match marks.min() {
        Some((at, mark)) => (line[..at].trim_end(), Some(&line[at + mark.len()..])),
        None => (line, None),
    }
}

/// Splits at semicolons if there are any, else at commas, else at white space. With
/// decimal commas that leaves words like `1,5` or `5 2`, which are refused.
fn split<'a>(line: &'a str, words: &mut Vec<&'a str>) {
    words.clear();
    match [';', ','].into_iter().find(|&separator| line.contains(separator)) {
        Some(separator) => {
            words.extend(line.split(separator).map(|word| word.trim().trim_matches('"')))
        }
        None => words.extend(line.split_whitespace().map(|word| word.trim_matches('"'))),
    }
}

/// Whether a line has names, and nothing like a number: that makes it a broken point.
fn is_header(words: &[&str]) -> bool {
    let is_name =
        |word: &&str| number(word).is_none() && !word.starts_with(|c: char| c.is_ascii_digit());
    words.iter().all(is_name) && words.iter().any(|word| !word.is_empty())
}
