//! What the formats share: rows of numbers, and what can be wrong with them.

use std::io::{self, Write};
use std::path::Path;

use crate::cloud::{Attributes, Channels, PointCloud};
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

/// The numbers of a row: x, y, z, the normal, then what else there is, in the order of its columns.
#[derive(Debug, Clone, Default)]
pub(super) struct Vertex([f64; 6], Vec<f64>);

impl Vertex {
    /// Keeps the `value` of a column called `name`.
    pub fn set(&mut self, name: &str, value: f64) {
        match slot(name) {
            Some(slot) => self.0[slot] = value,
            None => self.1.push(value),
        }
    }
}

/// What the numbers of a column beside positions and normals are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// Shares of a number: 1 for numbers that stand for themselves, 255 for bytes of colour.
    Of(f64),
    /// The bits of a whole number: blue in the lowest byte, then green and red.
    Packed,
    /// The same in the bits of a float.
    PackedFloat,
}

/// A column beside positions and normals.
#[derive(Debug, Clone)]
pub(super) struct Extra {
    name: String,
    column: usize,
    kind: Kind,
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
#[derive(Debug, Clone)]
pub(super) struct Columns([Option<usize>; 6], Vec<Extra>);

impl Columns {
    /// x, y, z first.
    pub const XYZ: Columns = Columns([Some(0), Some(1), Some(2), None, None, None], Vec::new());
    /// x, y, z first, then the normal.
    pub const XYZ_NORMAL: Columns =
        Columns([Some(0), Some(1), Some(2), Some(3), Some(4), Some(5)], Vec::new());

    /// Finds the columns by their names; a normal counts when it is there in full.
    /// Other columns that have a name are kept too. The error says which name is missing, or
    /// there twice.
    pub fn named<'a>(names: impl Iterator<Item = &'a str>) -> Result<Columns, String> {
        let (mut columns, mut extras) = ([None; 6], Vec::new());
        for (column, name) in names.enumerate() {
            match slot(name) {
                Some(slot) if columns[slot].replace(column).is_some() => {
                    return Err(format!("{} is there twice", SLOTS[slot][0]));
                }
                Some(_) => {}
                None if name.is_empty() => {}
                None => extras.push(Extra { name: name.into(), column, kind: Kind::Of(1.0) }),
            }
        }
        if let Some(missing) = (0..3).find(|&slot| columns[slot].is_none()) {
            return Err(format!("there is no {}, expected x, y and z", SLOTS[missing][0]));
        }
        if columns.contains(&None) {
            columns[3..].fill(None);
        }
        Ok(Columns(columns, extras))
    }

    /// The same columns, the numbers of the others as `kind` says by name and column.
    pub fn of_kinds(mut self, kind: impl Fn(&str, usize) -> Kind) -> Columns {
        for extra in &mut self.1 {
            extra.kind = kind(&extra.name, extra.column);
        }
        self
    }

    /// The kind of a column beside positions and normals.
    pub fn kind(&self, column: usize) -> Option<Kind> {
        self.1.iter().find(|extra| extra.column == column).map(|extra| extra.kind)
    }

    /// Whether rows have a normal.
    pub fn has_normals(&self) -> bool {
        self.0[3].is_some()
    }

    /// The same columns, each moved to where `place` says.
    pub fn moved(&self, place: impl Fn(usize) -> Option<usize>) -> Columns {
        let moved = |extra: &Extra| {
            Some(Extra { column: place(extra.column)?, name: extra.name.clone(), kind: extra.kind })
        };
        let extras = self.1.iter().filter_map(moved).collect();
        Columns(self.0.map(|column| column.and_then(&place)), extras)
    }

    /// The vertex whose numbers `value` gives column by column; of positions and normals all
    /// must be there, of others a word that is no number is NaN.
    pub fn vertex(&self, value: impl Fn(usize) -> Option<f64>) -> Option<Vertex> {
        let mut vertex = Vertex::default();
        for (slot, column) in self.0.iter().enumerate() {
            if let Some(column) = *column {
                vertex.0[slot] = value(column)?;
            }
        }
        vertex.1.extend(self.1.iter().map(|extra| value(extra.column).unwrap_or(f64::NAN)));
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
    /// The other columns, and their numbers.
    extras: Vec<(Extra, Vec<f64>)>,
    viewpoint: Option<Vec3>,
}

impl Table {
    /// No row of these columns yet, room for `capacity`.
    pub fn new(capacity: usize, columns: &Columns) -> Self {
        let normals = columns.has_normals().then(|| Vec::with_capacity(capacity));
        let extra = |extra: &Extra| (extra.clone(), Vec::with_capacity(capacity));
        let extras = columns.1.iter().map(extra).collect();
        Table { points: Vec::with_capacity(capacity), normals, extras, viewpoint: None }
    }

    /// The table as seen from `viewpoint`.
    pub fn seen_from(self, viewpoint: Option<Vec3>) -> Self {
        Table { viewpoint, ..self }
    }

    /// Adds a row.
    pub fn push(&mut self, Vertex([x, y, z, nx, ny, nz], others): Vertex) {
        self.points.push([x, y, z]);
        if let Some(normals) = &mut self.normals {
            normals.push([nx, ny, nz]);
        }
        for ((_, numbers), value) in self.extras.iter_mut().zip(others) {
            numbers.push(value);
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

    /// The cloud of these rows: a column called weight has the weights of the points, others are
    /// channels. One that has no name for a channel, or a number that f32 does not hold at a
    /// point that does not drop out, is left out: nobody may have asked for it.
    pub fn into_cloud(mut self) -> Result<PointCloud> {
        let finite = |&i: &usize| self.points[i].iter().all(|x| x.is_finite());
        let kept: Vec<usize> = (0..self.points.len()).filter(finite).collect();
        let mut channels = Channels::default();
        let mut weights = None;
        for (extra, numbers) in std::mem::take(&mut self.extras) {
            if extra.name.eq_ignore_ascii_case("weight") {
                weights = weights.or(Some(numbers));
                continue;
            }
            for (name, values) in extra.channels(&numbers) {
                let holds = |&i: &usize| values[i].is_finite();
                let named = Channels::is_name(&name) && channels.get(&name).is_none();
                if named && kept.iter().all(holds) {
                    // At rows that drop out, anything that is a number.
                    let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
                    let values = values.into_iter().map(finite).collect();
                    channels = channels.with(&name, values)?;
                }
            }
        }
        let has = Attributes {
            normals: self.normals.as_deref(),
            weights: weights.as_deref(),
            channels: Some(&channels),
        };
        let cloud = PointCloud::with_attributes(&self.points, has)?;
        match self.viewpoint {
            Some(viewpoint) => cloud.with_viewpoint(viewpoint),
            None => Ok(cloud),
        }
    }
}

impl Extra {
    /// The channels that the column is, by name: three of packed colours.
    fn channels(self, numbers: &[f64]) -> Vec<(String, Vec<f32>)> {
        let byte = |shift: u32, bits: u32| (f64::from((bits >> shift) & 255) / 255.0) as f32;
        let bits = |&x: &f64| match self.kind {
            Kind::PackedFloat => (x as f32).to_bits(),
            _ => x as i64 as u32,
        };
        match self.kind {
            Kind::Of(whole) => {
                let share = |x: &f64| (x / whole) as f32;
                vec![(self.name, numbers.iter().map(share).collect())]
            }
            Kind::Packed | Kind::PackedFloat => [("red", 16), ("green", 8), ("blue", 0)]
                .map(|(name, shift)| {
                    let colour = |x: &f64| if x.is_nan() { f32::NAN } else { byte(shift, bits(x)) };
                    (name.to_string(), numbers.iter().map(colour).collect())
                })
                .into(),
        }
    }
}

/// Names of all columns beside positions and normals that a cloud is written with: `weight`,
/// then the channels.
pub(super) fn extra_names(cloud: &PointCloud) -> Vec<&str> {
    cloud.weights().map(|_| "weight").into_iter().chain(cloud.channels().names()).collect()
}

/// Their values at point `i`, in that order.
pub(super) fn extra_values(cloud: &PointCloud, i: usize) -> impl Iterator<Item = f32> + '_ {
    let weight = cloud.weights().map(|weights| weights[i]);
    weight.into_iter().chain(cloud.channels().iter().map(move |(_, values)| values[i]))
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
/// [`is_single`] says, then, as f32, the normal if the cloud has normals, and the others.
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
        extra_values(cloud, i).try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
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
