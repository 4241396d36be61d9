//! The body of a PLY file, row by row.

use super::header::{Element, Encoding, PlyHeader, PropertyKind};
use crate::io::content_error::{ContentError, check_claim, quote_start};
use crate::io::lines::{Lines, number};
use crate::io::scalar::Scalar;

/// The body after the header.
pub(in crate::io) enum PlyBody<'a> {
    /// One row a line.
    Ascii(Lines<'a>),
    /// Row after row from byte `at`.
    Binary { content: &'a [u8], at: usize, big_endian: bool },
}

/// The columns of an element that are used.
pub(in crate::io) struct RowPlan<'a> {
    element: &'a Element,
    /// Whether the scalar of each property must be a number.
    required: Vec<bool>,
    /// The property whose list is used.
    list: Option<usize>,
}

/// A row: a number for each property, NaN for lists, and the values of the list that is used.
#[derive(Default)]
pub(in crate::io) struct Row {
    pub values: Vec<f64>,
    pub list: Vec<f64>,
}

impl<'a> RowPlan<'a> {
    /// Uses the scalars of `element` and, of its lists, that of property `list`.
    pub fn new(
        element: &'a Element,
        required: impl Fn(usize) -> bool,
        list: Option<usize>,
    ) -> RowPlan<'a> {
        let required = (0..element.properties.len()).map(required).collect();
        RowPlan { element, required, list }
    }
}

impl<'a> PlyBody<'a> {
    /// Returns the body of a file.
    pub fn new(content: &'a [u8], header: &PlyHeader) -> PlyBody<'a> {
        match header.encoding {
            Encoding::Ascii => PlyBody::Ascii(Lines::new(content, header.bytes, header.lines)),
            Encoding::Binary { big_endian } => {
                PlyBody::Binary { content, at: header.bytes, big_endian }
            }
        }
    }

    /// Returns the count of `element`, if the remaining bytes can hold it.
    pub fn check_count(&self, element: &Element) -> Result<usize, ContentError> {
        let what = format!("{} elements", element.name);
        let (count, properties) = (element.count as u64, &element.properties);
        match self {
            // One digit per word, and a space between words.
            PlyBody::Ascii(lines) => {
                let smallest = (2 * properties.len() as u64).saturating_sub(1);
                check_claim(&what, count, smallest, lines.rest().len())
                    .map_err(|what| ContentError::line(lines.number() + 1, what))
            }
            PlyBody::Binary { content, at, .. } => {
                let sizes = properties.iter().map(|property| property.kind.smallest_size());
                check_claim(&what, count, sizes.sum::<usize>() as u64, content.len() - at)
                    .map_err(|what| ContentError::byte(*at, what))
            }
        }
    }

    /// Returns the byte at which the next row begins; 0 for ascii.
    pub fn start(&self) -> usize {
        match self {
            PlyBody::Ascii(_) => 0,
            PlyBody::Binary { at, .. } => *at,
        }
    }

    /// Creates an error in the last row read, which began at byte `start`.
    pub fn fault(&self, start: usize, what: String) -> ContentError {
        match self {
            PlyBody::Ascii(lines) => ContentError::line(lines.number(), what),
            PlyBody::Binary { .. } => ContentError::byte(start, what),
        }
    }

    /// Reads the next row, after `index` earlier ones.
    pub fn next(
        &mut self,
        plan: &RowPlan<'_>,
        index: usize,
        row: &mut Row,
    ) -> Result<(), ContentError> {
        let element = plan.element;
        let ends = || format!("the file ends within {} {index} of {}", element.name, element.count);
        row.values.clear();
        row.list.clear();
        match self {
            PlyBody::Ascii(lines) => match lines.next() {
                Some(line) => {
                    let (number, line) = line?;
                    read_line(line, plan, row).map_err(|what| ContentError::line(number, what))
                }
                None => Err(ContentError::line(lines.number(), ends())),
            },
            PlyBody::Binary { content, at, big_endian } => {
                let start = *at;
                let size = read_bytes(&content[start..], *big_endian, plan, row)
                    .map_err(|what| format!("{} {index}: {what}", element.name))
                    .and_then(|size| size.ok_or_else(ends))
                    .map_err(|what| ContentError::byte(start, what))?;
                *at += size;
                Ok(())
            }
        }
    }

    /// Skips the rows of an element.
    pub fn skip(&mut self, element: &Element) -> Result<(), ContentError> {
        // An element without properties takes no bytes, at any count.
        let count = if element.properties.is_empty() { 0 } else { self.check_count(element)? };
        if let (PlyBody::Binary { at, .. }, Some(stride)) = (&mut *self, element.stride()) {
            *at += count * stride;
            return Ok(());
        }
        let (plan, mut row) = (RowPlan::new(element, |_| false, None), Row::default());
        (0..count).try_for_each(|index| self.next(&plan, index, &mut row))
    }
}

/// Reads a row in binary and returns its size; `None` where the bytes end before it does.
fn read_bytes(
    bytes: &[u8],
    big_endian: bool,
    plan: &RowPlan<'_>,
    row: &mut Row,
) -> Result<Option<usize>, String> {
    let mut at = 0;
    for (place, property) in plan.element.properties.iter().enumerate() {
        let (PropertyKind::Scalar(first) | PropertyKind::List(first, _)) = property.kind;
        let Some(value) = take(bytes, &mut at, first, big_endian) else { return Ok(None) };
        let PropertyKind::List(_, kind) = property.kind else {
            row.values.push(value);
            continue;
        };
        row.values.push(f64::NAN);
        if value < 0.0 {
            return Err(format!("the list {} has the negative length {value}", property.name));
        }
        // The declared length takes no memory before its bytes are there.
        let Some(end) =
            (value as usize).checked_mul(kind.size()).and_then(|size| at.checked_add(size))
        else {
            return Ok(None);
        };
        let Some(values) = bytes.get(at..end) else { return Ok(None) };
        if plan.list == Some(place) {
            let values = values.chunks_exact(kind.size());
            row.list.extend(values.map(|value| kind.read(value, big_endian)));
        }
        at = end;
    }
    Ok(Some(at))
}

fn take(bytes: &[u8], at: &mut usize, kind: Scalar, big_endian: bool) -> Option<f64> {
    let rest = bytes.get(*at..*at + kind.size())?;
    *at += kind.size();
    Some(kind.read(rest, big_endian))
}

/// Reads the row in `line`; words beyond its properties are ignored.
fn read_line(line: &str, plan: &RowPlan<'_>, row: &mut Row) -> Result<(), String> {
    let mut words = line.split_ascii_whitespace();
    for (place, property) in plan.element.properties.iter().enumerate() {
        let name = &property.name;
        let missing = || format!("the line ends before property {name}");
        let word = words.next().ok_or_else(missing)?;
        let refuse = |expected| format!("{name} is {}, not {expected}", quote_start(word));
        if let PropertyKind::Scalar(_) = property.kind {
            match number(word) {
                None if plan.required[place] => return Err(refuse("a number")),
                value => row.values.push(value.unwrap_or(f64::NAN)),
            }
            continue;
        }
        row.values.push(f64::NAN);
        let length: usize = word.parse().map_err(|_| refuse("the length of a list"))?;
        if plan.list == Some(place) {
            // The declared length takes no memory: there are never more values than words.
            for word in words.by_ref().take(length) {
                let value = number(word);
                row.list.push(value.ok_or_else(|| format!("{name} has {}", quote_start(word)))?);
            }
            if row.list.len() < length {
                return Err(missing());
            }
        } else if length > 0 {
            words.nth(length - 1).ok_or_else(missing)?;
        }
    }
    Ok(())
}
