//! The body of a PLY file, element by element.

use std::io::ErrorKind;

use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{
    ElementDef, Property, PropertyAccess, PropertyAccessResult, PropertyDef, PropertyType,
    ScalarType,
};

use crate::cloud::ColorDepth;
use crate::io::columns::{ColumnKind, Vertex, color, slot};
use crate::io::content_error::{ContentError, check_claim, quote_start};
use crate::io::lines::{Lines, number};

/// The data kept from an element.
pub(super) trait PlyRecord: PropertyAccess {
    /// Returns whether the scalar property `name` must be a number.
    fn needs(name: &str) -> bool;

    /// Stores a scalar if it is used, NaN for a value that is no number.
    fn set(&mut self, name: &str, value: f64);

    /// Returns whether the list property `name` is used.
    fn takes_list(_name: &str) -> bool {
        false
    }

    /// Stores a list that is used.
    fn set_list(&mut self, _values: Vec<f64>) {}
}

/// A face, or a cell of a range grid: vertices by their index.
#[derive(Debug, Default)]
pub(super) struct Face {
    /// `None` when the element has no list of corners.
    pub(super) corners: Option<Vec<f64>>,
}

/// Names of the list of corners.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The body after the header, read element by element.
pub(super) enum PlyBody<'a> {
    /// One element per line.
    Ascii(Lines<'a>),
    /// Element after element from byte `at`.
    Binary { content: &'a [u8], at: usize, big_endian: bool },
}

impl PlyBody<'_> {
    /// Returns the count of `element`, if the remaining bytes can hold it.
    pub(super) fn check_count(&self, element: &ElementDef) -> Result<usize, ContentError> {
        let smallest = |kind: fn(&PropertyType) -> u64| {
            element.properties.values().map(|property| kind(&property.data_type)).sum()
        };
        let what = format!("{} elements", element.name);
        let count = element.count as u64;
        match self {
            // One digit per word, and a space between words.
            PlyBody::Ascii(lines) => {
                check_claim(&what, count, smallest(|_| 2) - 1, lines.rest().len())
                    .map_err(|what| ContentError::line(lines.number() + 1, what))
            }
            PlyBody::Binary { content, at, .. } => {
                check_claim(&what, count, smallest(smallest_size), content.len() - at)
                    .map_err(|what| ContentError::byte(*at, what))
            }
        }
    }

    /// Returns the byte at which the next element begins; 0 for ascii.
    pub(super) fn start(&self) -> usize {
        match self {
            PlyBody::Ascii(_) => 0,
            PlyBody::Binary { at, .. } => *at,
        }
    }

    /// Creates an error in the last element read, which began at byte `start`.
    pub(super) fn fault(&self, start: usize, what: String) -> ContentError {
        match self {
            PlyBody::Ascii(lines) => ContentError::line(lines.number(), what),
            PlyBody::Binary { .. } => ContentError::byte(start, what),
        }
    }

    /// Reads the next element, after `index` earlier ones.
    pub(super) fn next<R: PlyRecord>(
        &mut self,
        element: &ElementDef,
        index: usize,
    ) -> Result<R, ContentError> {
        let ends = || format!("the file ends within {} {index} of {}", element.name, element.count);
        match self {
            PlyBody::Ascii(lines) => match lines.next() {
                Some(line) => {
                    let (number, line) = line?;
                    parse_line(line, element).map_err(|what| ContentError::line(number, what))
                }
                None => Err(ContentError::line(lines.number(), ends())),
            },
            PlyBody::Binary { content, at, big_endian } => {
                let start = *at;
                let mut rest = &content[start..];
                let parser = Parser::<R>::new();
                let row = if *big_endian {
                    parser.read_big_endian_element(&mut rest, element)
                } else {
                    parser.read_little_endian_element(&mut rest, element)
                };
                *at = content.len() - rest.len();
                row.map_err(|error| match error.kind() {
                    ErrorKind::UnexpectedEof => ContentError::byte(start, ends()),
                    _ => ContentError::byte(start, format!("{} {index}: {error}", element.name)),
                })
            }
        }
    }
}

/// Parses the element in `line`; words beyond its properties are ignored.
fn parse_line<R: PlyRecord>(line: &str, element: &ElementDef) -> Result<R, String> {
    let mut row = R::new();
    let mut words = line.split_ascii_whitespace();
    for (name, property) in &element.properties {
        let missing = || format!("the line ends before property {name}");
        let word = words.next().ok_or_else(missing)?;
        let refuse = |expected| format!("{name} is {}, not {expected}", quote_start(word));
        match property.data_type {
            PropertyType::Scalar(_) => match number(word) {
                None if R::needs(name) => return Err(refuse("a number")),
                value => row.set(name, value.unwrap_or(f64::NAN)),
            },
            PropertyType::List(..) => {
                let length: usize = word.parse().map_err(|_| refuse("the length of a list"))?;
                if R::takes_list(name) {
                    let value = |word: &str| {
                        number(word).ok_or_else(|| format!("{name} has {}", quote_start(word)))
                    };
                    // The declared length takes no memory: there are never more values than words.
                    let values = words.by_ref().take(length).map(value);
                    let values = values.collect::<Result<Vec<f64>, String>>()?;
                    if values.len() < length {
                        return Err(missing());
                    }
                    row.set_list(values);
                } else if length > 0 {
                    words.nth(length - 1).ok_or_else(missing)?;
                }
            }
        }
    }
    Ok(row)
}

pub(super) fn is_scalar(kind: &PropertyType) -> bool {
    matches!(kind, PropertyType::Scalar(_))
}

/// Returns the kind of a property, colours being whole numbers in one byte or two; `name` is the
/// channel's name.
pub(super) fn kind(name: &str, property: &PropertyDef) -> ColumnKind {
    match (color(name), &property.data_type) {
        (Some(_), PropertyType::Scalar(ScalarType::UChar)) => ColumnKind::Color(ColorDepth::Eight),
        (Some(_), PropertyType::Scalar(ScalarType::UShort)) => {
            ColumnKind::Color(ColorDepth::Sixteen)
        }
        _ => ColumnKind::Number,
    }
}

/// Returns whether f32 holds all values of a scalar in binary.
pub(super) fn is_single(kind: &PropertyType) -> bool {
    use ScalarType::{Char, Float, Short, UChar, UShort};
    matches!(kind, PropertyType::Scalar(Char | UChar | Short | UShort | Float))
}

/// Returns the least bytes of a property: a list may be empty.
fn smallest_size(kind: &PropertyType) -> u64 {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = kind;
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Converts `property` to a number; `None` for a list.
fn scalar(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(value) => value.into(),
        Property::UChar(value) => value.into(),
        Property::Short(value) => value.into(),
        Property::UShort(value) => value.into(),
        Property::Int(value) => value.into(),
        Property::UInt(value) => value.into(),
        Property::Float(value) => value.into(),
        Property::Double(value) => value,
        _ => return None,
    })
}

/// Converts `property` to numbers; `None` for a scalar.
fn list(property: Property) -> Option<Vec<f64>> {
    fn numbers<T: Into<f64>>(values: Vec<T>) -> Vec<f64> {
        values.into_iter().map(Into::into).collect()
    }
    Some(match property {
        Property::ListChar(values) => numbers(values),
        Property::ListUChar(values) => numbers(values),
        Property::ListShort(values) => numbers(values),
        Property::ListUShort(values) => numbers(values),
        Property::ListInt(values) => numbers(values),
        Property::ListUInt(values) => numbers(values),
        Property::ListFloat(values) => numbers(values),
        Property::ListDouble(values) => numbers(values),
        _ => return None,
    })
}

/// Skipped elements are also read as this type. A list is read whole and then dropped, one at a
/// time, and never more than the file holds.
impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match scalar(&property) {
            Some(value) => {
                self.set(name, value);
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::Ignored,
        }
    }
}

impl PlyRecord for Vertex {
    fn needs(name: &str) -> bool {
        slot(name).is_some()
    }

    fn set(&mut self, name: &str, value: f64) {
        Vertex::set(self, name, value);
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Face::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match list(property).filter(|_| Face::takes_list(name)) {
            Some(values) => {
                self.set_list(values);
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::Ignored,
        }
    }
}

impl PlyRecord for Face {
    fn needs(_name: &str) -> bool {
        false
    }

    fn set(&mut self, _name: &str, _value: f64) {}

    fn takes_list(name: &str) -> bool {
        CORNERS.iter().any(|corners| corners.eq_ignore_ascii_case(name))
    }

    fn set_list(&mut self, values: Vec<f64>) {
        self.corners = Some(values);
    }
}
