//! Arrays of numpy and rows of f32: the numbers of positions and normals move.

use std::io::Write;
use std::path::Path;

use super::numbers::{MovedBounds, RowSlots, move_slots, widens};
use super::{Moved, WriteFault};
use crate::cloud::Transform;
use crate::io::bin;
use crate::io::columns::slot;
use crate::io::content_error::ContentError;
use crate::io::npy::{self, Array, ArrayField};
use crate::io::scalar::Scalar;

/// Moves the rows of an array: of plain numbers the first three columns, of records the fields x,
/// y, z and those of a normal.
pub(super) fn apply_npy(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    let array = Array::parse(content)?;
    let (rows, width) = array.rows()?;
    let mut moved = Moved { points: rows as u64, ..Moved::default() };
    if width == 0 {
        apply_records(content, &array, rows, transform, out, &mut moved)?;
        return Ok(moved);
    }
    let place = |row: usize| [0, 1, 2].map(|column| array.at(row, column, [rows, width]));
    let mut bounds = MovedBounds::new();
    (0..rows).for_each(|row| bounds.include(transform.apply(place(row))));
    let scalar = array.fields[0].scalar;
    let slots = [Some((0, scalar)); 6];
    let is_double = scalar == Scalar::F64 || scalar == Scalar::F16 || widens(&slots, &bounds);
    if is_double && scalar != Scalar::F64 {
        moved.differences.change("numbers are float64, because their type would lose digits");
    }
    let kind = if is_double { "<f8" } else { "<f4" };
    npy::write_header(out, &format!("'{kind}'"), &array.shape)?;
    for row in 0..rows {
        let own = place(row);
        let new = if own.iter().all(|x| x.is_finite()) { transform.apply(own) } else { own };
        for column in 0..width {
            let value = if column < 3 { new[column] } else { array.at(row, column, [rows, width]) };
            match is_double {
                true => out.write_all(&value.to_le_bytes())?,
                false => out.write_all(&(value as f32).to_le_bytes())?,
            }
        }
    }
    Ok(moved)
}

fn apply_records(
    content: &[u8],
    array: &Array<'_>,
    rows: usize,
    transform: &Transform,
    out: &mut dyn Write,
    moved: &mut Moved,
) -> Result<(), WriteFault> {
    let mut slots = record_slots(array)?;
    let stride = array.stride();
    let records = || array.data.chunks_exact(stride.max(1)).take(rows);
    let mut bounds = MovedBounds::new();
    for row in records() {
        if let [Some(x), Some(y), Some(z), ..] = move_slots(transform, slots.read(row)) {
            bounds.include([x, y, z]);
        }
    }
    slots.widens = widens(&slots.slots, &bounds);
    if !slots.widens {
        out.write_all(&content[..array.start])?;
        let mut buffer = Vec::new();
        for row in records() {
            buffer.clear();
            slots.write(&mut buffer, row, transform);
            out.write_all(&buffer)?;
        }
        return Ok(());
    }
    moved.differences.change("x, y and z are float64, because float32 would lose digits");
    npy::write_header(out, &widened_type(array, &slots), &array.shape)?;
    let mut buffer = Vec::new();
    for row in records() {
        buffer.clear();
        write_widened(row, array, &slots, transform, &mut buffer);
        out.write_all(&buffer)?;
    }
    Ok(())
}

/// Finds the coordinates and the normal among the fields of a record; a normal that is not whole is
/// not moved.
fn record_slots(array: &Array<'_>) -> Result<RowSlots, ContentError> {
    let mut slots = [None; 6];
    for field in &array.fields {
        let name = field.name.as_deref().unwrap_or_default();
        if field.count == 1
            && let Some(slot) = slot(name)
        {
            slots[slot] = Some((field.offset, field.scalar));
        } else if field.count == 3
            && let Some(three) = npy::triple(name)
        {
            for (part, name) in three.iter().enumerate() {
                if let Some(slot) = slot(name) {
                    let at = field.offset + part * field.scalar.size();
                    slots[slot] = Some((at, field.scalar));
                }
            }
        }
    }
    let is_float =
        |slot: &Option<(usize, Scalar)>| matches!(slot, Some((_, Scalar::F32 | Scalar::F64)));
    if !slots[..3].iter().all(is_float) {
        let what = "the fields x, y and z must be float32 or float64 to be moved";
        return Err(ContentError::byte(10, what));
    }
    if slots[3..].contains(&None) {
        slots[3..].fill(None);
    }
    Ok(RowSlots { slots, big_endian: array.fields[0].big_endian, widens: false })
}

/// Returns the slot of a number of a field.
fn slot_at(slots: &RowSlots, field: &ArrayField, part: usize) -> Option<usize> {
    let at = field.offset + part * field.scalar.size();
    slots.slots.iter().position(|slot| slot.is_some_and(|(own, _)| own == at))
}

/// Returns the type of the records with coordinates as f64 and without padding.
fn widened_type(array: &Array<'_>, slots: &RowSlots) -> String {
    let field = |field: &ArrayField| {
        let is_place = slot_at(slots, field, 0).is_some_and(|slot| slot < 3);
        let scalar = if is_place { Scalar::F64 } else { field.scalar };
        let order = if field.big_endian { '>' } else { '<' };
        let name = field.name.as_deref().unwrap_or_default();
        let count = field.count;
        let shape = if count == 1 { String::new() } else { format!(", ({count},)") };
        format!("('{name}', '{order}{}'{shape})", scalar.numpy_name())
    };
    format!("[{}]", array.fields.iter().map(field).collect::<Vec<String>>().join(", "))
}

/// Appends a moved record with coordinates as f64 and without padding.
fn write_widened(
    row: &[u8],
    array: &Array<'_>,
    slots: &RowSlots,
    transform: &Transform,
    out: &mut Vec<u8>,
) {
    let moved = move_slots(transform, slots.read(row));
    for field in &array.fields {
        for part in 0..field.count {
            let at = field.offset + part * field.scalar.size();
            let slot = slot_at(slots, field, part);
            let Some(slot) = slot else {
                out.extend_from_slice(&row[at..at + field.scalar.size()]);
                continue;
            };
            let kept = field.scalar.read(&row[at..], field.big_endian);
            let scalar = if slot < 3 { Scalar::F64 } else { field.scalar };
            let start = out.len();
            out.resize(start + scalar.size(), 0);
            scalar.write(&mut out[start..], field.big_endian, moved[slot].unwrap_or(kept));
        }
    }
}

/// Moves rows of f32.
pub(super) fn apply_bin(
    content: &[u8],
    name: &Path,
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    // Refuses what is no such file.
    bin::parse(content, name)?;
    let stride = 4 * bin::names(name).len();
    let float = |at: usize| Some((at, Scalar::F32));
    let slots = RowSlots {
        slots: [float(0), float(4), float(8), None, None, None],
        big_endian: false,
        widens: false,
    };
    let mut moved = Moved { points: (content.len() / stride) as u64, ..Moved::default() };
    let (mut bounds, mut buffer) = (MovedBounds::new(), Vec::new());
    for row in content.chunks_exact(stride) {
        if let [Some(x), Some(y), Some(z), ..] = move_slots(transform, slots.read(row)) {
            bounds.include([x, y, z]);
        }
        buffer.clear();
        slots.write(&mut buffer, row, transform);
        out.write_all(&buffer)?;
    }
    if bounds.needs_double() {
        moved.differences.change("coordinates are rounded to f32, which .bin has, far from zero");
    }
    Ok(moved)
}
