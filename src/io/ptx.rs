//! Leica's PTX: scans as grids of rows, each with the pose of its scanner.

use super::columns::{ColumnKind, ColumnMap, Vertex};
use super::content_error::{ContentError, check_claim, quote_start};
use super::differences::Differences;
use super::lines::{Lines, number};
use super::scans::{ScanChoice, ScanList};
use super::table::PointTable;
use crate::math::Vec3;

/// The header of a scan: ten lines before its rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct PtxHeader {
    /// Columns of the grid, then rows.
    pub size: [u64; 2],
    /// The pose of the scan: the matrix that is multiplied by a row (x y z 1) from the left.
    pub matrix: [[f64; 4]; 4],
}

impl PtxHeader {
    /// Returns the number of rows.
    pub fn count(&self) -> Option<u64> {
        self.size[0].checked_mul(self.size[1])
    }

    /// Returns the place of a row in the frame of the file.
    pub fn place(&self, [x, y, z]: Vec3) -> Vec3 {
        let m = &self.matrix;
        [0, 1, 2].map(|k| x * m[0][k] + y * m[1][k] + z * m[2][k] + m[3][k])
    }

    /// Reads a header after its first line, whose number is `start`.
    pub fn parse(
        first: &str,
        start: usize,
        lines: &mut Lines<'_>,
    ) -> Result<PtxHeader, ContentError> {
        let count = |line: &str, at: usize, what: &str| {
            line.parse().map_err(|_| {
                let found = quote_start(line);
                let what = format!("expected the number of {what} of a scan, found {found}");
                ContentError::line(at, what)
            })
        };
        let columns = count(first, start, "columns")?;
        let (at, line) = next(lines, "the number of rows")?;
        let rows = count(line, at, "rows")?;
        // The place and the axes of the scanner say what the matrix says, too.
        for _ in 0..4 {
            let (at, line) = next(lines, "the scanner's place and axes")?;
            numbers::<3>(line).map_err(|what| ContentError::line(at, what))?;
        }
        let mut matrix = [[0.0; 4]; 4];
        for row in &mut matrix {
            let (at, line) = next(lines, "the matrix of the scan")?;
            *row = numbers(line).map_err(|what| ContentError::line(at, what))?;
        }
        Ok(PtxHeader { size: [columns, rows], matrix })
    }
}

fn next<'a>(lines: &mut Lines<'a>, expected: &str) -> Result<(usize, &'a str), ContentError> {
    lines.next().unwrap_or_else(|| {
        let what = format!("the file ends where {expected} is expected: it was cut short");
        Err(ContentError::line(lines.number(), what))
    })
}

/// Parses a line of exactly that many finite numbers.
fn numbers<const N: usize>(line: &str) -> Result<[f64; N], String> {
    let expected =
        || format!("expected {N} numbers of a scan's header, found {}", quote_start(line));
    let mut words = line.split_ascii_whitespace();
    let mut found = [0.0; N];
    for value in &mut found {
        *value = words.next().and_then(number).filter(|x| x.is_finite()).ok_or_else(expected)?;
    }
    words.next().is_none().then_some(found).ok_or_else(expected)
}

const NAMES: [&str; 7] = ["x", "y", "z", "intensity", "red", "green", "blue"];

/// Reads the chosen scans, moved by their matrices. Rows of 0 0 0 mark measurements without a
/// return and are counted.
pub(super) fn parse(content: &[u8], choice: &ScanChoice) -> Result<PointTable, ContentError> {
    let mut lines = Lines::new(content, 0, 0);
    let mut scans = ScanList::new(choice);
    let mut table: Option<(ColumnMap, PointTable)> = None;
    let mut places = Vec::new();
    while let Some(line) = lines.next() {
        let (start, first) = line?;
        let header = PtxHeader::parse(first, start, &mut lines)?;
        let count = check_rows(&header, start, &lines)?;
        let is_chosen = scans.next(None);
        if is_chosen {
            places.push(header.place([0.0; 3]));
        }
        for index in 0..count {
            let Some(line) = lines.next() else {
                let what =
                    format!("the file ends before point {index} of {count}: it was cut short");
                return Err(ContentError::line(lines.number(), what));
            };
            let (at, line) = line?;
            if !is_chosen {
                continue;
            }
            let (columns, table) = table.get_or_insert_with(|| {
                let columns = columns(line.split_ascii_whitespace().count());
                let table = PointTable::new(count - index, &columns);
                (columns, table)
            });
            read_row(line, at, &header, columns, table)?;
        }
    }
    scans.check()?;
    let table = table.map(|(_, table)| table);
    let table = table.unwrap_or_else(|| PointTable::new(0, &columns(4)));
    let mut differences = Differences::default();
    differences.leave_out("the grid of the scan");
    scans.note_places(places.len(), &mut differences);
    let place = (places.len() == 1).then(|| places[0]);
    Ok(table.with_viewpoint(place).with_differences(differences))
}

/// Returns the rows of a scan, if the remaining bytes can hold them.
fn check_rows(header: &PtxHeader, start: usize, lines: &Lines<'_>) -> Result<usize, ContentError> {
    // Four words of one digit, and spaces between them.
    let claim =
        check_claim("points", header.count().unwrap_or(u64::MAX), 7, lines.rest().len() + 1);
    claim.map_err(|what| ContentError::line(start, what))
}

/// Returns the columns of rows of `width` words.
fn columns(width: usize) -> ColumnMap {
    let names = &NAMES[..width.clamp(3, NAMES.len())];
    let columns = ColumnMap::from_names(names.iter().copied().map(Some)).unwrap_or_default();
    columns.with_kinds(|name, _| match super::columns::color(name) {
        Some(color) => ColumnKind::Text(color),
        None => ColumnKind::Number,
    })
}

fn read_row(
    line: &str,
    at: usize,
    header: &PtxHeader,
    columns: &ColumnMap,
    table: &mut PointTable,
) -> Result<(), ContentError> {
    let mut vertex = Vertex::default();
    columns.parse(&mut vertex, line.split_ascii_whitespace(), at)?;
    if vertex.place == [0.0; 3] {
        table.skip_no_return();
        return Ok(());
    }
    vertex.place = header.place(vertex.place);
    table.push(&vertex).map_err(|what| ContentError::line(at, what))
}
