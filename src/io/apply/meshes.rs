//! OBJ, OFF and STL: vertices and normals move, and every other line stays.

use std::io::Write;
use std::ops::Range;

use super::numbers::{RowSlots, move_slots, word_ranges, write_words};
use super::{Moved, WriteFault};
use crate::cloud::Transform;
use crate::io::content_error::ContentError;
use crate::io::lines::{Lines, number};
use crate::io::scalar::Scalar;
use crate::io::stl;
use crate::io::text::decode_latin1;

/// Moves the words of a line that are a position (`first` is the first of three) or a direction.
enum Motion {
    Place(usize),
    Direction(usize),
    Both,
}

/// Moves `v` and `vn` of OBJ.
pub(super) fn apply_obj(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    move_lines(content, transform, out, |line, moved| match line.split_ascii_whitespace().next() {
        Some("v") => {
            moved.points += 1;
            Some(Motion::Place(1))
        }
        Some("vn") => Some(Motion::Direction(1)),
        _ => None,
    })
}

/// Moves the vertices of OFF, which are as many lines as its counts say.
pub(super) fn apply_off(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    // Refuses what is no OFF.
    let count = crate::io::off::parse(content)?.vertices.len() as u64;
    let (mut has_kind, mut has_counts, mut has_normals) = (false, false, false);
    move_lines(content, transform, out, |line, moved| {
        let bare = line.split('#').next().unwrap_or_default().trim();
        if bare.is_empty() {
            return None;
        }
        if !has_kind {
            has_kind = true;
            has_counts = bare.split_ascii_whitespace().count() > 1;
            has_normals =
                bare.split_ascii_whitespace().next().is_some_and(|word| word.contains('N'));
            return None;
        }
        if !has_counts {
            has_counts = true;
            return None;
        }
        if moved.points == count {
            return None;
        }
        moved.points += 1;
        Some(if has_normals { Motion::Both } else { Motion::Place(0) })
    })
}

/// Moves the triangles of STL.
pub(super) fn apply_stl(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    // Refuses what is no STL.
    let mesh = stl::parse(content)?;
    if !stl::is_binary(content) {
        return move_lines(content, transform, out, |line, moved| {
            let lower = line.to_ascii_lowercase();
            let mut words = lower.split_ascii_whitespace();
            match (words.next(), words.next()) {
                (Some("vertex"), _) => {
                    moved.points += 1;
                    Some(Motion::Place(1))
                }
                (Some("facet"), Some("normal")) => Some(Motion::Direction(2)),
                _ => None,
            }
        });
    }
    let mut moved = Moved { points: 3 * mesh.faces.len() as u64, ..Moved::default() };
    out.write_all(&content[..stl::HEADER])?;
    let float = |at: usize| Some((at, Scalar::F32));
    let slots = |place: usize, normal: [Option<(usize, Scalar)>; 3]| RowSlots {
        slots: [float(place), float(place + 4), float(place + 8), normal[0], normal[1], normal[2]],
        big_endian: false,
        widens: false,
    };
    let mut bounds = super::MovedBounds::new();
    let mut buffer = Vec::new();
    for triangle in
        content[stl::HEADER..].as_chunks::<{ stl::TRIANGLE }>().0.iter().take(mesh.faces.len())
    {
        let mut row = triangle.to_vec();
        for corner in [12, 24, 36] {
            let normal = if corner == 12 { [float(0), float(4), float(8)] } else { [None; 3] };
            let slots = slots(corner, normal);
            if let [Some(x), Some(y), Some(z), ..] = move_slots(transform, slots.read(&row)) {
                bounds.include([x, y, z]);
            }
            buffer.clear();
            slots.write(&mut buffer, &row, transform);
            row.copy_from_slice(&buffer);
        }
        out.write_all(&row)?;
    }
    if bounds.needs_double() {
        moved.differences.change("corners are rounded to f32, which binary STL has, far from zero");
    }
    Ok(moved)
}

/// Moves the words of the lines that `motion` names.
fn move_lines(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
    mut motion: impl FnMut(&str, &mut Moved) -> Option<Motion>,
) -> Result<Moved, WriteFault> {
    let text = decode_latin1(content);
    let start = text.as_ptr() as usize;
    let (mut moved, mut written) = (Moved::default(), 0);
    for line in Lines::new(&text, 0, 0) {
        let (at, line) = line?;
        let Some(motion) = motion(line, &mut moved) else { continue };
        let first = line.as_ptr() as usize - start;
        out.write_all(&text[written..first])?;
        let ranges: Vec<Range<usize>> = word_ranges(line).collect();
        let value = |word: usize| number(&line[ranges.get(word)?.clone()]);
        let three = |first: usize| [value(first), value(first + 1), value(first + 2)];
        let (words, places, normals) = match motion {
            Motion::Place(first) => (first, three(first), [None; 3]),
            Motion::Direction(first) => (first, [None; 3], three(first)),
            Motion::Both => (0, three(0), three(3)),
        };
        if places.contains(&None) && normals.contains(&None) {
            return Err(ContentError::line(at, "three numbers are expected").into());
        }
        let slots = [places[0], places[1], places[2], normals[0], normals[1], normals[2]];
        let found = move_slots(transform, slots);
        let new: Vec<(Range<usize>, f64)> = (found.into_iter().flatten().enumerate())
            .filter_map(|(k, value)| Some((ranges.get(words + k)?.clone(), value)))
            .collect();
        write_words(out, line, &new, false)?;
        written = first + line.len();
    }
    out.write_all(&text[written..])?;
    Ok(moved)
}
