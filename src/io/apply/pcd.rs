//! PCD: its points and its viewpoint move, and the other fields stay.

use std::io::Write;
use std::ops::Range;

use pcd_rs::{DataKind, PcdMeta, ValueKind};

use super::numbers::{MovedBounds, RowSlots, move_slots, widens, word_ranges, write_words};
use super::quaternion::{from_rotation, multiply};
use super::{Moved, WriteFault};
use crate::cloud::Transform;
use crate::io::columns::slot;
use crate::io::content_error::{ContentError, check_claim};
use crate::io::lines::{Lines, number};
use crate::io::pcd::{PcdHeader, record_size, unpack};
use crate::io::scalar::Scalar;

/// Moves the points of a file; compressed points are written without compression.
pub(super) fn apply(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    let head = PcdHeader::parse(content)?;
    let meta = PcdMeta::from_reader(head.text.as_bytes()).map_err(|error| head.fault(error))?;
    let count = usize::try_from(meta.num_points)
        .map_err(|_| ContentError::new("has more points than memory has places"))?;
    let fields = Fields::new(&meta)?;
    let mut moved = Moved { points: meta.num_points, ..Moved::default() };
    if meta.data == DataKind::Ascii {
        out.write_all(header(&head, &meta, transform, false).as_bytes())?;
        move_lines(content, &head, &fields, count, transform, out)?;
        return Ok(moved);
    }
    let stride = record_size(&meta);
    let body = &content[head.bytes..];
    let unpacked;
    let rows = if meta.data == DataKind::BinaryCompressed && count > 0 {
        let by_field = unpack(body, &meta, content.len())
            .map_err(|what| ContentError::byte(head.bytes, what))?;
        moved.differences.change("the points are DATA binary, not compressed");
        unpacked = fields.interleave(&by_field, count, stride as usize);
        &unpacked[..]
    } else {
        check_claim("points", meta.num_points, stride, body.len())
            .map_err(|what| ContentError::byte(head.bytes, what))?;
        body
    };
    let stride = stride as usize;
    let mut slots = RowSlots { slots: fields.slots, big_endian: false, widens: false };
    let mut bounds = MovedBounds::new();
    for row in rows.chunks_exact(stride.max(1)).take(count) {
        if let [Some(x), Some(y), Some(z), ..] = move_slots(transform, slots.read(row)) {
            bounds.include([x, y, z]);
        }
    }
    slots.widens = widens(&slots.slots, &bounds);
    if slots.widens {
        moved.differences.change("x, y and z have 8 bytes, because 4 would lose digits");
    }
    out.write_all(header(&head, &meta, transform, slots.widens).as_bytes())?;
    let mut buffer = Vec::new();
    for row in rows.chunks_exact(stride.max(1)).take(count) {
        buffer.clear();
        slots.write(&mut buffer, row, transform);
        out.write_all(&buffer)?;
    }
    Ok(moved)
}

/// The places of the fields in a row.
struct Fields {
    /// Byte and type of each slot.
    slots: [Option<(usize, Scalar)>; 6],
    /// The first word of each slot in a row of text.
    words: [Option<usize>; 6],
    /// Bytes of each field in a row.
    sizes: Vec<usize>,
}

impl Fields {
    fn new(meta: &PcdMeta) -> Result<Fields, ContentError> {
        let mut fields = Fields { slots: [None; 6], words: [None; 6], sizes: Vec::new() };
        let (mut at, mut word) = (0, 0);
        for field in meta.field_defs.iter() {
            let count = field.count as usize;
            if let Some(slot) = slot(&field.name).filter(|_| count == 1) {
                fields.slots[slot] = Some((at, scalar(field.kind)));
                fields.words[slot] = Some(word);
            }
            let size = field.kind.byte_size().saturating_mul(count);
            fields.sizes.push(size);
            at = at.saturating_add(size);
            word = word.saturating_add(count);
        }
        if fields.slots[..3].contains(&None) {
            return Err(ContentError::new("FIELDS has no x, y and z"));
        }
        if fields.slots[3..].contains(&None) {
            fields.slots[3..].fill(None);
            fields.words[3..].fill(None);
        }
        Ok(fields)
    }

    /// Returns rows, one after another, of values that stand field by field.
    fn interleave(&self, by_field: &[u8], count: usize, stride: usize) -> Vec<u8> {
        let mut rows = vec![0; count * stride];
        let (mut first, mut start) = (0, 0);
        for &size in &self.sizes {
            let values = by_field[start..start + size * count].chunks_exact(size.max(1));
            for (row, value) in rows.chunks_exact_mut(stride.max(1)).zip(values) {
                row[first..first + size].copy_from_slice(value);
            }
            (first, start) = (first + size, start + size * count);
        }
        rows
    }
}

fn scalar(kind: ValueKind) -> Scalar {
    match kind {
        ValueKind::I8 => Scalar::I8,
        ValueKind::I16 => Scalar::I16,
        ValueKind::I32 => Scalar::I32,
        ValueKind::I64 => Scalar::I64,
        ValueKind::U8 => Scalar::U8,
        ValueKind::U16 => Scalar::U16,
        ValueKind::U32 => Scalar::U32,
        ValueKind::U64 => Scalar::U64,
        ValueKind::F32 => Scalar::F32,
        ValueKind::F64 => Scalar::F64,
    }
}

/// Returns the header with the moved viewpoint, and with coordinates of eight bytes if they are
/// widened. A viewpoint of 0 0 0 1 0 0 0 stays: writers have it where none is known.
fn header(head: &PcdHeader, meta: &PcdMeta, transform: &Transform, widens: bool) -> String {
    let is_place: Vec<bool> = (meta.field_defs.iter())
        .map(|field| field.count == 1 && slot(&field.name).is_some_and(|slot| slot < 3))
        .collect();
    let mut text = String::new();
    for line in head.text.split_inclusive('\n') {
        let ending = &line[line.trim_end().len()..];
        let mut words = line.split_ascii_whitespace();
        let keyword = words.next().unwrap_or_default();
        let replaced = |by: &str| -> Vec<String> {
            let values = words.clone().enumerate();
            let value = |(at, word): (usize, &str)| match is_place.get(at) {
                Some(true) => by.to_string(),
                _ => word.to_string(),
            };
            values.map(value).collect()
        };
        let line = match keyword.to_ascii_uppercase().as_str() {
            "SIZE" if widens => format!("SIZE {}{ending}", replaced("8").join(" ")),
            "TYPE" if widens => format!("TYPE {}{ending}", replaced("F").join(" ")),
            "VIEWPOINT" => format!("VIEWPOINT {}{ending}", viewpoint(meta, transform)),
            "DATA" if meta.data == DataKind::BinaryCompressed => format!("DATA binary{ending}"),
            _ => line.to_string(),
        };
        text += &line;
    }
    text
}

fn viewpoint(meta: &PcdMeta, transform: &Transform) -> String {
    let view = &meta.viewpoint;
    let (place, own) = ([view.tx, view.ty, view.tz], [view.qw, view.qx, view.qy, view.qz]);
    let is_unknown = place == [0.0; 3] && own[1..] == [0.0; 3];
    let (place, turned) = match is_unknown {
        true => (place, own),
        false => (transform.apply(place), multiply(from_rotation(&transform.rotation), own)),
    };
    let numbers = place.iter().chain(&turned).map(f64::to_string);
    numbers.collect::<Vec<String>>().join(" ")
}

fn move_lines(
    content: &[u8],
    head: &PcdHeader,
    fields: &Fields,
    count: usize,
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<(), WriteFault> {
    let start = content.as_ptr() as usize;
    let mut lines = Lines::new(content, head.bytes, head.last);
    let mut written = head.bytes;
    for index in 0..count {
        let Some(line) = lines.next() else {
            let what = format!("the file ends before point {index} of {count}");
            return Err(ContentError::line(lines.number(), what).into());
        };
        let (at, line) = line?;
        let first = line.as_ptr() as usize - start;
        out.write_all(&content[written..first])?;
        let ranges: Vec<Range<usize>> = word_ranges(line).collect();
        let slots = fields.words.map(|word| number(&line[ranges.get(word?)?.clone()]));
        if slots[..3].contains(&None) {
            let what = "x, y or z is missing, or no number";
            return Err(ContentError::line(at, what).into());
        }
        let moved = move_slots(transform, slots);
        let mut words: Vec<(Range<usize>, f64)> = (0..6)
            .filter_map(|slot| Some((ranges.get(fields.words[slot]?)?.clone(), moved[slot]?)))
            .collect();
        words.sort_by_key(|(range, _)| range.start);
        write_words(out, line, &words, false)?;
        written = first + line.len();
    }
    out.write_all(&content[written..])?;
    Ok(())
}
