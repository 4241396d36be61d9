//! Which columns of a file hold what.

use super::fault::{Fault, shown};
use super::lines::number;

/// The numbers of a row: x, y, z, the normal, then what else there is, in the order of its columns.
#[derive(Debug, Clone, Default)]
pub(super) struct Vertex(pub(super) [f64; 6], pub(super) Vec<f64>);

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
    pub(super) name: String,
    column: usize,
    kind: Kind,
}

impl Extra {
    /// The channels that the column is, by name: three of packed colours.
    pub(super) fn channels(self, numbers: &[f64]) -> Vec<(String, Vec<f32>)> {
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

    /// The columns beside positions and normals.
    pub fn extras(&self) -> &[Extra] {
        &self.1
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_found_by_name() {
        let columns = Columns::named(["i", "Z", "Y", "X", "normal_x", "NY", "nz"].into_iter());
        assert_eq!(columns.unwrap().0, [3, 2, 1, 4, 5, 6].map(Some));
        let half = Columns::named(["x", "y", "z", "nx"].into_iter()).unwrap();
        assert!(!half.has_normals());
        assert!(Columns::named(["x", "y", "X", "z"].into_iter()).unwrap_err().contains("x is"));
        assert!(Columns::named(["x", "y"].into_iter()).unwrap_err().contains("no z"));
    }
}
