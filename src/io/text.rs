//! Rows of numbers as text: .xyz, .txt, .csv, .asc, .pts, .xyzn.

use std::borrow::Cow;
use std::io::{self, Write};

use super::cells::{NumberStyle, Separator, bare_words, is_header, split_comment};
use super::columns::{ColumnKind, ColumnMap, Vertex, color};
use super::content_error::{ContentError, MAX_HEADER_BYTES, quote_start};
use super::differences::Differences;
use super::layout::{FieldLayout, is_single};
use super::lines::Lines;
use super::table::PointTable;
use crate::cloud::PointCloud;

/// Byte order mark that some editors put before UTF-8 text.
pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The columns of rows without names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TextColumns {
    /// x y z.
    Positions,
    /// x y z, then the normal.
    Normals,
    /// Leica's PTS: x y z, then intensity, red green blue, or both; blocks of rows begin with
    /// their count.
    Pts,
}

impl TextColumns {
    /// Returns the columns of rows of `width` words.
    fn columns(self, width: usize) -> ColumnMap {
        let names: &[&str] = match (self, width) {
            (TextColumns::Pts, 4) => &["x", "y", "z", "intensity"],
            (TextColumns::Pts, 6) => &["x", "y", "z", "red", "green", "blue"],
            (TextColumns::Pts, 7) => &["x", "y", "z", "intensity", "red", "green", "blue"],
            _ => return ColumnMap::plain(self == TextColumns::Normals).without_names(width),
        };
        columns_from_names(names.iter().copied()).unwrap_or_default()
    }
}

/// Reads one point a line, with the columns of `default` unless a line of names gives others.
///
/// Before the first point there may be one line of names, `sep=` and, as in .pts, the number of
/// points. Names may be in a comment (`//X Y Z`, `# x y z`): they count if their number is the
/// number of columns of the first point. Bytes that are not UTF-8 are taken for Latin-1.
pub(super) fn parse(content: &[u8], default: TextColumns) -> Result<PointTable, ContentError> {
    let start = if content.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len() } else { 0 };
    let content = decode_latin1(content);
    let mut reader = TextReader::new(default);
    let mut lines = Lines::new(&content, start, 0);
    while let Some(line) = lines.next() {
        let (number, line) = line?;
        if reader.next_row(line, number, lines.rest())? {
            reader.push(number)?;
        }
    }
    reader.finish()
}

/// Writes a count of points, then x y z and the fields of [`FieldLayout::pts`] a line.
pub(super) fn write_pts(
    out: &mut dyn Write,
    cloud: &PointCloud,
    layout: &FieldLayout<'_>,
) -> io::Result<()> {
    let single = is_single(cloud);
    writeln!(out, "{}", cloud.len())?;
    for (i, ([a, b, c], [x, y, z])) in cloud.points().iter().zip(cloud.positions()).enumerate() {
        match single {
            true => write!(out, "{a:?} {b:?} {c:?}")?,
            false => write!(out, "{x:?} {y:?} {z:?}")?,
        }
        for field in &layout.fields {
            out.write_all(b" ")?;
            field.write_text(out, i)?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Returns `content` if it is UTF-8; else each byte is a letter of Latin-1. Content with zero bytes
/// is no text, and stays.
pub(super) fn decode_latin1(content: &[u8]) -> Cow<'_, [u8]> {
    if std::str::from_utf8(content).is_ok() || content.contains(&0) {
        return Cow::Borrowed(content);
    }
    let text: String = content.iter().map(|&byte| char::from(byte)).collect();
    Cow::Owned(text.into_bytes())
}

/// The rows read so far.
pub(super) struct TextReader {
    default: TextColumns,
    preamble: Preamble,
    /// Columns and separator, once the first row is known, and the rows that there may be.
    layout: Option<(ColumnMap, Separator)>,
    room: [usize; 2],
    table: Option<PointTable>,
    vertex: Vertex,
    style: NumberStyle,
    comments: usize,
}

impl TextReader {
    /// Creates a reader of rows that have these columns unless names say otherwise.
    pub fn new(default: TextColumns) -> Self {
        TextReader {
            default,
            preamble: Preamble::default(),
            layout: None,
            room: [0; 2],
            table: None,
            vertex: Vertex::default(),
            style: NumberStyle::default(),
            comments: 0,
        }
    }

    /// Takes a line up, after which come the bytes `rest`; returns whether it is a row.
    pub fn next_row(
        &mut self,
        line: &str,
        number: usize,
        rest: &[u8],
    ) -> Result<bool, ContentError> {
        let (line, comment) = split_comment(line);
        if let Some(comment) = comment {
            self.comments += 1;
            if self.layout.is_none() {
                self.preamble.read_comment(comment);
            }
        }
        if line.is_empty() {
            return Ok(false);
        }
        if self.layout.is_none() {
            if self.preamble.read_line(line, number)? {
                return Ok(false);
            }
            self.open(line, number, rest)?;
        }
        let Some((columns, separator)) = &self.layout else { return Ok(false) };
        if self.default == TextColumns::Pts
            && let Ok(count) = line.parse()
        {
            self.preamble.claim(number, count);
            return Ok(false);
        }
        self.style.check_row(line, *separator, self.preamble.has_names, number)?;
        let style = &self.style;
        let words = separator.words(line);
        columns
            .parse_with(&mut self.vertex, words, number, |word| style.number(word, *separator))?;
        self.style.check_decimals(number)?;
        Ok(true)
    }

    /// Returns whether any number so far had a decimal comma.
    pub fn has_decimal_commas(&self) -> bool {
        self.style.has_decimal_commas()
    }

    /// Returns the numbers of the last row.
    pub fn vertex(&self) -> &Vertex {
        &self.vertex
    }

    /// Returns the separator of the rows, and the column of each coordinate and part of a normal.
    pub fn layout(&self) -> Option<(Separator, [Option<usize>; 6])> {
        self.layout.as_ref().map(|(columns, separator)| (*separator, columns.slot_columns()))
    }

    /// Adds the last row to the table.
    fn push(&mut self, number: usize) -> Result<(), ContentError> {
        if let (None, Some((columns, _))) = (&self.table, &self.layout) {
            let [most, full] = self.room;
            self.table = Some(PointTable::new(most, columns).with_column_capacity(full));
        }
        match &mut self.table {
            Some(table) => {
                table.push(&self.vertex).map_err(|what| ContentError::line(number, what))
            }
            None => Ok(()),
        }
    }

    /// Finds columns and separator by a first row.
    fn open(&mut self, line: &str, number: usize, rest: &[u8]) -> Result<(), ContentError> {
        let separator = self.preamble.separator.unwrap_or_else(|| Separator::detect(line));
        let width = separator.words(line).count();
        let names = self.preamble.names;
        if names > 0 && separator == Separator::Comma && width == 2 * names {
            let what = format!(
                "the row has {width} cells and there are {names} names: commas may be decimal \
                 points and separators; write decimal points, or separate by semicolons"
            );
            return Err(ContentError::line(number, what));
        }
        let named = self.preamble.columns(Some(width));
        self.preamble.has_names = named.is_some();
        let columns = named.unwrap_or_else(|| self.default.columns(width));
        // Rows may lack columns that are not required; the columns are then left out.
        let needed = if columns.has_normals() { 6 } else { 3 };
        self.room = [needed, width].map(|words| max_rows(rest, words));
        self.layout = Some((columns, separator));
        Ok(())
    }

    fn finish(mut self) -> Result<PointTable, ContentError> {
        let table = self.table.unwrap_or_else(|| {
            let columns = self.preamble.columns(None);
            PointTable::new(0, &columns.unwrap_or_else(|| self.default.columns(3)))
        });
        let mut differences = Differences::default();
        differences.leave_out_all(self.comments - self.preamble.used_comments, "comment");
        if let Some((line, count)) = self.preamble.claimed
            && count != table.len() as u64
        {
            let rows = table.len();
            differences.note(format!("line {line} claims {count} points, and all {rows} are read"));
        }
        if self.style.has_decimal_commas() {
            differences.note("commas in numbers are read as decimal points");
        }
        Ok(table.with_differences(differences))
    }
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
    /// The number of these names.
    names: usize,
    /// Columns from a comment that may be a line of names, and the number of names.
    noted: Option<(ColumnMap, usize)>,
    /// Whether the columns of the table have names.
    has_names: bool,
    /// The first line with a declared number of points, and the sum of these numbers.
    claimed: Option<(usize, u64)>,
    /// Number of comments used as lines of names.
    used_comments: usize,
    /// The separator that a line `sep=` sets.
    separator: Option<Separator>,
}

impl Preamble {
    /// Reads a comment as a possible line of names.
    fn read_comment(&mut self, comment: &str) {
        if comment.len() > MAX_HEADER_BYTES {
            return;
        }
        let words = || bare_words(comment, None);
        if let Ok(columns) = columns_from_names(words()) {
            self.noted = Some((columns, words().count()));
        }
    }

    /// Reads a line of the preamble; returns `false` if the line must be the first point.
    fn read_line(&mut self, line: &str, number: usize) -> Result<bool, ContentError> {
        if let Some(separator) = Separator::from_declaration(line) {
            self.separator = Some(separator);
            return Ok(true);
        }
        let words = || bare_words(line, self.separator);
        if self.named.is_none() && is_header(words()) {
            if line.len() > MAX_HEADER_BYTES {
                let what = format!("the line of names takes more than {MAX_HEADER_BYTES} bytes");
                return Err(ContentError::line(number, what));
            }
            let columns = columns_from_names(words());
            self.names = words().count();
            self.named = Some(columns.map_err(|what| ContentError::line(number, what))?);
            return Ok(true);
        }
        let mut words = words();
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

    /// Adds the declared number of points of one more block.
    fn claim(&mut self, line: usize, count: u64) {
        let (first, sum) = self.claimed.unwrap_or((line, 0));
        self.claimed = Some((first, sum.saturating_add(count)));
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

/// Finds the columns of names.
fn columns_from_names<'a>(
    names: impl Iterator<Item = &'a str> + Clone,
) -> Result<ColumnMap, String> {
    // The first column of a pandas table is its index, without a name.
    let named = |word: &&str| !word.is_empty();
    let unnamed = names.clone().filter(|word| word.is_empty()).count();
    let columns = ColumnMap::from_names(names.map(|word| Some(word).filter(named)))?;
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
