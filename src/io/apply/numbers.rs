//! Numbers of a row that are replaced: words of text, and numbers in binary.

use std::io::{self, Write};
use std::ops::Range;

use crate::cloud::Transform;
use crate::io::scalar::Scalar;
use crate::math::{self, Vec3};

/// Decimals that a moved number has beyond those of the number in the file. Chosen by hand: a
/// thousandth of the last digit.
const MORE_DECIMALS: usize = 3;
/// Least decimals of a moved number. Chosen by hand: micrometres of metres.
const MIN_DECIMALS: usize = 6;
/// Most of them: f64 has 17 digits.
const MAX_DECIMALS: usize = 17;

/// Moves the numbers at slots (x, y, z, then the normal): positions by the pose, normals by its
/// rotation. A row whose position is not finite stays.
pub(super) fn move_slots(transform: &Transform, slots: [Option<f64>; 6]) -> [Option<f64>; 6] {
    let mut moved = [None; 6];
    if let [Some(x), Some(y), Some(z), ..] = slots
        && [x, y, z].iter().all(|x| x.is_finite())
    {
        let place = transform.apply([x, y, z]);
        (0..3).for_each(|k| moved[k] = Some(place[k]));
    }
    if let [.., Some(x), Some(y), Some(z)] = slots {
        let normal = transform.rotate([x, y, z]);
        (3..6).for_each(|k| moved[k] = Some(normal[k - 3]));
    }
    moved
}

/// Writes `line` with other numbers in some of its words, which are in ascending order;
/// `has_commas` says that the file has decimal commas.
pub(super) fn write_words(
    out: &mut dyn Write,
    line: &str,
    words: &[(Range<usize>, f64)],
    has_commas: bool,
) -> io::Result<()> {
    let mut end = 0;
    for (word, value) in words {
        out.write_all(&line.as_bytes()[end..word.start])?;
        out.write_all(format_like(&line[word.clone()], *value, has_commas).as_bytes())?;
        end = word.end;
    }
    out.write_all(&line.as_bytes()[end..])
}

/// Formats a number as a word is written: with a few decimals more, and a decimal comma where the
/// file has such.
fn format_like(word: &str, value: f64, has_commas: bool) -> String {
    let spell = |text: String| if has_commas { text.replace('.', ",") } else { text };
    if word.contains(['e', 'E']) {
        return spell(format!("{value:e}"));
    }
    let decimals = word.split_once(['.', ',']).map_or(0, |(_, decimals)| decimals.trim().len());
    let decimals = (decimals + MORE_DECIMALS).clamp(MIN_DECIMALS, MAX_DECIMALS);
    // Adding zero turns -0 into 0.
    spell(format!("{:.decimals$}", value + 0.0))
}

/// Returns the byte ranges of the words between white space.
pub(super) fn word_ranges(line: &str) -> impl Iterator<Item = Range<usize>> + '_ {
    let start = line.as_ptr() as usize;
    line.split_ascii_whitespace().map(move |word| {
        let at = word.as_ptr() as usize - start;
        at..at + word.len()
    })
}

/// Box around moved points, and whether f32 holds their coordinates.
#[derive(Debug, Clone, Copy)]
pub(in crate::io) struct MovedBounds {
    low: Vec3,
    high: Vec3,
}

/// The largest coordinate, relative to the diagonal of the points, that f32 holds well: its error
/// of 6e-8 of the coordinate is then within 1e-6 of the diagonal. Chosen by hand.
const MAX_OFFSET: f64 = 16.0;

impl MovedBounds {
    /// Creates the box of no point.
    pub fn new() -> Self {
        MovedBounds { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] }
    }

    /// Includes a moved position.
    pub fn include(&mut self, place: Vec3) {
        if place.iter().all(|x| x.is_finite()) {
            self.low = [0, 1, 2].map(|k| self.low[k].min(place[k]));
            self.high = [0, 1, 2].map(|k| self.high[k].max(place[k]));
        }
    }

    /// Returns whether f32 loses what the points differ in.
    pub fn needs_double(&self) -> bool {
        let extent = math::sub(self.high, self.low);
        let far = self.low.iter().chain(&self.high).fold(0.0, |far: f64, x| far.max(x.abs()));
        far.is_finite() && far > MAX_OFFSET * math::norm(extent)
    }

    /// Returns the lowest corner.
    #[cfg(feature = "formats")]
    pub fn low(&self) -> Vec3 {
        self.low
    }

    /// Returns the highest corner.
    #[cfg(feature = "formats")]
    pub fn high(&self) -> Vec3 {
        self.high
    }
}

/// The numbers of a binary row: their types and where they stand.
#[derive(Debug, Clone)]
pub(super) struct RowSlots {
    /// Byte and type of each slot.
    pub slots: [Option<(usize, Scalar)>; 6],
    pub big_endian: bool,
    /// Whether coordinates are written as f64, whatever they were.
    pub widens: bool,
}

impl RowSlots {
    /// Returns the numbers of a row.
    pub fn read(&self, row: &[u8]) -> [Option<f64>; 6] {
        self.slots.map(|slot| {
            let (at, scalar) = slot?;
            Some(scalar.read(row.get(at..).unwrap_or_default(), self.big_endian))
        })
    }

    /// Appends the moved row to `out`.
    pub fn write(&self, out: &mut Vec<u8>, row: &[u8], transform: &Transform) {
        let moved = move_slots(transform, self.read(row));
        let mut order: Vec<usize> = (0..6).filter(|&slot| self.slots[slot].is_some()).collect();
        order.sort_by_key(|&slot| self.slots[slot].map(|own| own.0));
        let mut end = 0;
        for slot in order {
            let Some((at, scalar)) = self.slots[slot] else { continue };
            out.extend_from_slice(&row[end..at]);
            end = at + scalar.size();
            let kept = scalar.read(&row[at..], self.big_endian);
            let written = if self.widens && slot < 3 { Scalar::F64 } else { scalar };
            let start = out.len();
            if moved[slot].is_none() && written == scalar {
                out.extend_from_slice(&row[at..end]);
                continue;
            }
            out.resize(start + written.size(), 0);
            written.write(&mut out[start..], self.big_endian, moved[slot].unwrap_or(kept));
        }
        out.extend_from_slice(&row[end..]);
    }
}

/// Returns whether coordinates of these types are to be widened to f64 for points within `bounds`.
pub(super) fn widens(slots: &[Option<(usize, Scalar)>; 6], bounds: &MovedBounds) -> bool {
    slots[..3].iter().flatten().any(|(_, scalar)| match scalar {
        Scalar::F64 => false,
        Scalar::F32 => bounds.needs_double(),
        _ => true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_keep_their_style_and_their_neighbours() {
        let mut out = Vec::new();
        let line = " 1,5\t 7 2,25  3 # seen";
        let ranges: Vec<Range<usize>> = word_ranges(line).collect();
        let words = [(ranges[0].clone(), -1.0), (ranges[2].clone(), 1e6), (ranges[3].clone(), 0.5)];
        write_words(&mut out, line, &words, true).unwrap();
        assert_eq!(
            String::from_utf8(out).unwrap(),
            " -1,000000\t 7 1000000,000000  0,500000 # seen"
        );
        assert_eq!(format_like("1.23456789", 2.0, false), "2.00000000000");
        assert_eq!(format_like("1e3", 2500.0, false), "2.5e3");
    }

    #[test]
    fn rows_move_and_widen() {
        let slots = RowSlots {
            slots: [
                Some((1, Scalar::F32)),
                Some((5, Scalar::F32)),
                Some((9, Scalar::F32)),
                None,
                None,
                None,
            ],
            big_endian: false,
            widens: true,
        };
        let mut row = vec![9];
        [1f32, 2.0, 3.0].iter().for_each(|x| row.extend(x.to_le_bytes()));
        row.push(8);
        let far = Transform::rigid(crate::math::IDENTITY, [5e6, 0.0, 0.0]);
        let mut out = Vec::new();
        slots.write(&mut out, &row, &far);
        assert_eq!((out.len(), out[0], out[25]), (26, 9, 8));
        assert_eq!(Scalar::F64.read(&out[1..], false), 5_000_001.0);
        let mut bounds = MovedBounds::new();
        bounds.include([5e6, 0.0, 0.0]);
        bounds.include([5e6 + 100.0, 0.0, 0.0]);
        assert!(bounds.needs_double() && widens(&slots.slots, &bounds));
        bounds.include([0.0; 3]);
        assert!(!bounds.needs_double());
    }
}
