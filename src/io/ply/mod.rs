//! Stanford PLY.
//!
//! ply-rs-bw reads the header and the binary elements. Three things are done here,
//! because there it does otherwise: a repeated name silently replaces the earlier
//! one, which shifts every later binary value; ascii numbers are only those of the
//! form `1`, `1.5`, `1e5`, so that `nan`, `.5` and `1.` are refused; and a float
//! property in ascii is rounded to f32 first, although the digits are there.

mod elements;
mod surface;

use std::collections::HashSet;
use std::io::{self, Write};

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, PropertyDef, PropertyType};

use self::elements::Body;
use super::columns::{Columns, Vertex};
use super::differences::{Differences, short};
use super::fault::{Fault, LONGEST_HEADER, beginning, shown};
use super::layout::{Layout, Stored, is_single, write_binary};
use super::lines::Lines;
use super::table::Table;
use crate::cloud::{ColorDepth, PointCloud};

/// Reads the vertices; elements before them are skipped, those after not looked at.
pub(super) fn parse(content: &[u8]) -> Result<Table, Fault> {
    let (header, mut body) = parse_header(content)?;
    let vertices = Vertices::of(&header)?;
    for element in header.elements.values().take_while(|element| element.name != "vertex") {
        skip(&mut body, element)?;
    }
    Ok(vertices.read(&mut body, false)?.without(differences(&header, &vertices)))
}

/// The parts of the file that a cloud does not have, whatever its points are.
fn differences(header: &Header, vertices: &Vertices<'_>) -> Differences {
    let mut differences = Differences::default();
    for element in header.elements.values().filter(|element| element.name != "vertex") {
        differences.leave_out_all(element.count, &short(&element.name));
    }
    for property in vertices.element.properties.values() {
        if let PropertyType::List(..) = property.data_type {
            differences.leave_out(format!("the list {}", short(&property.name)));
        }
    }
    differences.leave_out_all(header.comments.len() + header.obj_infos.len(), "comment");
    differences
}

/// Reads the vertices, and the corners of the triangles that the faces or the range grid
/// are made of.
pub(super) fn parse_mesh(content: &[u8]) -> Result<(Table, Vec<[u32; 3]>), Fault> {
    let (header, mut body) = parse_header(content)?;
    let vertices = Vertices::of(&header)?;
    if !["face", "range_grid"].iter().any(|&name| header.elements.contains_key(name)) {
        let what = "has no surface: the header has neither element face nor range_grid";
        return Err(Fault::new(what));
    }
    let (mut table, mut faces) = (None, Vec::new());
    for element in header.elements.values() {
        let known = vertices.element.count;
        match element.name.as_str() {
            "vertex" => table = Some(vertices.read(&mut body, true)?),
            "face" => faces.extend(surface::faces(&mut body, element, known)?),
            "range_grid" => {
                faces.extend(surface::range_grid(&mut body, element, known, &header.obj_infos)?);
            }
            _ => skip(&mut body, element)?,
        }
    }
    let table = table.ok_or_else(|| Fault::new("the header has no element vertex"))?;
    Ok((table, faces))
}

/// The element that has the points.
struct Vertices<'a> {
    element: &'a ElementDef,
    columns: Columns,
    /// Whether f32 holds the coordinates in binary.
    is_single: bool,
}

impl<'a> Vertices<'a> {
    fn of(header: &'a Header) -> Result<Self, Fault> {
        let element = header.elements.get("vertex");
        let element = element.ok_or_else(|| Fault::new("the header has no element vertex"))?;
        let is_scalar = |property: &&PropertyDef| elements::is_scalar(&property.data_type);
        let scalars: Vec<&PropertyDef> = element.properties.values().filter(is_scalar).collect();
        let names = scalars.iter().map(|property| Some(property.name.as_str()));
        let columns = Columns::named(names)
            .map_err(|what| Fault::new(format!("in the properties of element vertex, {what}")))?
            .of_kinds(|name, column| elements::kind(name, scalars[column]));
        let is_single =
            columns.places().iter().all(|&place| elements::is_single(&scalars[place].data_type));
        Ok(Vertices { element, columns, is_single })
    }

    /// Reads all of them; those that are not finite, too, if it `keeps_all`.
    fn read(&self, body: &mut Body<'_>, keeps_all: bool) -> Result<Table, Fault> {
        let count = body.check_count(self.element)?;
        // Ascii may have more digits than its type.
        let mut table = match body {
            Body::Binary { .. } if self.is_single => Table::single(count, &self.columns),
            _ => Table::new(count, &self.columns),
        };
        if keeps_all {
            table = table.keeping_all();
        }
        for index in 0..count {
            let start = body.start();
            let vertex = body.next::<Vertex>(self.element, index)?;
            let pushed = table.push(&vertex);
            pushed.map_err(|what| body.fault(start, format!("vertex {index}: {what}")))?;
        }
        Ok(table)
    }
}

fn skip(body: &mut Body<'_>, element: &ElementDef) -> Result<(), Fault> {
    // An element without properties takes no room, however many there are.
    let count = if element.properties.is_empty() { 0 } else { body.check_count(element)? };
    for index in 0..count {
        body.next::<Vertex>(element, index)?;
    }
    Ok(())
}

/// Writes a binary little endian file.
pub(super) fn write(
    out: &mut dyn Write,
    cloud: &PointCloud,
    layout: &Layout<'_>,
) -> io::Result<()> {
    let coordinate = if is_single(cloud) { "float" } else { "double" };
    writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}", cloud.len())?;
    for name in ["x", "y", "z"] {
        writeln!(out, "property {coordinate} {name}")?;
    }
    if cloud.normals().is_some() {
        writeln!(out, "property float nx\nproperty float ny\nproperty float nz")?;
    }
    for field in &layout.fields {
        let kind = match field.stored {
            Stored::Level(ColorDepth::Eight, _) => "uchar",
            Stored::Level(ColorDepth::Sixteen, _) => "ushort",
            Stored::Double(_) => "double",
            Stored::Float(_) | Stored::Packed(..) => "float",
        };
        writeln!(out, "property {kind} {}", field.name)?;
    }
    writeln!(out, "end_header")?;
    write_binary(out, cloud, layout)
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
                properties = HashSet::new();
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
        let said = beginning(&error.to_string());
        return Fault::new(format!("the header is not understood: {said}"));
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
