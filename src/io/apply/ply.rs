//! PLY: the rows of its vertices move, and every other byte stays.

use std::io::Write;
use std::ops::Range;

use super::numbers::{MovedBounds, RowSlots, move_slots, widens, word_ranges, write_words};
use super::splat::{SplatColumns, SplatMotion};
use super::{Moved, WriteFault};
use crate::cloud::Transform;
use crate::io::columns::slot;
use crate::io::content_error::ContentError;
use crate::io::differences::Differences;
use crate::io::lines::{Lines, number};
use crate::io::ply::body::{PlyBody, Row, RowPlan};
use crate::io::ply::header::{Element, Encoding, PlyHeader, Property, PropertyKind};
use crate::io::ply::splat::is_splat;
use crate::io::ply::standard_header;
use crate::io::scalar::Scalar;

/// Moves the vertices of a file.
pub(super) fn apply(
    content: &[u8],
    transform: &Transform,
    out: &mut dyn Write,
) -> Result<Moved, WriteFault> {
    let header = standard_header::parse(content)?;
    let element = header.element("vertex");
    let element = element.ok_or_else(|| ContentError::new("the header has no element vertex"))?;
    let vertices = Vertices::new(element, transform)?;
    let mut body = PlyBody::new(content, &header);
    for earlier in header.elements.iter().take_while(|earlier| earlier.name != "vertex") {
        body.skip(earlier)?;
    }
    let count = body.check_count(element)?;
    let mut moved = Moved { points: count as u64, differences: Differences::default() };
    if header.element("camera").is_some() {
        moved.differences.note("the camera stays where it was");
    }
    match header.encoding {
        Encoding::Ascii => {
            let PlyBody::Ascii(lines) = body else { return Ok(moved) };
            vertices.write_ascii(content, lines, count, out)?;
        }
        Encoding::Binary { big_endian } => {
            vertices.write_binary(content, body, &header, big_endian, out, &mut moved)?;
        }
    }
    Ok(moved)
}

/// The vertices: which properties are coordinates, normals, and numbers of splats.
struct Vertices<'a> {
    element: &'a Element,
    transform: &'a Transform,
    /// The property of each slot.
    slots: [Option<usize>; 6],
    splats: Option<SplatMotion>,
}

impl<'a> Vertices<'a> {
    fn new(element: &'a Element, transform: &'a Transform) -> Result<Self, ContentError> {
        let mut slots = [None; 6];
        let is_scalar = |property: &Property| matches!(property.kind, PropertyKind::Scalar(_));
        for (place, property) in element.properties.iter().enumerate().rev() {
            if let Some(slot) = slot(&property.name).filter(|_| is_scalar(property)) {
                slots[slot] = Some(place);
            }
        }
        if slots[..3].contains(&None) {
            return Err(ContentError::new("element vertex has no x, y and z"));
        }
        if slots[3..].contains(&None) {
            slots[3..].fill(None);
        }
        let names: Vec<&str> =
            element.properties.iter().map(|property| property.name.as_str()).collect();
        let splats = match is_splat(names.iter().copied()) {
            true => {
                let columns = SplatColumns::find(&names).map_err(ContentError::new)?;
                Some(SplatMotion::new(columns, transform))
            }
            false => None,
        };
        Ok(Vertices { element, transform, slots, splats })
    }

    /// Returns the new numbers of a row, by property.
    fn moved(&self, values: &[f64]) -> Vec<(usize, f64)> {
        let slots = self.slots.map(|place| place.map(|place| values[place]));
        let moved = move_slots(self.transform, slots);
        let mut changed: Vec<(usize, f64)> = self
            .slots
            .iter()
            .zip(moved)
            .filter_map(|(&place, value)| Some((place?, value?)))
            .collect();
        if let Some(splats) = &self.splats {
            changed.extend(splats.apply(values));
        }
        changed.sort_by_key(|(place, _)| *place);
        changed
    }

    fn write_ascii(
        &self,
        content: &[u8],
        lines: Lines<'_>,
        count: usize,
        out: &mut dyn Write,
    ) -> Result<(), WriteFault> {
        let start = content.as_ptr() as usize;
        let (mut written, mut read) = (0, 0);
        for line in lines.take(count) {
            let (at, line) = line?;
            let first = line.as_ptr() as usize - start;
            out.write_all(&content[written..first])?;
            let ranges: Vec<Range<usize>> = word_ranges(line).collect();
            let fault = |what: String| ContentError::line(at, what);
            let places = self.words(line, &ranges).map_err(fault)?;
            let mut values = vec![f64::NAN; self.element.properties.len()];
            for (value, place) in values.iter_mut().zip(&places) {
                *value = place
                    .and_then(|place| number(&line[ranges[place].clone()]))
                    .unwrap_or(f64::NAN);
            }
            let words: Vec<(Range<usize>, f64)> = (self.moved(&values).into_iter())
                .filter_map(|(property, value)| Some((ranges[places[property]?].clone(), value)))
                .collect();
            write_words(out, line, &words, false)?;
            written = first + line.len();
            read += 1;
        }
        if read < count {
            let what = format!("the file ends within vertex {read} of {count}");
            return Err(ContentError::new(what).into());
        }
        out.write_all(&content[written..])?;
        Ok(())
    }

    /// Returns the word of each scalar property in a line.
    fn words(&self, line: &str, ranges: &[Range<usize>]) -> Result<Vec<Option<usize>>, String> {
        let (mut next, mut places) = (0, Vec::new());
        for property in &self.element.properties {
            let missing = || format!("the line ends before property {}", property.name);
            let range = ranges.get(next).ok_or_else(missing)?;
            match property.kind {
                PropertyKind::Scalar(_) => places.push(Some(next)),
                PropertyKind::List(..) => {
                    let length: usize = line[range.clone()].parse().map_err(|_| missing())?;
                    places.push(None);
                    next = next.saturating_add(length);
                }
            }
            next = next.saturating_add(1);
        }
        (next <= ranges.len()).then_some(places).ok_or_else(|| "the line is too short".into())
    }

    fn write_binary(
        &self,
        content: &[u8],
        mut body: PlyBody<'_>,
        header: &PlyHeader,
        big_endian: bool,
        out: &mut dyn Write,
        moved: &mut Moved,
    ) -> Result<(), WriteFault> {
        let start = body.start();
        let plan = RowPlan::new(self.element, |_| false, None);
        let (mut row, mut bounds) = (Row::default(), MovedBounds::new());
        for index in 0..moved.points as usize {
            body.next(&plan, index, &mut row)?;
            let place = self.slots.map(|place| place.map(|place| row.values[place]));
            if let [Some(x), Some(y), Some(z), ..] = move_slots(self.transform, place) {
                bounds.include([x, y, z]);
            }
        }
        let end = body.start();
        let kinds = self.slots.map(|place| match self.element.properties[place?].kind {
            PropertyKind::Scalar(scalar) => Some((0, scalar)),
            PropertyKind::List(..) => None,
        });
        let widens = widens(&kinds, &bounds);
        out.write_all(&self.header(content, header, widens))?;
        if widens {
            moved.differences.change("x, y and z are double, because float would lose digits");
        }
        out.write_all(&content[header.bytes..start])?;
        let mut rows = PlyBody::Binary { content, at: start, big_endian };
        let mut buffer = Vec::new();
        for index in 0..moved.points as usize {
            let first = rows.start();
            rows.next(&plan, index, &mut row)?;
            let bytes = &content[first..rows.start()];
            buffer.clear();
            self.write_row(bytes, &row.values, big_endian, widens, &mut buffer);
            out.write_all(&buffer)?;
        }
        out.write_all(&content[end..])?;
        Ok(())
    }

    /// Appends a moved row.
    fn write_row(
        &self,
        bytes: &[u8],
        values: &[f64],
        big_endian: bool,
        widens: bool,
        out: &mut Vec<u8>,
    ) {
        let (places, size) = self.places(bytes, big_endian);
        debug_assert_eq!(size, bytes.len());
        let mut slots = RowSlots { slots: [None; 6], big_endian, widens };
        for (slot, property) in self.slots.iter().enumerate() {
            slots.slots[slot] = property.and_then(|property| places[property]);
        }
        let Some(splats) = &self.splats else { return slots.write(out, bytes, self.transform) };
        let mut row = bytes.to_vec();
        for (property, value) in splats.apply(values) {
            if let Some((at, scalar)) = places[property] {
                scalar.write(&mut row[at..], big_endian, value);
            }
        }
        slots.write(out, &row, self.transform);
    }

    /// Returns byte and type of each scalar property in a row, and the size of the row.
    fn places(&self, bytes: &[u8], big_endian: bool) -> (Vec<Option<(usize, Scalar)>>, usize) {
        let (mut at, mut places) = (0, Vec::new());
        for property in &self.element.properties {
            match property.kind {
                PropertyKind::Scalar(scalar) => {
                    places.push(Some((at, scalar)));
                    at += scalar.size();
                }
                PropertyKind::List(length, kind) => {
                    places.push(None);
                    let count = length.read(bytes.get(at..).unwrap_or_default(), big_endian);
                    at += length.size() + count as usize * kind.size();
                }
            }
        }
        (places, at)
    }

    /// Returns the header, with coordinates of type double if they are widened.
    fn header(&self, content: &[u8], header: &PlyHeader, widens: bool) -> Vec<u8> {
        let bytes = &content[..header.bytes];
        if !widens {
            return bytes.to_vec();
        }
        let (mut widened, mut in_vertices) = (Vec::new(), false);
        let ending = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
        for line in bytes.split_inclusive(|&byte| byte == ending) {
            let text = String::from_utf8_lossy(line);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            if let ["element", name, _] = words[..] {
                in_vertices = name == "vertex";
            }
            match words[..] {
                ["property", _, name] if in_vertices && slot(name).is_some_and(|slot| slot < 3) => {
                    let ending = &text[text.trim_end().len()..];
                    widened.extend(format!("property double {name}{ending}").into_bytes());
                }
                _ => widened.extend_from_slice(line),
            }
        }
        widened
    }
}
