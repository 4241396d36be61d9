//! Stanford PLY.
//!
//! ply-rs-bw reads the header and the binary elements. Three of its behaviours are replaced here: a
//! repeated name silently replaces the earlier one, which shifts every later binary value; ascii
//! numbers have only the form `1`, `1.5`, `1e5`, so that `nan`, `.5` and `1.` are refused; and a
//! float property in ascii is rounded to f32 first, although the file has more digits.

mod elements;
mod faces;

use std::collections::HashSet;
use std::io::{self, Write};

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Header, PropertyDef, PropertyType};

use self::elements::PlyBody;
use super::columns::{ColumnMap, Vertex};
use super::content_error::{ContentError, MAX_HEADER_BYTES, quote_start, truncate_message};
use super::differences::{Differences, truncate_name};
use super::layout::{FieldData, FieldLayout, is_single, write_binary};
use super::lines::Lines;
use super::table::PointTable;
use crate::cloud::{ColorDepth, PointCloud};

/// Reads the vertices; earlier elements are skipped, later ones not read.
pub(super) fn parse(content: &[u8]) -> Result<PointTable, ContentError> {
    let (header, mut body) = parse_header(content)?;
    let vertices = Vertices::from_header(&header)?;
    for element in header.elements.values().take_while(|element| element.name != "vertex") {
        skip(&mut body, element)?;
    }
    Ok(vertices.read(&mut body, false)?.with_differences(differences(&header, &vertices)))
}

/// Returns the parts of the file that no cloud has, independent of its points.
fn differences(header: &Header, vertices: &Vertices<'_>) -> Differences {
    let mut differences = Differences::default();
    for element in header.elements.values().filter(|element| element.name != "vertex") {
        differences.leave_out_all(element.count, &truncate_name(&element.name));
    }
    for property in vertices.element.properties.values() {
        if let PropertyType::List(..) = property.data_type {
            differences.leave_out(format!("the list {}", truncate_name(&property.name)));
        }
    }
    differences.leave_out_all(header.comments.len() + header.obj_infos.len(), "comment");
    differences
}

/// Reads the vertices, and the triangles of the faces or the range grid as vertex indices.
pub(super) fn parse_mesh(content: &[u8]) -> Result<(PointTable, Vec<[u32; 3]>), ContentError> {
    let (header, mut body) = parse_header(content)?;
    let vertices = Vertices::from_header(&header)?;
    if !["face", "range_grid"].iter().any(|&name| header.elements.contains_key(name)) {
        let what = "has no surface: the header has neither element face nor range_grid";
        return Err(ContentError::new(what));
    }
    let (mut table, mut faces) = (None, Vec::new());
    for element in header.elements.values() {
        let known = vertices.element.count;
        match element.name.as_str() {
            "vertex" => table = Some(vertices.read(&mut body, true)?),
            "face" => faces.extend(faces::read_faces(&mut body, element, known)?),
            "range_grid" => {
                faces.extend(faces::read_range_grid(&mut body, element, known, &header.obj_infos)?);
            }
            _ => skip(&mut body, element)?,
        }
    }
    let table = table.ok_or_else(|| ContentError::new("the header has no element vertex"))?;
    Ok((table, faces))
}

/// The element that holds the points.
struct Vertices<'a> {
    element: &'a ElementDef,
    columns: ColumnMap,
    /// Whether f32 holds the coordinates in binary.
    is_single: bool,
}

impl<'a> Vertices<'a> {
    fn from_header(header: &'a Header) -> Result<Self, ContentError> {
        let element = header.elements.get("vertex");
        let element =
            element.ok_or_else(|| ContentError::new("the header has no element vertex"))?;
        let is_scalar = |property: &&PropertyDef| elements::is_scalar(&property.data_type);
        let scalars: Vec<&PropertyDef> = element.properties.values().filter(is_scalar).collect();
        let names = scalars.iter().map(|property| Some(property.name.as_str()));
        let columns = ColumnMap::from_names(names)
            .map_err(|what| {
                ContentError::new(format!("in the properties of element vertex, {what}"))
            })?
            .with_kinds(|name, column| elements::kind(name, scalars[column]));
        let is_single = columns
            .position_columns()
            .iter()
            .all(|&place| elements::is_single(&scalars[place].data_type));
        Ok(Vertices { element, columns, is_single })
    }

    /// Reads all vertices; if `keeps_all`, also those that are not finite.
    fn read(&self, body: &mut PlyBody<'_>, keeps_all: bool) -> Result<PointTable, ContentError> {
        let count = body.check_count(self.element)?;
        // Ascii may have more digits than its type.
        let mut table = match body {
            PlyBody::Binary { .. } if self.is_single => {
                PointTable::single_precision(count, &self.columns)
            }
            _ => PointTable::new(count, &self.columns),
        };
        if keeps_all {
            table = table.keep_non_finite();
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

fn skip(body: &mut PlyBody<'_>, element: &ElementDef) -> Result<(), ContentError> {
    // An element without properties takes no bytes, at any count.
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
    layout: &FieldLayout<'_>,
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
            FieldData::Level(ColorDepth::Eight, _) => "uchar",
            FieldData::Level(ColorDepth::Sixteen, _) => "ushort",
            FieldData::Double(_) => "double",
            FieldData::Float(_) | FieldData::Packed(..) => "float",
        };
        writeln!(out, "property {kind} {}", field.name)?;
    }
    writeln!(out, "end_header")?;
    write_binary(out, cloud, layout)
}

/// Parses the header, and returns the body after it.
fn parse_header(content: &[u8]) -> Result<(Header, PlyBody<'_>), ContentError> {
    let (bytes, lines) = header_size(content)?;
    // Comments come in any encoding; all other header text is ascii.
    let text = String::from_utf8_lossy(&content[..bytes]);
    let header = Parser::<Vertex>::new()
        .read_header(&mut Reader::new(text.as_bytes()))
        .map_err(|error| header_error(&error, &text))?;
    let body = match header.encoding {
        Encoding::Ascii => PlyBody::Ascii(Lines::new(content, bytes, lines)),
        encoding => PlyBody::Binary {
            content,
            at: bytes,
            big_endian: encoding == Encoding::BinaryBigEndian,
        },
    };
    Ok((header, body))
}

/// Returns the bytes and lines of the header; a repeated name is an error.
fn header_size(content: &[u8]) -> Result<(usize, usize), ContentError> {
    let mut bytes = 0;
    let mut elements = HashSet::new();
    let mut properties = HashSet::new();
    let start = &content[..content.len().min(MAX_HEADER_BYTES)];
    for (index, line) in start.split_inclusive(|&byte| byte == b'\n').enumerate() {
        bytes += line.len();
        let line = String::from_utf8_lossy(line);
        if index == 0 && line.trim_end() != "ply" {
            return Err(ContentError::line(
                1,
                format!("expected ply, found {}", quote_start(line.trim_end())),
            ));
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
            let what = format!("header line {} repeats a name", quote_start(line.trim()));
            return Err(ContentError::line(index + 1, what));
        }
    }
    Err(ContentError::new(format!("there is no end_header in the first {} bytes", start.len())))
}

/// Converts an error of the header parser to the line and the expected content.
fn header_error(error: &ParseError, header: &str) -> ContentError {
    let numbered =
        error.line().and_then(|number| Some((number, header.lines().nth(number.checked_sub(1)?)?)));
    let Some((number, line)) = numbered else {
        let said = truncate_message(&error.to_string());
        return ContentError::new(format!("the header is not understood: {said}"));
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
    ContentError::line(
        number,
        format!("header line {} is not understood, expected {expected}", quote_start(line)),
    )
}
