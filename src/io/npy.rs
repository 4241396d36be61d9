//! Arrays of numpy: `.npy`, and the arrays in `.npz`.

use std::io::{self, Write};

use super::columns::{ColumnKind, ColumnMap, Vertex, color};
use super::content_error::{ContentError, quote_start};
use super::differences::{Differences, truncate_name};
use super::layout::{FieldData, FieldLayout, is_single, write_binary};
use super::literal::{Literal, parse_literal};
use super::scalar::Scalar;
use super::table::PointTable;
use crate::cloud::{ColorDepth, PointCloud};

/// An array of numbers or of records in the bytes of a file.
pub(super) struct Array<'a> {
    pub shape: Vec<usize>,
    pub fields: Vec<ArrayField>,
    /// Whether the first index runs fastest.
    pub fortran: bool,
    pub data: &'a [u8],
    /// The byte at which the data begin.
    pub start: usize,
}

/// A field of the records; arrays of plain numbers have one without a name.
#[derive(Debug, Clone)]
pub(super) struct ArrayField {
    pub name: Option<String>,
    pub scalar: Scalar,
    pub big_endian: bool,
    /// Numbers of this field in a record.
    pub count: usize,
    /// Bytes of the record before it.
    pub offset: usize,
}

impl<'a> Array<'a> {
    /// Parses the header, and checks the size of the data.
    pub fn parse(content: &'a [u8]) -> Result<Array<'a>, ContentError> {
        let (header, start) = header(content)?;
        let refuse = |what: &str| ContentError::byte(10, format!("in the header, {what}"));
        let Some(Literal::Dict(entries)) = parse_literal(header) else {
            return Err(refuse("a dictionary with descr, fortran_order and shape is expected"));
        };
        let entry =
            |name: &str| entries.iter().find(|(own, _)| own == name).map(|(_, value)| value);
        let shape = match entry("shape") {
            Some(Literal::Tuple(sizes)) => sizes.iter().map(size).collect::<Option<Vec<usize>>>(),
            _ => None,
        };
        let shape = shape.ok_or_else(|| refuse("shape is no tuple of numbers"))?;
        let fortran = matches!(entry("fortran_order"), Some(Literal::Bool(true)));
        let fields = match entry("descr") {
            Some(Literal::Text(kind)) => field(None, kind, 1, 0).map(|field| vec![field]),
            Some(Literal::List(records)) => record_fields(records),
            _ => Err("descr is no type".into()),
        };
        let fields = fields.map_err(|what| refuse(&what))?;
        let array = Array { shape, fields, fortran, data: &content[start..], start };
        array.check_size()?;
        Ok(array)
    }

    /// Returns the bytes of a record.
    pub fn stride(&self) -> usize {
        self.fields
            .iter()
            .map(|field| field.offset + field.scalar.size() * field.count)
            .max()
            .unwrap_or(0)
    }

    fn check_size(&self) -> Result<(), ContentError> {
        let product = self.shape.iter().try_fold(1usize, |all, &size| all.checked_mul(size));
        let needed = product.and_then(|count| count.checked_mul(self.stride()));
        match needed {
            Some(needed) if needed <= self.data.len() => Ok(()),
            _ => Err(ContentError::byte(
                self.start,
                format!(
                    "an array of shape {:?} takes {} bytes a record, and {} bytes are left: it was \
                     cut short",
                    self.shape,
                    self.stride(),
                    self.data.len()
                ),
            )),
        }
    }

    /// Returns the number of points and of numbers a point; the error says which shapes are read.
    pub fn rows(&self) -> Result<(usize, usize), ContentError> {
        let plain = self.fields.len() == 1 && self.fields[0].name.is_none();
        match (&self.shape[..], plain) {
            ([rows], false) => Ok((*rows, 0)),
            ([rows @ .., width], true)
                if !rows.is_empty() && (*width >= 3 || self.data.is_empty()) =>
            {
                Ok((rows.iter().product(), *width))
            }
            _ => Err(ContentError::byte(
                self.start,
                format!(
                    "the array has the shape {:?}, expected (N, 3) or more columns, or N records \
                     with x, y and z (transpose a (3, N) array)",
                    self.shape
                ),
            )),
        }
    }

    /// Returns the number at `row` and `column` of an array of plain numbers with `rows` rows and
    /// `width` columns.
    pub fn at(&self, row: usize, column: usize, [rows, width]: [usize; 2]) -> f64 {
        let field = &self.fields[0];
        let place = if self.fortran { column * rows + row } else { row * width + column };
        let bytes = self.data.get(place * field.scalar.size()..).unwrap_or_default();
        field.scalar.read(bytes, field.big_endian)
    }
}

/// Returns the header and the byte after it.
fn header(content: &[u8]) -> Result<(&str, usize), ContentError> {
    let version = content.get(6).copied().unwrap_or_default();
    let length: Option<(usize, usize)> = match version {
        1 => content.get(8..10).map(|own| (usize::from(u16::from_le_bytes([own[0], own[1]])), 10)),
        2 | 3 => content.get(8..12).map(|own| (Scalar::U32.read(own, false) as usize, 12)),
        _ => None,
    };
    let text = length.filter(|_| content.starts_with(b"\x93NUMPY")).and_then(|(length, at)| {
        let text = content.get(at..at.checked_add(length)?)?;
        Some((std::str::from_utf8(text).ok()?, at + length))
    });
    text.ok_or_else(|| {
        ContentError::byte(
            0,
            "the header is no header of numpy's format 1, 2 or 3, or is cut short",
        )
    })
}

fn size(literal: &Literal) -> Option<usize> {
    match literal {
        Literal::Number(number) => usize::try_from(*number).ok(),
        _ => None,
    }
}

/// Parses a type such as `<f4`.
fn field(
    name: Option<String>,
    kind: &str,
    count: usize,
    offset: usize,
) -> Result<ArrayField, String> {
    let scalar = match kind.trim_start_matches(['<', '>', '|', '=']) {
        "f2" => Scalar::F16,
        "f4" => Scalar::F32,
        "f8" => Scalar::F64,
        "i1" => Scalar::I8,
        "u1" | "b1" => Scalar::U8,
        "i2" => Scalar::I16,
        "u2" => Scalar::U16,
        "i4" => Scalar::I32,
        "u4" => Scalar::U32,
        "i8" => Scalar::I64,
        "u8" => Scalar::U64,
        _ => {
            let kind = quote_start(kind);
            return Err(format!(
                "the type {kind} is not read: integers and floats of 1 to 8 bytes are; save \
                 points.astype(float)"
            ));
        }
    };
    Ok(ArrayField { name, scalar, big_endian: kind.starts_with('>'), count, offset })
}

/// Parses the fields of records: (name, type) or (name, type, shape).
fn record_fields(records: &[Literal]) -> Result<Vec<ArrayField>, String> {
    let mut fields: Vec<ArrayField> = Vec::new();
    let mut offset = 0usize;
    for record in records {
        let Literal::Tuple(parts) = record else { return Err("a field is no tuple".into()) };
        let (name, kind, count) = match &parts[..] {
            [Literal::Text(name), Literal::Text(kind)] => (name, kind, Some(1)),
            [Literal::Text(name), Literal::Text(kind), Literal::Tuple(shape)] => {
                let sizes = shape.iter().map(size);
                (name, kind, sizes.product::<Option<usize>>().filter(|&count| count < 1 << 20))
            }
            _ => return Err("a field has a type other than numbers".into()),
        };
        let count = count.ok_or("the shape of a field is no tuple of numbers")?;
        // Padding of aligned records is of a type of its own, V and its bytes.
        if let Some(bytes) = kind.strip_prefix("|V").and_then(|bytes| bytes.parse::<usize>().ok()) {
            offset = offset.saturating_add(bytes.saturating_mul(count));
            continue;
        }
        let field = field(Some(name.clone()), kind, count, offset)?;
        offset = offset.saturating_add(field.scalar.size() * count);
        fields.push(field);
    }
    Ok(fields)
}

/// Reads a `.npy` file.
pub(super) fn parse(content: &[u8]) -> Result<PointTable, ContentError> {
    let array = Array::parse(content)?;
    let (rows, width) = array.rows()?;
    match width {
        0 => records(&array, rows),
        _ => plain(&array, rows, width, &[]),
    }
}

/// Names that stand for three columns, and these.
const TRIPLES: [(&[&str], [&str; 3]); 3] = [
    (&["xyz", "points", "point", "positions", "position", "coords", "coord"], ["x", "y", "z"]),
    (&["normals", "normal"], ["nx", "ny", "nz"]),
    (&["rgb", "colors", "color", "colours", "colour"], ["red", "green", "blue"]),
];

/// Returns the three columns that a name stands for.
pub(super) fn triple(name: &str) -> Option<[&'static str; 3]> {
    let lower = name.to_ascii_lowercase();
    TRIPLES.iter().find(|(names, _)| names.contains(&lower.as_str())).map(|(_, three)| *three)
}

/// Returns the kind of numbers of this type in the channel of that name.
pub(super) fn kind(name: &str, scalar: Scalar) -> ColumnKind {
    match (color(name), scalar) {
        (None, _) => ColumnKind::Number,
        (Some(_), Scalar::U8) => ColumnKind::Color(ColorDepth::Eight),
        (Some(_), Scalar::U16) => ColumnKind::Color(ColorDepth::Sixteen),
        (Some(_), _) => ColumnKind::Share,
    }
}

/// Reads records with named fields.
fn records(array: &Array<'_>, rows: usize) -> Result<PointTable, ContentError> {
    let mut differences = Differences::default();
    let mut names: Vec<Option<&str>> = Vec::new();
    let mut sources: Vec<(&ArrayField, usize)> = Vec::new();
    for field in &array.fields {
        let name = field.name.as_deref().unwrap_or_default();
        match (field.count, triple(name)) {
            (1, _) => {
                names.push(Some(name));
                sources.push((field, 0));
            }
            (3, Some(three)) => {
                names.extend(three.map(Some));
                sources.extend([0, 1, 2].map(|part| (field, part)));
            }
            (count, _) => {
                let name = truncate_name(name);
                differences.leave_out(format!("{name} ({count} values a point)"));
            }
        }
    }
    let columns = ColumnMap::from_names(names.into_iter())
        .map_err(|what| ContentError::byte(10, format!("in the fields of the records, {what}")))?
        .with_kinds(|name, column| kind(name, sources[column].0.scalar));
    let stride = array.stride();
    fill(rows, &columns, array.start, stride, |row, column| {
        let (field, part) = sources[column];
        let at = row * stride + field.offset + part * field.scalar.size();
        field.scalar.read(array.data.get(at..).unwrap_or_default(), field.big_endian)
    })
    .map(|table| table.with_differences(differences))
}

/// One more column beside the positions: its name, its array, and its column there.
pub(super) type Beside<'a> = (String, &'a Array<'a>, usize);

/// Reads plain numbers: the first three columns are positions.
pub(super) fn plain(
    array: &Array<'_>,
    rows: usize,
    width: usize,
    beside: &[Beside<'_>],
) -> Result<PointTable, ContentError> {
    let names = ["x", "y", "z"].into_iter().chain(beside.iter().map(|(name, ..)| name.as_str()));
    let columns = ColumnMap::from_names(names.map(Some)).map_err(ContentError::new)?.with_kinds(
        |name, column| match column.checked_sub(3) {
            Some(at) => kind(name, beside[at].1.fields[0].scalar),
            None => ColumnKind::Number,
        },
    );
    let columns = if beside.is_empty() { columns.without_names(width) } else { columns };
    let value = |row: usize, column: usize| match column.checked_sub(3) {
        None => array.at(row, column, [rows, width]),
        Some(at) => {
            let (_, array, column) = &beside[at];
            array.at(row, *column, [rows, array.shape.get(1).copied().unwrap_or(1)])
        }
    };
    fill(rows, &columns, array.start, width * array.stride(), value)
}

fn fill(
    rows: usize,
    columns: &ColumnMap,
    start: usize,
    stride: usize,
    value: impl Fn(usize, usize) -> f64,
) -> Result<PointTable, ContentError> {
    let mut table = PointTable::new(rows, columns);
    let mut vertex = Vertex::default();
    for row in 0..rows {
        columns.fill(&mut vertex, |column| value(row, column));
        table.push(&vertex).map_err(|what| {
            ContentError::byte(start + row * stride, format!("point {row}: {what}"))
        })?;
    }
    Ok(table)
}

/// Writes the header of an array of the type `descr` (as Python writes it).
pub(super) fn write_header(out: &mut dyn Write, descr: &str, shape: &[usize]) -> io::Result<()> {
    let shape: String = shape.iter().map(|size| format!("{size}, ")).collect();
    let mut header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': ({shape}), }}");
    // The header ends in a line end, and the data begin at a multiple of 64 bytes.
    let used = 12 + header.len() + 1;
    header += &" ".repeat(used.next_multiple_of(64) - used);
    header.push('\n');
    out.write_all(b"\x93NUMPY\x02\0")?;
    out.write_all(&(header.len() as u32).to_le_bytes())?;
    out.write_all(header.as_bytes())
}

/// Writes a cloud: as (N, 3) where it has positions alone, else as records with named fields.
pub(super) fn write(
    out: &mut dyn Write,
    cloud: &PointCloud,
    layout: &FieldLayout<'_>,
) -> io::Result<()> {
    let kind = if is_single(cloud) { "<f4" } else { "<f8" };
    if cloud.normals().is_none() && layout.fields.is_empty() {
        write_header(out, &format!("'{kind}'"), &[cloud.len(), 3])?;
    } else {
        let mut fields: Vec<String> =
            ["x", "y", "z"].iter().map(|name| format!("('{name}', '{kind}')")).collect();
        if cloud.normals().is_some() {
            fields.extend(["nx", "ny", "nz"].iter().map(|name| format!("('{name}', '<f4')")));
        }
        for field in &layout.fields {
            let kind = match field.stored {
                FieldData::Level(ColorDepth::Eight, _) => "|u1",
                FieldData::Level(ColorDepth::Sixteen, _) => "<u2",
                FieldData::Double(_) => "<f8",
                FieldData::Float(_) | FieldData::Packed(..) => "<f4",
            };
            fields.push(format!("('{}', '{kind}')", field.name));
        }
        write_header(out, &format!("[{}]", fields.join(", ")), &[cloud.len()])?;
    }
    write_binary(out, cloud, layout)
}
