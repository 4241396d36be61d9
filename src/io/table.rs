//! What the formats share: rows of numbers, and what can be wrong with them.

use std::io::{self, Write};
use std::path::Path;

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::math::Vec3;

/// What is wrong with a file's content, and where; the path is added at the door.
#[derive(Debug)]
pub(super) struct Fault {
    line: Option<usize>,
    byte: Option<u64>,
    what: String,
}

impl Fault {
    /// A fault of the file as a whole.
    pub fn new(what: impl Into<String>) -> Self {
        Fault { line: None, byte: None, what: what.into() }
    }

    /// A fault in `line`, from 1.
    pub fn line(line: usize, what: impl Into<String>) -> Self {
        Fault { line: Some(line), ..Fault::new(what) }
    }

    /// A fault at `byte`, from 0.
    pub fn byte(byte: usize, what: impl Into<String>) -> Self {
        Fault { byte: Some(byte as u64), ..Fault::new(what) }
    }

    /// The fault as an error about the file `path`.
    pub fn within(self, path: &Path) -> Error {
        let Fault { line, byte, what } = self;
        Error::Parse { path: path.to_path_buf(), line, byte, what }
    }
}

/// The six numbers of a row that matter: x, y, z, then the normal.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Vertex([f64; 6]);

impl Vertex {
    /// Keeps `value` if a column called `name` matters.
    pub fn set(&mut self, name: &str, value: f64) {
        if let Some(slot) = slot(name) {
            self.0[slot] = value;
        }
    }
}

/// What the columns of each slot of a [`Vertex`] are called, in any case.
const SLOTS: [[&str; 2]; 6] = [
    ["x", "x"],
    ["y", "y"],
    ["z", "z"],
    ["nx", "normal_x"],
    ["ny", "normal_y"],
    ["nz", "normal_z"],
];

/// The slot of a [`Vertex`] that a column called `name` fills.
pub(super) fn slot(name: &str) -> Option<usize> {
    SLOTS.iter().position(|names| names.iter().any(|slot| slot.eq_ignore_ascii_case(name)))
}

/// Which columns hold the numbers of a [`Vertex`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns([Option<usize>; 6]);

impl Columns {
    /// x, y, z first.
    pub const XYZ: Columns = Columns([Some(0), Some(1), Some(2), None, None, None]);
    /// x, y, z first, then the normal.
    pub const XYZ_NORMAL: Columns = Columns([Some(0), Some(1), Some(2), Some(3), Some(4), Some(5)]);

    /// Finds the columns by their names; a normal counts when it is there in full.
    /// The error says which name is missing, or there twice.
    pub fn named<'a>(names: impl Iterator<Item = &'a str>) -> Result<Columns, String> {
        let mut columns = [None; 6];
        for (index, name) in names.enumerate() {
            if let Some(slot) = slot(name)
                && columns[slot].replace(index).is_some()
            {
                return Err(format!("{} is there twice", SLOTS[slot][0]));
            }
        }
        if let Some(missing) = (0..3).find(|&slot| columns[slot].is_none()) {
            return Err(format!("there is no {}, expected x, y and z", SLOTS[missing][0]));
        }
        if columns.contains(&None) {
            columns[3..].fill(None);
        }
        Ok(Columns(columns))
    }

    /// Whether rows have a normal.
    pub fn has_normals(&self) -> bool {
        self.0[3].is_some()
    }

    /// The same columns, each moved to where `place` says.
    pub fn moved(&self, place: impl Fn(usize) -> Option<usize>) -> Columns {
        Columns(self.0.map(|column| column.and_then(&place)))
    }

    /// The vertex whose numbers `value` gives column by column.
    pub fn vertex(&self, value: impl Fn(usize) -> Option<f64>) -> Option<Vertex> {
        let mut vertex = Vertex::default();
        for (slot, column) in self.0.iter().enumerate() {
            if let Some(column) = *column {
                vertex.0[slot] = value(column)?;
            }
        }
        Some(vertex)
    }

    /// The vertex written in the words of `line`.
    pub fn parse(&self, words: &[&str], line: usize) -> Result<Vertex, Fault> {
        self.vertex(|column| number(words.get(column)?)).ok_or_else(|| {
            let faulty = self.0.iter().zip(SLOTS).find_map(|(column, [name, _])| {
                let column = (*column)?;
                Some(match words.get(column) {
                    None => format!(
                        "the line has {} columns, {name} is expected in column {}",
                        words.len(),
                        column + 1
                    ),
                    Some(word) if number(word).is_none() => {
                        format!("{name} is {}, not a number", shown(word))
                    }
                    Some(_) => return None,
                })
            });
            Fault::line(line, faulty.unwrap_or_default())
        })
    }
}

/// What a file holds.
#[derive(Debug)]
pub(super) struct Table {
    points: Vec<Vec3>,
    normals: Option<Vec<Vec3>>,
    viewpoint: Option<Vec3>,
}

impl Table {
    /// No row yet, room for `capacity`.
    pub fn new(capacity: usize, has_normals: bool) -> Self {
        let normals = has_normals.then(|| Vec::with_capacity(capacity));
        Table { points: Vec::with_capacity(capacity), normals, viewpoint: None }
    }

    /// The table as seen from `viewpoint`.
    pub fn seen_from(self, viewpoint: Option<Vec3>) -> Self {
        Table { viewpoint, ..self }
    }

    /// Adds a row.
    pub fn push(&mut self, Vertex([x, y, z, nx, ny, nz]): Vertex) {
        self.points.push([x, y, z]);
        if let Some(normals) = &mut self.normals {
            normals.push([nx, ny, nz]);
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The positions alone.
    pub fn into_points(self) -> Vec<Vec3> {
        self.points
    }

    /// The cloud of these rows.
    pub fn into_cloud(self) -> Result<PointCloud> {
        let cloud = match &self.normals {
            Some(normals) => PointCloud::with_normals(&self.points, normals)?,
            None => PointCloud::new(&self.points)?,
        };
        match self.viewpoint {
            Some(viewpoint) => cloud.with_viewpoint(viewpoint),
            None => Ok(cloud),
        }
    }
}

/// The lines that are not blank, trimmed, with their number from 1.
///
/// Lines end at `\n`, `\r\n` or `\r`: were `\r` not an ending, a file with such
/// lines would read as one long first line.
#[derive(Debug)]
pub(super) struct Lines<'a> {
    content: &'a [u8],
    at: usize,
    number: usize,
}

impl<'a> Lines<'a> {
    /// The lines of `content` from byte `at` on, `before` lines into the file.
    pub fn new(content: &'a [u8], at: usize, before: usize) -> Self {
        Lines { content, at, number: before }
    }

    /// The bytes not read yet.
    pub fn rest(&self) -> &'a [u8] {
        self.content.get(self.at..).unwrap_or_default()
    }

    /// The number of the line read last.
    pub fn number(&self) -> usize {
        self.number
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Result<(usize, &'a str), Fault>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            let rest = self.rest();
            if rest.is_empty() {
                return None;
            }
            let start = self.at;
            let end = rest.iter().position(|&byte| byte == b'\n' || byte == b'\r');
            let (line, after) = rest.split_at(end.unwrap_or(rest.len()));
            let ending = if after.starts_with(b"\r\n") { 2 } else { after.len().min(1) };
            self.at += line.len() + ending;
            self.number += 1;
            match std::str::from_utf8(line) {
                Ok(line) if line.trim().is_empty() => continue,
                Ok(line) => return Some(Ok((self.number, line.trim()))),
                Err(error) => {
                    let byte = start + error.valid_up_to();
                    return Some(Err(Fault::byte(byte, "is not UTF-8 text")));
                }
            }
        }
    }
}

/// The number that `word` spells: anything Rust reads, `nan` and `inf` among
/// them, and the NaNs of other C libraries, `-nan(ind)` and `1.#QNAN`.
pub(super) fn number(word: &str) -> Option<f64> {
    word.parse().ok().or_else(|| {
        let bare = word.trim_start_matches(['+', '-']);
        let nan = bare.starts_with("1.#")
            || bare.get(..4).is_some_and(|start| start.eq_ignore_ascii_case("nan("));
        nan.then_some(f64::NAN)
    })
}

/// The start of `text`, quoted and escaped for a message.
pub(super) fn shown(text: &str) -> String {
    const LONGEST: usize = 40;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{:?}...", &text[..end]),
        None => format!("{text:?}"),
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

/// Whether the coordinates of `cloud` are f32, and lose nothing when written so.
pub(super) fn is_single(cloud: &PointCloud) -> bool {
    cloud.origin() == [0.0; 3]
}

/// Writes the rows in binary, little endian: x, y, z as f32 or f64 as
/// [`is_single`] says, then the normal as f32 if the cloud has normals.
pub(super) fn write_binary(out: &mut dyn Write, cloud: &PointCloud) -> io::Result<()> {
    let single = is_single(cloud);
    for (i, (point, position)) in cloud.points().iter().zip(cloud.positions()).enumerate() {
        if single {
            write_floats(out, point)?;
        } else {
            position.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
        }
        if let Some(normals) = cloud.normals() {
            write_floats(out, &normals[i])?;
        }
    }
    Ok(())
}

fn write_floats(out: &mut dyn Write, values: &[f32; 3]) -> io::Result<()> {
    values.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_end_in_every_way_and_keep_their_numbers() {
        let lines: Vec<_> =
            Lines::new(b"a\r\n\r\nb\rc\n\n d ", 0, 10).map(Result::unwrap).collect();
        assert_eq!(lines, [(11, "a"), (13, "b"), (14, "c"), (16, "d")]);
    }

    #[test]
    fn columns_are_found_by_name() {
        let columns = Columns::named(["i", "Z", "Y", "X", "normal_x", "NY", "nz"].into_iter());
        assert_eq!(columns.unwrap().0, [3, 2, 1, 4, 5, 6].map(Some));
        let half = Columns::named(["x", "y", "z", "nx"].into_iter()).unwrap();
        assert!(!half.has_normals());
        assert!(Columns::named(["x", "y", "X", "z"].into_iter()).unwrap_err().contains("x is"));
        assert!(Columns::named(["x", "y"].into_iter()).unwrap_err().contains("no z"));
    }

    #[test]
    fn numbers_of_all_libraries_are_read() {
        assert_eq!(number(".5").or(number("x")), Some(0.5));
        for word in ["nan", "-NaN", "-nan(ind)", "1.#QNAN", "-1.#IND"] {
            assert!(number(word).unwrap().is_nan(), "{word}");
        }
        assert_eq!(number("-inf"), Some(f64::NEG_INFINITY));
        assert_eq!(number("1,5").or(number("0x10")).or(number("")), None);
    }

    #[test]
    fn claims_are_weighed_without_overflow() {
        assert_eq!(check_claim("points", 3, 12, 36), Ok(3));
        assert!(check_claim("points", 4, 12, 47).unwrap_err().contains("enough for 3"));
        assert!(check_claim("points", u64::MAX, u64::MAX, 1).is_err());
    }
}
