//! Stanford PLY.
//!
//! ply-rs-bw reads the header and the binary elements. Three things are done here,
//! because there it does otherwise: a repeated name silently replaces the earlier
//! one, which shifts every later binary value; ascii numbers are only those of the
//! form `1`, `1.5`, `1e5`, so that `nan`, `.5` and `1.` are refused; and a float
//! property in ascii is rounded to f32 first, although the digits are there.

use std::collections::HashSet;
use std::io::{self, ErrorKind, Write};

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
    ScalarType,
};

use super::table::{
    Columns, Fault, Lines, Table, Vertex, check_claim, is_single, number, shown, slot, write_binary,
};
use crate::cloud::PointCloud;

/// The longest header that is read, bytes.
const LONGEST_HEADER: usize = 1 << 20;

/// Reads the vertices; elements before them are skipped, those after not looked at.
pub(super) fn parse(content: &[u8]) -> Result<Table, Fault> {
    let (header, mut body) = parse_header(content)?;
    let vertex = header.elements.get("vertex");
    let vertex = vertex.ok_or_else(|| Fault::new("the header has no element vertex"))?;
    let scalars = vertex.properties.values().filter(|property| is_scalar(&property.data_type));
    let columns = Columns::named(scalars.map(|property| property.name.as_str()))
        .map_err(|what| Fault::new(format!("in the properties of element vertex, {what}")))?;

    for element in header.elements.values().take_while(|element| element.name != "vertex") {
        // An element without properties takes no room, however many there are.
        let count = if element.properties.is_empty() { 0 } else { body.check_count(element)? };
        for index in 0..count {
            body.next(element, index)?;
        }
    }
    let count = body.check_count(vertex)?;
    let mut table = Table::new(count, columns.has_normals());
    for index in 0..count {
        table.push(body.next(vertex, index)?);
    }
    Ok(table)
}

/// Writes a binary little endian file.
pub(super) fn write(out: &mut dyn Write, cloud: &PointCloud) -> io::Result<()> {
    let coordinate = if is_single(cloud) { "float" } else { "double" };
    writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}", cloud.len())?;
    for name in ["x", "y", "z"] {
        writeln!(out, "property {coordinate} {name}")?;
    }
    if cloud.normals().is_some() {
        writeln!(out, "property float nx\nproperty float ny\nproperty float nz")?;
    }
    writeln!(out, "end_header")?;
    write_binary(out, cloud)
}

/// The header, and the body that it announces.
fn parse_header(content: &[u8]) -> Result<(Header, Body<'_>), Fault> {
    let (bytes, lines) = header_size(content)?;
    // Comments come in any encoding; everything that counts is ascii.
    let text = String::from_utf8_lossy(&content[..bytes]);
    let header = Parser::<Vertex>::new()
        .read_header(&mut Reader::new(text.as_bytes()))
        .map_err(|error| not_understood(&error, &text))?;
    let body = match header.encoding {
        Encoding::Ascii => Body::Ascii(Lines::new(content, bytes, lines)),
        encoding => {
            Body::Binary { content, at: bytes, big_endian: encoding == Encoding::BinaryBigEndian }
        }
    };
    Ok((header, body))
}

/// Bytes and lines of the header, in which no name may be there twice.
fn header_size(content: &[u8]) -> Result<(usize, usize), Fault> {
    let mut bytes = 0;
    let mut elements = HashSet::new();
    let mut properties = HashSet::new();
    let start = &content[..content.len().min(LONGEST_HEADER)];
    for (index, line) in start.split_inclusive(|&byte| byte == b'\n').enumerate() {
        bytes += line.len();
        let line = String::from_utf8_lossy(line);
        if index == 0 && line.trim_end() != "ply" {
            return Err(Fault::line(1, format!("expected ply, found {}", shown(line.trim_end()))));
        }
        let mut words = line.split_whitespace();
        let is_new = match (words.next(), words.next(), words.last()) {
            (Some("end_header"), ..) => return Ok((bytes, index + 1)),
            (Some("element"), Some(name), _) => {
                properties.clear();
                elements.insert(name.to_owned())
            }
            (Some("property"), _, Some(name)) => properties.insert(name.to_owned()),
            _ => true,
        };
        if !is_new {
            let what = format!("header line {} repeats a name", shown(line.trim()));
            return Err(Fault::line(index + 1, what));
        }
    }
    Err(Fault::new(format!("there is no end_header in the first {} bytes", start.len())))
}

/// What the header parser refused, as a line and what was expected there.
fn not_understood(error: &ParseError, header: &str) -> Fault {
    let numbered =
        error.line().and_then(|number| Some((number, header.lines().nth(number.checked_sub(1)?)?)));
    let Some((number, line)) = numbered else {
        return Fault::new(format!("the header is not understood: {error}"));
    };
    let expected = match line.split_whitespace().next() {
        Some("format") => "once: format ascii|binary_little_endian|binary_big_endian 1.0",
        Some("element") => "element NAME COUNT with a count of 0 or more",
        Some("property") => {
            "after an element: property TYPE NAME or property list TYPE TYPE NAME, TYPE being \
             char, uchar, short, ushort, int, uint, float, double or int8 ... float64"
        }
        _ => "format, comment, obj_info, element, property or end_header",
    };
    Fault::line(
        number,
        format!("header line {} is not understood, expected {expected}", shown(line)),
    )
}

/// What follows the header, read element by element.
enum Body<'a> {
    /// One element a line.
    Ascii(Lines<'a>),
    /// Element after element from byte `at`.
    Binary { content: &'a [u8], at: usize, big_endian: bool },
}

impl Body<'_> {
    /// The count of `element`, if the bytes left can hold it.
    fn check_count(&self, element: &ElementDef) -> Result<usize, Fault> {
        let smallest = |kind: fn(&PropertyType) -> u64| {
            element.properties.values().map(|property| kind(&property.data_type)).sum()
        };
        let what = format!("{} elements", element.name);
        let count = element.count as u64;
        match self {
            // A digit each, and a space between.
            Body::Ascii(lines) => {
                check_claim(&what, count, smallest(|_| 2) - 1, lines.rest().len())
                    .map_err(|what| Fault::line(lines.number() + 1, what))
            }
            Body::Binary { content, at, .. } => {
                check_claim(&what, count, smallest(smallest_size), content.len() - at)
                    .map_err(|what| Fault::byte(*at, what))
            }
        }
    }

    /// The next element, of which `index` were read before.
    fn next(&mut self, element: &ElementDef, index: usize) -> Result<Vertex, Fault> {
        let ends = || format!("the file ends within {} {index} of {}", element.name, element.count);
        match self {
            Body::Ascii(lines) => match lines.next() {
                Some(line) => {
                    let (number, line) = line?;
                    parse_line(line, element).map_err(|what| Fault::line(number, what))
                }
                None => Err(Fault::line(lines.number(), ends())),
            },
            Body::Binary { content, at, big_endian } => {
                let start = *at;
                let mut rest = &content[start..];
                let parser = Parser::<Vertex>::new();
                let vertex = if *big_endian {
                    parser.read_big_endian_element(&mut rest, element)
                } else {
                    parser.read_little_endian_element(&mut rest, element)
                };
                *at = content.len() - rest.len();
                vertex.map_err(|error| match error.kind() {
                    ErrorKind::UnexpectedEof => Fault::byte(start, ends()),
                    _ => Fault::byte(start, format!("{} {index}: {error}", element.name)),
                })
            }
        }
    }
}

/// The element written in `line`; words beyond its properties are ignored.
fn parse_line(line: &str, element: &ElementDef) -> Result<Vertex, String> {
    let mut vertex = Vertex::default();
    let mut words = line.split_ascii_whitespace();
    for (name, property) in &element.properties {
        let missing = || format!("the line ends before property {name}");
        let word = words.next().ok_or_else(missing)?;
        let refuse = |expected| format!("{name} is {}, not {expected}", shown(word));
        match property.data_type {
            PropertyType::Scalar(_) if slot(name).is_none() => {}
            PropertyType::Scalar(_) => {
                vertex.set(name, number(word).ok_or_else(|| refuse("a number"))?);
            }
            PropertyType::List(..) => {
                let length: usize = word.parse().map_err(|_| refuse("the length of a list"))?;
                if length > 0 {
                    words.nth(length - 1).ok_or_else(missing)?;
                }
            }
        }
    }
    Ok(vertex)
}

fn is_scalar(kind: &PropertyType) -> bool {
    matches!(kind, PropertyType::Scalar(_))
}

/// Bytes that a property takes at least: a list may be empty.
fn smallest_size(kind: &PropertyType) -> u64 {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = kind;
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Elements that are skipped go through here too. A list is read whole before it is
/// let go, one at a time, and never more of it than the file holds.
impl PropertyAccess for Vertex {
    fn new() -> Self {
        Vertex::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let value = match property {
            Property::Char(value) => value.into(),
            Property::UChar(value) => value.into(),
            Property::Short(value) => value.into(),
            Property::UShort(value) => value.into(),
            Property::Int(value) => value.into(),
            Property::UInt(value) => value.into(),
            Property::Float(value) => value.into(),
            Property::Double(value) => value,
            _ => return PropertyAccessResult::Ignored,
        };
        self.set(name, value);
        PropertyAccessResult::Set
    }
}
