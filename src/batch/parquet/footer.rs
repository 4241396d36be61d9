//! The footer of a file: its columns and the positions of their chunks. Every number in it is
//! checked against the file.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use super::thrift::{Result, Thrift, ThriftType};

/// Physical type of a column that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PhysicalType {
    Flag,
    Int32,
    Int64,
    Float,
    Double,
    Text,
}

impl PhysicalType {
    /// Returns the least bytes of a dictionary value.
    pub(super) fn min_bytes(self) -> usize {
        match self {
            PhysicalType::Flag => 1,
            PhysicalType::Int32 | PhysicalType::Float => 4,
            // A text is preceded by its length.
            PhysicalType::Text => 4,
            PhysicalType::Int64 | PhysicalType::Double => 8,
        }
    }
}

/// A requested column.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct LeafColumn {
    /// Index among the requested columns.
    pub(super) wanted: usize,
    /// Index among all columns of the file.
    at: usize,
    /// `None` for columns that are not read: nested columns, dates, decimals and the like.
    pub(super) physical: Option<PhysicalType>,
    pub(super) optional: bool,
    pub(super) unsigned: bool,
}

/// The position of a column's values, for the rows of one group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ColumnChunk {
    pub(super) start: u64,
    pub(super) length: usize,
    pub(super) snappy: bool,
}

/// A group of some thousand rows, or any number that was written together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RowGroup {
    pub(super) rows: u64,
    /// One for each of the [`leaves`](Footer::leaves).
    pub(super) chunks: Vec<ColumnChunk>,
}

#[derive(Debug, Default)]
pub(super) struct Footer {
    pub(super) leaves: Vec<LeafColumn>,
    pub(super) groups: Vec<RowGroup>,
    /// The value of the requested key in the metadata of the file.
    pub(super) metadata_value: Option<String>,
}

const MAGIC: &[u8; 4] = b"PAR1";
/// Length of the footer, and the magic bytes.
const TAIL_BYTES: u64 = 8;

impl Footer {
    /// Reads the footer of a file of `size` bytes: the columns `wanted`, and the value under `key`.
    ///
    /// # Errors
    /// A message that says how the file is broken.
    pub(super) fn read(
        file: &mut File,
        size: u64,
        wanted: &[&str],
        key: &str,
    ) -> std::io::Result<Result<Footer>> {
        if size < TAIL_BYTES + MAGIC.len() as u64 {
            return Ok(Err(format!("it has {size} bytes")));
        }
        let mut tail = [0; TAIL_BYTES as usize];
        file.seek(SeekFrom::Start(size - TAIL_BYTES))?;
        file.read_exact(&mut tail)?;
        let [a, b, c, d, magic @ ..] = tail;
        if &magic != MAGIC {
            return Ok(Err("it does not end in PAR1".into()));
        }
        let length = u64::from(u32::from_le_bytes([a, b, c, d]));
        let Some(start) = (size - TAIL_BYTES).checked_sub(length).filter(|&at| at >= 4) else {
            return Ok(Err(format!("a footer of {length} bytes in a file of {size}")));
        };
        let mut bytes = vec![0; length as usize];
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(&mut bytes)?;
        let parsed = Footer::parse(&bytes, start, wanted, key);
        Ok(parsed.map_err(|what| format!("footer: {what}")))
    }

    /// Parses the footer; the chunks must end before `end`.
    fn parse(bytes: &[u8], end: u64, wanted: &[&str], key: &str) -> Result<Footer> {
        let mut footer = Footer::default();
        let mut columns = None;
        let mut held = 0;
        Thrift::new(bytes).fields(|thrift, field, kind| {
            match (field, kind) {
                (2, ThriftType::List) => {
                    let mut schema = Schema::default();
                    thrift.list(|thrift, _| schema.element(thrift, wanted))?;
                    columns = Some(schema.columns);
                    footer.leaves = schema.leaves;
                }
                (4, ThriftType::List) => {
                    let columns = columns.ok_or("its columns come after their places")?;
                    thrift.list(|thrift, _| {
                        let group = read_row_group(thrift, &footer.leaves, columns, end)?;
                        held += group.chunks.iter().map(|chunk| chunk.length as u64).sum::<u64>();
                        footer.groups.push(group);
                        Ok(())
                    })?;
                }
                (5, ThriftType::List) => thrift.list(|thrift, _| {
                    let (name, value) = read_key_value(thrift)?;
                    if name == key.as_bytes() {
                        footer.metadata_value = String::from_utf8(value.to_vec()).ok();
                    }
                    Ok(())
                })?,
                _ => return Ok(false),
            }
            Ok(true)
        })?;
        if held > end {
            return Err(format!("it claims {held} bytes of columns, and there are {end}"));
        }
        Ok(footer)
    }

    /// Returns the column of that index among the requested ones.
    pub(super) fn leaf(&self, wanted: usize) -> Option<&LeafColumn> {
        self.leaves.iter().find(|leaf| leaf.wanted == wanted)
    }
}

/// The columns, in the order of the schema's elements: a group before its members.
#[derive(Default)]
struct Schema {
    /// Remaining elements of each open group.
    open: Vec<i64>,
    begun: bool,
    columns: usize,
    leaves: Vec<LeafColumn>,
}

impl Schema {
    fn element(&mut self, thrift: &mut Thrift<'_>, wanted: &[&str]) -> Result<()> {
        let (mut physical, mut repetition, mut children, mut converted) = (None, 0, 0, None);
        let mut name: &[u8] = &[];
        thrift.fields(|thrift, field, kind| {
            match (field, kind) {
                (1, ThriftType::Integer) => physical = Some(thrift.integer()?),
                (3, ThriftType::Integer) => repetition = thrift.integer()?,
                (4, ThriftType::Binary) => name = thrift.binary()?,
                (5, ThriftType::Integer) => children = thrift.integer()?,
                (6, ThriftType::Integer) => converted = Some(thrift.integer()?),
                _ => return Ok(false),
            }
            Ok(true)
        })?;
        if !self.begun {
            self.begun = true;
            self.open.push(children);
            return Ok(());
        }
        while self.open.last() == Some(&0) {
            self.open.pop();
        }
        let top = self.open.len() == 1;
        *self.open.last_mut().filter(|left| **left > 0).ok_or("it has too many columns")? -= 1;
        let group = children > 0;
        let found = wanted.iter().position(|wanted| wanted.as_bytes() == name).filter(|_| top);
        if let Some(wanted) = found {
            if self.leaves.iter().any(|leaf| leaf.wanted == wanted) {
                return Err(format!("it has two columns {}", String::from_utf8_lossy(name)));
            }
            // Integers without an annotation or with a bit width, signed or unsigned.
            let whole = matches!(converted, None | Some(11..=18));
            let physical = match physical.filter(|_| repetition < 2 && !group) {
                Some(0) => Some(PhysicalType::Flag),
                Some(1) if whole => Some(PhysicalType::Int32),
                Some(2) if whole => Some(PhysicalType::Int64),
                Some(4) => Some(PhysicalType::Float),
                Some(5) => Some(PhysicalType::Double),
                Some(6) if converted != Some(5) => Some(PhysicalType::Text),
                _ => None,
            };
            let unsigned = matches!(converted, Some(11..=14));
            let (at, optional) = (self.columns, repetition == 1);
            self.leaves.push(LeafColumn { wanted, at, physical, optional, unsigned });
        }
        match group {
            true => self.open.push(children),
            false => self.columns += 1,
        }
        Ok(())
    }
}

/// Reads an entry of a file's metadata: a name and a value.
fn read_key_value<'a>(thrift: &mut Thrift<'a>) -> Result<(&'a [u8], &'a [u8])> {
    let (mut name, mut value): (&[u8], &[u8]) = (&[], &[]);
    thrift.fields(|thrift, field, kind| {
        match (field, kind) {
            (1, ThriftType::Binary) => name = thrift.binary()?,
            (2, ThriftType::Binary) => value = thrift.binary()?,
            _ => return Ok(false),
        }
        Ok(true)
    })?;
    Ok((name, value))
}

fn read_row_group(
    thrift: &mut Thrift<'_>,
    leaves: &[LeafColumn],
    columns: usize,
    end: u64,
) -> Result<RowGroup> {
    let (mut rows, mut chunks, mut column) = (None, vec![None; leaves.len()], 0);
    thrift.fields(|thrift, field, kind| {
        match (field, kind) {
            (1, ThriftType::List) => thrift.list(|thrift, kind| {
                match leaves.iter().position(|leaf| leaf.at == column) {
                    Some(leaf) => chunks[leaf] = Some(read_column_chunk(thrift, end)?),
                    None => thrift.skip(kind)?,
                }
                column += 1;
                Ok(())
            })?,
            (3, ThriftType::Integer) => rows = Some(thrift.integer()?),
            _ => return Ok(false),
        }
        Ok(true)
    })?;
    let rows = rows.and_then(|rows| u64::try_from(rows).ok());
    let rows = rows.ok_or("a group of rows does not say how many it has")?;
    if column != columns {
        return Err(format!("a group of rows has {column} of {columns} columns"));
    }
    let mut placed = Vec::with_capacity(leaves.len());
    for chunk in chunks {
        let (chunk, values) = chunk.ok_or("a column has no place")?;
        placed.push(chunk);
        if values != rows && leaves[placed.len() - 1].physical.is_some() {
            return Err(format!("a column has {values} values in {rows} rows"));
        }
    }
    Ok(RowGroup { rows, chunks: placed })
}

/// Reads the position of a column of a group, and its number of values.
fn read_column_chunk(thrift: &mut Thrift<'_>, end: u64) -> Result<(ColumnChunk, u64)> {
    let (mut codec, mut values, mut length, mut data, mut dictionary) = (0, -1, -1, -1, None);
    let mut elsewhere = false;
    thrift.fields(|thrift, field, kind| {
        match (field, kind) {
            (1, ThriftType::Binary) => elsewhere = !thrift.binary()?.is_empty(),
            (3, ThriftType::Struct) => thrift.fields(|thrift, field, kind| {
                match (field, kind) {
                    (4, ThriftType::Integer) => codec = thrift.integer()?,
                    (5, ThriftType::Integer) => values = thrift.integer()?,
                    (7, ThriftType::Integer) => length = thrift.integer()?,
                    (9, ThriftType::Integer) => data = thrift.integer()?,
                    (11, ThriftType::Integer) => dictionary = Some(thrift.integer()?),
                    _ => return Ok(false),
                }
                Ok(true)
            })?,
            _ => return Ok(false),
        }
        Ok(true)
    })?;
    if elsewhere {
        return Err("its columns are in other files".into());
    }
    let start = dictionary.filter(|&at| at > 0 && at < data).unwrap_or(data);
    let weighed = || {
        let [start, length] = [start, length].map(|number: i64| u64::try_from(number).ok());
        let (start, length) = (start.filter(|&start| start >= 4)?, length?);
        start.checked_add(length).filter(|&after| after <= end)?;
        Some((start, usize::try_from(length).ok()?, u64::try_from(values).ok()?))
    };
    let (start, length, values) = weighed().ok_or_else(|| {
        format!(
            "a column of {values} values is at {start} with {length} bytes, and there are {end}"
        )
    })?;
    let snappy = match codec {
        0 => false,
        1 => true,
        _ => return Err(format!("its compression is {}: use none or Snappy", codec_name(codec))),
    };
    Ok((ColumnChunk { start, length, snappy }, values))
}

fn codec_name(codec: i64) -> String {
    const NAMES: [&str; 8] =
        ["none", "Snappy", "Gzip", "LZO", "Brotli", "LZ4", "Zstandard", "LZ4 (raw)"];
    let name = usize::try_from(codec).ok().and_then(|codec| NAMES.get(codec));
    name.map_or_else(|| format!("the unknown {codec}"), |name| name.to_string())
}
