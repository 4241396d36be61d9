//! PCD, the format of the Point Cloud Library.
//!
//! pcd-rs reads the header and both binary bodies, once the header has been weighed
//! here: it takes memory for sizes in the file unseen, and panics when a compressed
//! body unpacks to less than the points take. Ascii bodies are read here, because it
//! rounds them to the declared type first (a float x of 5600000.3 becomes 5600000.5)
//! and does not say which line was wrong. Files are written here, because its writer
//! panics when it is dropped after an error.

use std::collections::HashMap;
use std::io::{self, Read, Write};

use pcd_rs::{DataKind, DynReader, Field, PcdMeta, ValueKind};

use super::columns::{Columns, Kind};
use super::fault::{Fault, check_claim, shown};
use super::fields::{extra_names, is_single, write_binary};
use super::lines::Lines;
use super::table::Table;
use crate::cloud::PointCloud;

/// The longest header that is read, bytes.
const LONGEST_HEADER: usize = 1 << 20;

/// LZF spells at most 264 bytes in 3.
const LZF_EXPANSION: u64 = 88;

/// Reads the points. A viewpoint of 0 0 0 is what writers put when they know none,
/// and is taken so.
pub(super) fn parse(content: &[u8]) -> Result<Table, Fault> {
    let head = Head::parse(content)?;
    let meta = PcdMeta::from_reader(head.text.as_bytes()).map_err(|error| head.fault(error))?;
    let count = meta.num_points;
    if meta.width.checked_mul(meta.height) != Some(count) {
        let (width, height) = (meta.width, meta.height);
        let what = format!("POINTS is {count}, but WIDTH is {width} and HEIGHT is {height}");
        return Err(head.at("POINTS", what));
    }
    // A field of several values is no coordinate, and padding is not in a record.
    let fields = || meta.field_defs.iter().filter(|field| !field.is_padding());
    let names = fields().map(|field| if field.count == 1 { field.name.as_str() } else { "" });
    let columns = Columns::named(names).map_err(|what| head.at("FIELDS", what))?;
    let kinds: Vec<ValueKind> = fields().map(|field| field.kind).collect();
    let columns = columns.of_kinds(|name, column| match kinds[column] {
        ValueKind::F32 if is_packed(name) => Kind::PackedFloat,
        ValueKind::U32 | ValueKind::I32 if is_packed(name) => Kind::Packed,
        _ => Kind::Of(1.0),
    });

    let table = match (count, meta.data) {
        (0, _) => Table::new(0, &columns),
        (_, DataKind::Ascii) => parse_ascii(content, &head, &meta, &columns)?,
        (_, DataKind::Binary) => {
            let left = content.len() - head.bytes;
            check_claim("points", count, record_size(&meta), left)
                .map_err(|what| Fault::byte(head.bytes, what))?;
            parse_binary(content, &head, &columns)?
        }
        (_, DataKind::BinaryCompressed) => {
            check_compressed(&content[head.bytes..], count, record_size(&meta))
                .map_err(|what| Fault::byte(head.bytes, what))?;
            parse_binary(content, &head, &columns)?
        }
    };
    let viewpoint = [meta.viewpoint.tx, meta.viewpoint.ty, meta.viewpoint.tz];
    Ok(table.seen_from((viewpoint != [0.0; 3]).then_some(viewpoint)))
}

/// Whether a field of four bytes has red, green and blue in one each.
fn is_packed(name: &str) -> bool {
    ["rgb", "rgba"].iter().any(|packed| packed.eq_ignore_ascii_case(name))
}

/// Writes a binary file.
pub(super) fn write(out: &mut dyn Write, cloud: &PointCloud) -> io::Result<()> {
    let normals = if cloud.normals().is_some() { 3 } else { 0 };
    let extras = extra_names(cloud);
    let row = |coordinate: &'static str, other: &'static str| {
        [&[coordinate; 3][..], &vec![other; normals + extras.len()]].concat().join(" ")
    };
    let normals = ["normal_x", "normal_y", "normal_z"].into_iter().take(normals);
    let names: String =
        normals.chain(extras.iter().copied()).map(|name| format!(" {name}")).collect();
    let size = if is_single(cloud) { "4" } else { "8" };
    let [x, y, z] = cloud.viewpoint().unwrap_or_default();
    writeln!(out, "# .PCD v.7 - Point Cloud Data file format\nVERSION .7")?;
    writeln!(out, "FIELDS x y z{names}\nSIZE {}", row(size, "4"))?;
    writeln!(out, "TYPE {}\nCOUNT {}", row("F", "F"), row("1", "1"))?;
    writeln!(out, "WIDTH {}\nHEIGHT 1\nVIEWPOINT {x:?} {y:?} {z:?} 1 0 0 0", cloud.len())?;
    writeln!(out, "POINTS {}\nDATA binary", cloud.len())?;
    write_binary(out, cloud)
}

/// The header as text, with what is needed to tell where it is wrong.
struct Head {
    text: String,
    bytes: usize,
    /// The line of each entry, by its keyword.
    lines: HashMap<String, usize>,
    last: usize,
}

impl Head {
    /// Finds the end of the header and checks each entry's numbers on the way: pcd-rs
    /// says neither which entry was no number nor that one was there twice.
    fn parse(content: &[u8]) -> Result<Head, Fault> {
        let start = &content[..content.len().min(LONGEST_HEADER)];
        let mut head = Head { text: String::new(), bytes: 0, lines: HashMap::new(), last: 0 };
        for line in start.split_inclusive(|&byte| byte == b'\n') {
            head.bytes += line.len();
            head.last += 1;
            // Comments come in any encoding; everything that counts is ascii.
            let line = String::from_utf8_lossy(line);
            head.text.push_str(&line);
            let mut words = line.split('#').next().unwrap_or_default().split_ascii_whitespace();
            let Some(keyword) = words.next().map(str::to_uppercase) else { continue };
            check_numbers(&keyword, words).map_err(|what| Fault::line(head.last, what))?;
            let is_data = keyword == "DATA";
            if let Some(first) = head.lines.insert(keyword, head.last) {
                let what = format!("repeats the entry of line {first}");
                return Err(Fault::line(head.last, what));
            }
            if is_data {
                return Ok(head);
            }
        }
        Err(Fault::new(format!("there is no DATA entry in the first {} bytes", start.len())))
    }

    /// A fault in the entry `keyword`.
    fn at(&self, keyword: &str, what: String) -> Fault {
        match self.lines.get(keyword) {
            Some(&line) => Fault::line(line, what),
            None => Fault::new(what),
        }
    }

    /// What pcd-rs refused, in the line of the entry that it speaks of.
    fn fault(&self, error: pcd_rs::Error) -> Fault {
        let what = match error {
            pcd_rs::Error::ParseError { desc, .. } => desc,
            other => other.to_string(),
        };
        let mut words = what.split_whitespace().map(str::to_uppercase);
        let entry = words.find(|word| self.lines.contains_key(word)).unwrap_or_default();
        self.at(&entry, format!("the header is not understood: {what}"))
    }
}

/// Checks that an entry's values are the numbers that its keyword calls for.
fn check_numbers<'a>(
    keyword: &str,
    mut values: impl Iterator<Item = &'a str>,
) -> Result<(), String> {
    let is_count = |value: &str| value.parse::<u64>().is_ok();
    let is_finite = |value: &str| value.parse().is_ok_and(f64::is_finite);
    let (bad, expected) = match keyword {
        "SIZE" | "COUNT" | "WIDTH" | "HEIGHT" | "POINTS" => {
            (values.find(|value| !is_count(value)), "a whole number, 0 or more")
        }
        "VIEWPOINT" => (values.find(|value| !is_finite(value)), "a finite number"),
        _ => (None, ""),
    };
    match bad {
        Some(value) => Err(format!("{keyword} has {}, expected {expected}", shown(value))),
        None => Ok(()),
    }
}

/// Bytes of a point; as many as there can be when the header's numbers overflow.
fn record_size(meta: &PcdMeta) -> u64 {
    let sizes = meta.field_defs.iter().map(|f| f.count.saturating_mul(f.kind.byte_size() as u64));
    sizes.fold(0, u64::saturating_add)
}

/// Checks the two sizes before a compressed body against the points and the file.
fn check_compressed(body: &[u8], count: u64, record: u64) -> Result<(), String> {
    let size = |at: usize| {
        let bytes = body.get(at..at + 4)?.try_into().ok()?;
        Some(u64::from(u32::from_le_bytes(bytes)))
    };
    let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
        return Err("the file ends within the sizes of the compressed data".into());
    };
    let left = body.len() as u64 - 8;
    if packed > left {
        return Err(format!("the compressed data take {packed} bytes, but {left} are left"));
    }
    if count.checked_mul(record) != Some(unpacked) {
        return Err(format!(
            "the compressed data unpack to {unpacked} bytes, which are not {count} points of \
             {record} bytes each"
        ));
    }
    if unpacked > packed.saturating_mul(LZF_EXPANSION) {
        return Err(format!("{packed} bytes of compressed data cannot unpack to {unpacked}"));
    }
    Ok(())
}

/// Reads a body, binary or compressed, whose size was checked.
fn parse_binary(content: &[u8], head: &Head, columns: &Columns) -> Result<Table, Fault> {
    let refuse = |error| Fault::byte(head.bytes, format!("the points cannot be read: {error}"));
    let whole = head.text.as_bytes().chain(&content[head.bytes..]);
    let records = DynReader::from_reader(whole).map_err(refuse)?;
    // As bits: on the way through f64 those that are a NaN would change.
    let columns = columns.clone().of_kinds(|_, column| match columns.kind(column) {
        Some(Kind::PackedFloat) => Kind::Packed,
        kind => kind.unwrap_or(Kind::Of(1.0)),
    });
    let value = |column, field: &Field| match (columns.kind(column), field) {
        (Some(Kind::Packed), Field::F32(values)) => values.first().map(|x| x.to_bits().into()),
        _ => first_value(field),
    };
    let mut table = Table::new(records.size_hint().0, &columns);
    for record in records {
        let record = record.map_err(refuse)?;
        let vertex = columns.vertex(|column| value(column, record.0.get(column)?));
        table.push(vertex.ok_or_else(|| Fault::byte(head.bytes, "a point lacks a coordinate"))?);
    }
    Ok(table)
}

fn first_value(field: &Field) -> Option<f64> {
    match field {
        Field::I8(values) => values.first().map(|&value| value.into()),
        Field::I16(values) => values.first().map(|&value| value.into()),
        Field::I32(values) => values.first().map(|&value| value.into()),
        Field::I64(values) => values.first().map(|&value| value as f64),
        Field::U8(values) => values.first().map(|&value| value.into()),
        Field::U16(values) => values.first().map(|&value| value.into()),
        Field::U32(values) => values.first().map(|&value| value.into()),
        Field::U64(values) => values.first().map(|&value| value as f64),
        Field::F32(values) => values.first().map(|&value| value.into()),
        Field::F64(values) => values.first().copied(),
    }
}

/// Reads a body of one point a line.
fn parse_ascii(
    content: &[u8],
    head: &Head,
    meta: &PcdMeta,
    columns: &Columns,
) -> Result<Table, Fault> {
    let mut lines = Lines::new(content, head.bytes, head.last);
    let words_a_line = meta.field_defs.iter().fold(0, |sum: u64, f| sum.saturating_add(f.count));
    // A digit each, and a space between.
    let smallest = words_a_line.saturating_mul(2) - 1;
    let count = check_claim("points", meta.num_points, smallest, lines.rest().len())
        .map_err(|what| Fault::line(head.last + 1, what))?;

    let mut first_word = 0;
    let mut first_words = Vec::new();
    for field in meta.field_defs.iter() {
        if !field.is_padding() {
            first_words.push(first_word);
        }
        first_word += field.count as usize;
    }
    let columns = columns.moved(|field| first_words.get(field).copied());

    let mut table = Table::new(count, &columns);
    let mut words = Vec::new();
    for index in 0..count {
        let Some(line) = lines.next() else {
            let what = format!("the file ends before point {index} of {count}");
            return Err(Fault::line(lines.number(), what));
        };
        let (number, line) = line?;
        words.clear();
        words.extend(line.split_ascii_whitespace());
        table.push(columns.parse(&words, number)?);
    }
    Ok(table)
}
