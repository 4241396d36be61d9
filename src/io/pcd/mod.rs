//! PCD, the format of the Point Cloud Library.
//!
//! pcd-rs reads the header. Bodies are read here: pcd-rs allocates the sizes in the file without a
//! check, three times the unpacked size of a compressed body, and rounds ascii to the declared type
//! first (a float x of 5600000.3 becomes 5600000.5) without reporting the line of an error. Files
//! are written here, because its writer panics when it is dropped after an error.

mod header;
mod lzf;

use std::io::{self, Write};

use pcd_rs::{DataKind, PcdMeta, ValueKind};

pub(super) use self::header::PcdHeader;
use super::columns::{ColumnKind, ColumnMap, Vertex};
use super::content_error::{ContentError, check_claim, max_memory};
use super::differences::{Differences, truncate_name};
use super::layout::{FieldData, FieldLayout, is_single, write_binary};
use super::lines::Lines;
use super::table::PointTable;
use crate::cloud::{PointCloud, find_too_large};

/// Reads the points. A viewpoint of 0 0 0 counts as unknown, because writers use it so.
pub(super) fn parse(content: &[u8]) -> Result<PointTable, ContentError> {
    let head = PcdHeader::parse(content)?;
    if content[head.bytes..].starts_with(b"HEADER_EXT_START") {
        let what = "is the extended PCD 3.0 of Xtreme1, and PCD up to 0.7 is read: leave out the \
                    lines from HEADER_EXT_START to HEADER_EXT_END and write VERSION 0.7";
        return Err(ContentError::line(head.last + 1, what));
    }
    let meta = PcdMeta::from_reader(head.text.as_bytes()).map_err(|error| head.fault(error))?;
    let count = meta.num_points;
    if meta.width.checked_mul(meta.height) != Some(count) {
        let (width, height) = (meta.width, meta.height);
        let what = format!("POINTS is {count}, but WIDTH is {width} and HEIGHT is {height}");
        return Err(head.at("POINTS", what));
    }
    let viewpoint = [meta.viewpoint.tx, meta.viewpoint.ty, meta.viewpoint.tz];
    if let Some(value) = find_too_large(viewpoint) {
        let what = format!("VIEWPOINT has {value:e}, expected numbers within 1e75 of zero");
        return Err(head.at("VIEWPOINT", what));
    }
    // A field of several values is no coordinate, and a record has no padding.
    let fields = || meta.field_defs.iter().filter(|field| !field.is_padding());
    let names = fields().map(|field| (field.count == 1).then_some(field.name.as_str()));
    let columns = ColumnMap::from_names(names).map_err(|what| head.at("FIELDS", what))?;
    let kinds: Vec<(ValueKind, Option<bool>)> =
        fields().map(|field| (field.kind, packs_alpha(&field.name))).collect();
    let columns = columns.with_kinds(|_, column| match kinds[column] {
        (ValueKind::F32, Some(alpha)) if meta.data == DataKind::Ascii => {
            ColumnKind::PackedFloat { alpha }
        }
        (ValueKind::F32 | ValueKind::U32 | ValueKind::I32, Some(alpha)) => {
            ColumnKind::Packed { alpha }
        }
        _ => ColumnKind::Number,
    });

    let body = &content[head.bytes..];
    let at_body = |what| ContentError::byte(head.bytes, what);
    let record = record_size(&meta);
    let limit = max_memory(content.len());
    let table = match (count, meta.data) {
        (0, _) => PointTable::new(0, &columns),
        (_, DataKind::Ascii) => parse_ascii(content, &head, &meta, columns)?,
        (_, DataKind::Binary) => {
            check_claim("points", count, record, body.len()).map_err(at_body)?;
            parse_binary(body, FieldOrder::Points, &meta, &columns, limit).map_err(at_body)?
        }
        (_, DataKind::BinaryCompressed) => {
            let bytes = unpack(body, &meta, content.len()).map_err(at_body)?;
            parse_binary(&bytes, FieldOrder::Fields, &meta, &columns, limit).map_err(at_body)?
        }
    };
    let table = table.with_differences(differences(&head, &meta));
    Ok(table.with_viewpoint((viewpoint != [0.0; 3]).then_some(viewpoint)))
}

/// Returns the parts of the file that no cloud has, independent of its points.
fn differences(head: &PcdHeader, meta: &PcdMeta) -> Differences {
    let mut differences = Differences::default();
    differences.leave_out_all(head.comments, "comment");
    for field in meta.field_defs.iter().filter(|field| !field.is_padding() && field.count > 1) {
        let name = truncate_name(&field.name);
        differences.leave_out(format!("{name} ({} values a point)", field.count));
    }
    if meta.height > 1 {
        let (width, height) = (meta.width, meta.height);
        differences.leave_out(format!("the grid of {width} columns and {height} rows"));
    }
    let view = &meta.viewpoint;
    if [view.qx, view.qy, view.qz] != [0.0; 3] {
        differences.leave_out("the orientation of VIEWPOINT");
    }
    differences
}

/// Returns whether a field of four bytes with packed red, green and blue also has opacity; `None`
/// for any other field.
fn packs_alpha(name: &str) -> Option<bool> {
    match name {
        _ if name.eq_ignore_ascii_case("rgb") => Some(false),
        _ if name.eq_ignore_ascii_case("rgba") => Some(true),
        _ => None,
    }
}

/// Writes a binary file.
pub(super) fn write(
    out: &mut dyn Write,
    cloud: &PointCloud,
    layout: &FieldLayout<'_>,
) -> io::Result<()> {
    let (mut names, mut sizes, mut types) = ("x y z".to_string(), String::new(), String::new());
    let size = if is_single(cloud) { " 4" } else { " 8" };
    sizes.extend([size; 3]);
    types.extend([" F"; 3]);
    if cloud.normals().is_some() {
        names += " normal_x normal_y normal_z";
        sizes.extend([" 4"; 3]);
        types.extend([" F"; 3]);
    }
    for field in &layout.fields {
        names.extend([" ", &field.name]);
        let (size, kind) = match field.stored {
            FieldData::Float(_) | FieldData::Packed(_, None) => (" 4", " F"),
            FieldData::Double(_) => (" 8", " F"),
            FieldData::Packed(_, Some(_)) => (" 4", " U"),
            FieldData::Level(..) => (" 2", " U"),
        };
        sizes += size;
        types += kind;
    }
    let counts = " 1".repeat(types.len() / 2);
    let [x, y, z] = cloud.viewpoint().unwrap_or_default();
    writeln!(out, "# .PCD v.7 - Point Cloud Data file format\nVERSION .7")?;
    writeln!(out, "FIELDS {names}\nSIZE{sizes}\nTYPE{types}\nCOUNT{counts}")?;
    writeln!(out, "WIDTH {}\nHEIGHT 1\nVIEWPOINT {x:?} {y:?} {z:?} 1 0 0 0", cloud.len())?;
    writeln!(out, "POINTS {}\nDATA binary", cloud.len())?;
    write_binary(out, cloud, layout)
}

/// Returns the bytes of a point; the maximum if the header's numbers overflow.
pub(super) fn record_size(meta: &PcdMeta) -> u64 {
    let sizes = meta.field_defs.iter().map(|f| f.count.saturating_mul(f.kind.byte_size() as u64));
    sizes.fold(0, u64::saturating_add)
}

/// Unpacks the points of a compressed body, field by field.
pub(super) fn unpack(body: &[u8], meta: &PcdMeta, file_size: usize) -> Result<Vec<u8>, String> {
    let limit = max_memory(file_size);
    let (packed, size) = check_compressed(body, meta.num_points, record_size(meta), limit)?;
    lzf::decompress(packed, size).map_err(|what| format!("the points cannot be unpacked: {what}"))
}

/// Returns the compressed bytes of a body and their unpacked size. Checks both sizes against the
/// points, the file and the memory limit.
fn check_compressed(
    body: &[u8],
    count: u64,
    record: u64,
    limit: usize,
) -> Result<(&[u8], usize), String> {
    let size = |at: usize| {
        let bytes = body.get(at..at + 4)?.try_into().ok()?;
        Some(u32::from_le_bytes(bytes))
    };
    let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
        return Err("the file ends within the sizes of the compressed data".into());
    };
    let left = &body[8..];
    let Some(data) = left.get(..packed as usize) else {
        let left = left.len();
        return Err(format!("the compressed data take {packed} bytes, but {left} are left"));
    };
    if count.checked_mul(record) != Some(unpacked.into()) {
        return Err(format!(
            "the compressed data unpack to {unpacked} bytes, which are not {count} points of \
             {record} bytes each"
        ));
    }
    if u64::from(unpacked) > u64::from(packed) * lzf::EXPANSION {
        return Err(format!("{packed} bytes of compressed data cannot unpack to {unpacked}"));
    }
    if unpacked as usize > limit {
        return Err(format!(
            "{packed} bytes of compressed data unpack to {unpacked}, more than the {limit} that a \
             file of this size may take"
        ));
    }
    Ok((data, unpacked as usize))
}

/// The bytes of one field, point by point.
struct BinaryField {
    start: usize,
    stride: usize,
    kind: ValueKind,
    /// Colours in a float are read as bits: the conversion to f64 would change those that are NaN.
    as_bits: bool,
}

impl BinaryField {
    /// Returns the first value of point `i`.
    fn at(&self, bytes: &[u8], i: usize) -> f64 {
        let rest = bytes.get(self.start + i * self.stride..).unwrap_or_default();
        fn first<const N: usize>(rest: &[u8]) -> [u8; N] {
            rest.first_chunk().copied().unwrap_or([0; N])
        }
        match self.kind {
            ValueKind::I8 => i8::from_le_bytes(first(rest)).into(),
            ValueKind::I16 => i16::from_le_bytes(first(rest)).into(),
            ValueKind::I32 => i32::from_le_bytes(first(rest)).into(),
            ValueKind::I64 => i64::from_le_bytes(first(rest)) as f64,
            ValueKind::U8 => u8::from_le_bytes(first(rest)).into(),
            ValueKind::U16 => u16::from_le_bytes(first(rest)).into(),
            ValueKind::U32 => u32::from_le_bytes(first(rest)).into(),
            ValueKind::U64 => u64::from_le_bytes(first(rest)) as f64,
            ValueKind::F32 if self.as_bits => u32::from_le_bytes(first(rest)).into(),
            ValueKind::F32 => f32::from_le_bytes(first(rest)).into(),
            ValueKind::F64 => f64::from_le_bytes(first(rest)),
        }
    }
}

/// The order of values in a binary body.
#[derive(Clone, Copy, PartialEq)]
enum FieldOrder {
    /// Point after point.
    Points,
    /// Field after field, as in compressed bodies.
    Fields,
}

/// Reads the points in `bytes`, whose size was checked; total memory is at most `limit` bytes.
fn parse_binary(
    bytes: &[u8],
    order: FieldOrder,
    meta: &PcdMeta,
    columns: &ColumnMap,
    limit: usize,
) -> Result<PointTable, String> {
    let count = meta.num_points as usize;
    let record = record_size(meta) as usize;
    let mut start = 0;
    let mut values = Vec::new();
    for field in meta.field_defs.iter() {
        let size = field.kind.byte_size() * field.count as usize;
        if !field.is_padding() {
            let as_bits = packs_alpha(&field.name).is_some();
            let (start, stride) = match order {
                FieldOrder::Points => (start, record),
                FieldOrder::Fields => (start * count, size),
            };
            values.push(BinaryField { start, stride, kind: field.kind, as_bits });
        }
        start += size;
    }
    let places = columns.position_columns();
    let finite = |&i: &usize| places.iter().all(|&place| values[place].at(bytes, i).is_finite());
    let there = (0..count).filter(finite).count();
    let is_single = places.iter().all(|&place| !is_wide(values[place].kind));
    let size = PointTable::point_size(columns, is_single);
    if there.saturating_mul(size).saturating_add(bytes.len()) > limit {
        return Err(format!(
            "{there} points of {size} bytes in memory are more than the {limit} bytes that a file \
             of this size may take"
        ));
    }
    let mut table = match is_single {
        true => PointTable::single_precision(there, columns),
        false => PointTable::new(there, columns),
    };
    let mut vertex = Vertex::default();
    for i in 0..count {
        columns.fill(&mut vertex, |column| values[column].at(bytes, i));
        table.push(&vertex).map_err(|what| format!("point {i}: {what}"))?;
    }
    Ok(table)
}

/// Returns whether f32 cannot hold all values of a field.
fn is_wide(kind: ValueKind) -> bool {
    use ValueKind::{F64, I32, I64, U32, U64};
    matches!(kind, F64 | I32 | I64 | U32 | U64)
}

/// Reads a body of one point per line.
fn parse_ascii(
    content: &[u8],
    head: &PcdHeader,
    meta: &PcdMeta,
    columns: ColumnMap,
) -> Result<PointTable, ContentError> {
    let mut lines = Lines::new(content, head.bytes, head.last);
    let words_a_line = meta.field_defs.iter().fold(0, |sum: u64, f| sum.saturating_add(f.count));
    // One digit per word, and a space between words.
    let smallest = words_a_line.saturating_mul(2) - 1;
    let count = check_claim("points", meta.num_points, smallest, lines.rest().len())
        .map_err(|what| ContentError::line(head.last + 1, what))?;

    let mut first_word = 0;
    let mut first_words = Vec::new();
    for field in meta.field_defs.iter() {
        if !field.is_padding() {
            first_words.push(first_word);
        }
        first_word += field.count as usize;
    }
    let columns = columns.with_moved_columns(|field| first_words[field]);

    let mut table = PointTable::new(count, &columns);
    let mut vertex = Vertex::default();
    for index in 0..count {
        let Some(line) = lines.next() else {
            let what = format!("the file ends before point {index} of {count}");
            return Err(ContentError::line(lines.number(), what));
        };
        let (number, line) = line?;
        columns.parse(&mut vertex, line.split_ascii_whitespace(), number)?;
        table.push(&vertex).map_err(|what| ContentError::line(number, what))?;
    }
    Ok(table)
}
