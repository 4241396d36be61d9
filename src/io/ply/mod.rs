//! Stanford PLY.

pub(super) mod body;
mod faces;
pub(super) mod header;
pub(super) mod splat;
pub(super) mod standard_header;

use std::collections::HashSet;
use std::io::{self, Write};

use self::body::{PlyBody, Row, RowPlan};
use self::header::{Element, PlyHeader, Property, PropertyKind};
use super::columns::{ColumnKind, ColumnMap, Vertex, color, slot};
use super::content_error::ContentError;
use super::differences::{Differences, truncate_name};
use super::layout::{FieldData, FieldLayout, is_single, write_binary};
use super::scalar::Scalar;
use super::table::PointTable;
use crate::cloud::{ColorDepth, PointCloud};

/// Reads the vertices; earlier elements are skipped, later ones not read.
pub(super) fn parse(content: &[u8]) -> Result<PointTable, ContentError> {
    let header = standard_header::parse(content)?;
    let mut body = PlyBody::new(content, &header);
    let vertices = Vertices::from_header(&header)?;
    for element in header.elements.iter().take_while(|element| element.name != "vertex") {
        body.skip(element)?;
    }
    let mut differences = differences(&header, &vertices);
    differences.merge_in_place(vertices.differences.clone());
    Ok(vertices.read(&mut body, false)?.with_differences(differences))
}

/// Returns the parts of the file that no cloud has, independent of its points.
fn differences(header: &PlyHeader, vertices: &Vertices<'_>) -> Differences {
    let mut differences = Differences::default();
    for element in header.elements.iter().filter(|element| element.name != "vertex") {
        differences.leave_out_all(element.count, &truncate_name(&element.name));
    }
    for property in &vertices.element.properties {
        if let PropertyKind::List(..) = property.kind {
            differences.leave_out(format!("the list {}", truncate_name(&property.name)));
        }
    }
    differences.leave_out_all(header.comments, "comment");
    differences
}

/// Reads the vertices, and the triangles of the faces or the range grid as vertex indices.
pub(super) fn parse_mesh(content: &[u8]) -> Result<(PointTable, Vec<[u32; 3]>), ContentError> {
    let header = standard_header::parse(content)?;
    let mut body = PlyBody::new(content, &header);
    let vertices = Vertices::from_header(&header)?;
    if !["face", "range_grid"].iter().any(|&name| header.element(name).is_some()) {
        let what = "has no surface: the header has neither element face nor range_grid";
        return Err(ContentError::new(what));
    }
    let (mut table, mut faces) = (None, Vec::new());
    for element in &header.elements {
        let known = vertices.element.count;
        match element.name.as_str() {
            "vertex" => table = Some(vertices.read(&mut body, true)?),
            "face" => faces.extend(faces::read_faces(&mut body, element, known)?),
            "range_grid" => {
                faces.extend(faces::read_range_grid(&mut body, element, known, &header.infos)?);
            }
            _ => body.skip(element)?,
        }
    }
    let table = table.ok_or_else(|| ContentError::new("the header has no element vertex"))?;
    Ok((table, faces))
}

/// The element that holds the points.
struct Vertices<'a> {
    element: &'a Element,
    columns: ColumnMap,
    /// Whether f32 holds the coordinates in binary.
    is_single: bool,
    /// Properties that are not read.
    differences: Differences,
}

impl<'a> Vertices<'a> {
    fn from_header(header: &'a PlyHeader) -> Result<Self, ContentError> {
        let element = header.element("vertex");
        let element =
            element.ok_or_else(|| ContentError::new("the header has no element vertex"))?;
        let properties = &element.properties;
        if element.properties.iter().any(|property| property.name == "packed_position") {
            return Err(ContentError::new(
                "the vertices are Gaussian splats in SuperSplat's compressed form \
                 (packed_position), and plain numbers x, y and z are read: export them \
                 uncompressed, as PLY",
            ));
        }
        let mut differences = Differences::default();
        let mut names: Vec<Option<&str>> = Vec::new();
        let (mut slots, mut taken) = ([false; 6], HashSet::new());
        for property in properties {
            let name = property.name.as_str();
            let is_scalar = matches!(property.kind, PropertyKind::Scalar(_));
            let is_new = is_scalar
                && match slot(name) {
                    Some(slot) => !std::mem::replace(&mut slots[slot], true),
                    None => taken.insert(name),
                };
            if is_scalar && !is_new {
                differences.leave_out(format!("the second {}", truncate_name(name)));
            }
            names.push(is_new.then_some(name));
        }
        splat::leave_out_shape(&mut names, &mut differences);
        let columns = ColumnMap::from_names(names.iter().copied())
            .map_err(|what| {
                ContentError::new(format!("in the properties of element vertex, {what}"))
            })?
            .with_kinds(|name, column| column_kind(name, &properties[column]));
        let is_single = columns.position_columns().iter().all(
            |&place| matches!(properties[place].kind, PropertyKind::Scalar(kind) if kind.is_single()),
        );
        Ok(Vertices { element, columns, is_single, differences })
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
        let plan = RowPlan::new(self.element, |column| self.columns.fills_slot(column), None);
        let (mut row, mut vertex) = (Row::default(), Vertex::default());
        for index in 0..count {
            let start = body.start();
            body.next(&plan, index, &mut row)?;
            self.columns.fill(&mut vertex, |column| row.values[column]);
            let pushed = table.push(&vertex);
            pushed.map_err(|what| body.fault(start, format!("vertex {index}: {what}")))?;
        }
        Ok(table)
    }
}

/// Returns the kind of a property, colours being whole numbers in one byte or two; `name` is the
/// channel's name.
fn column_kind(name: &str, property: &Property) -> ColumnKind {
    match (color(name), property.kind) {
        (Some(_), PropertyKind::Scalar(Scalar::U8)) => ColumnKind::Color(ColorDepth::Eight),
        (Some(_), PropertyKind::Scalar(Scalar::U16)) => ColumnKind::Color(ColorDepth::Sixteen),
        _ => ColumnKind::Number,
    }
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
