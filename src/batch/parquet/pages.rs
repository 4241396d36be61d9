//! The pages of a column: all headers are checked against the bytes present before the first page
//! is unpacked; the crate decodes the contents.

use std::collections::VecDeque;

use bytes::Bytes;
use parquet::basic::Encoding;
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::ParquetError;

use super::footer::PhysicalType;
use super::thrift::{Result, Thrift, ThriftType};

/// Largest expansion of a byte by Snappy: three bytes copy 64. Short texts get some more.
const MAX_SNAPPY_RATIO: usize = 22;
const SNAPPY_SLACK_BYTES: usize = 64;
/// Memory for a dictionary value, for texts. Chosen by hand.
const DICTIONARY_VALUE_BYTES: usize = 48;

/// The pages of a column, for the rows of one group.
#[derive(Debug)]
pub(super) struct Pages {
    pages: VecDeque<PageHeader>,
    chunk: Bytes,
    snappy: bool,
    optional: bool,
}

/// The header of a page, and its position in the chunk.
#[derive(Debug, Clone, Default, PartialEq)]
struct PageHeader {
    at: usize,
    packed: usize,
    unpacked: usize,
    values: usize,
    encoding: ValueEncoding,
    body: PageBody,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum PageBody {
    Dictionary,
    /// A data page of the first version; the variants differ in the levels: runs, or packed bits.
    #[default]
    V1,
    V1PackedLevels,
    /// A data page of the second version, with the bytes of its levels, which are not compressed.
    V2 {
        levels: usize,
        nulls: usize,
        compressed: bool,
    },
}

/// The supported encodings of values.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum ValueEncoding {
    #[default]
    Plain,
    Dictionary,
    Runs,
    Deltas,
    DeltaLengths,
    Split,
}

impl Pages {
    /// Reads the page headers of a chunk that holds `rows` values.
    ///
    /// # Errors
    /// A message that says how the header is broken.
    pub(super) fn new(
        chunk: Bytes,
        snappy: bool,
        rows: u64,
        physical: PhysicalType,
        optional: bool,
    ) -> Result<Pages> {
        let mut pages = VecDeque::new();
        let (mut at, mut left, mut dictionary) = (0, rows, false);
        while at < chunk.len() && left > 0 {
            let mut thrift = Thrift::new(&chunk[at..]);
            let raw = RawPageHeader::read(&mut thrift)?;
            at += thrift.position();
            let there = chunk.len() - at;
            let packed = usize::try_from(raw.packed).ok().filter(|&packed| packed <= there);
            let packed = packed
                .ok_or_else(|| format!("a page of {} bytes where {there} are left", raw.packed))?;
            if let Some(header) = raw.header(at, packed, snappy)? {
                header.check(&chunk, snappy, physical, optional, dictionary)?;
                match header.body {
                    PageBody::Dictionary => dictionary = true,
                    _ => {
                        left = left.checked_sub(header.values as u64).ok_or_else(|| {
                            format!("its pages have more values than the {rows} rows")
                        })?;
                    }
                }
                pages.push_back(header);
            }
            at += packed;
        }
        if left > 0 {
            return Err(format!("its pages have {} values for {rows} rows", rows - left));
        }
        Ok(Pages { pages, chunk, snappy, optional })
    }

    /// Returns the bytes of the largest page.
    pub(super) fn largest(&self) -> usize {
        self.pages.iter().map(|page| page.unpacked).max().unwrap_or(0)
    }

    /// Returns the peak bytes in memory while pages are decoded: the chunk, a dictionary and a
    /// page.
    pub(super) fn memory(&self) -> usize {
        let dictionary = |page: &&PageHeader| page.body == PageBody::Dictionary;
        let held = |page: &PageHeader| page.unpacked + DICTIONARY_VALUE_BYTES * page.values;
        let held: usize = self.pages.iter().filter(dictionary).map(held).sum();
        // Text lengths are decoded before the texts.
        let lengths = |page: &PageHeader| match page.encoding {
            ValueEncoding::DeltaLengths => page.values.saturating_mul(size_of::<i32>()),
            _ => 0,
        };
        let lengths = self.pages.iter().map(lengths).max().unwrap_or(0);
        held.saturating_add(lengths).saturating_add(self.chunk.len() + 2 * self.largest())
    }

    fn page(&self, header: &PageHeader) -> Result<Page> {
        let PageHeader { at, packed, unpacked, values, encoding, body } = *header;
        let raw = self.chunk.slice(at..at + packed);
        let levels = if let PageBody::V2 { levels, .. } = body { levels } else { 0 };
        let compressed = !matches!(body, PageBody::V2 { compressed: false, .. });
        let buf = if self.snappy && compressed && unpacked > levels {
            let mut all = vec![0; unpacked];
            all[..levels].copy_from_slice(&raw[..levels]);
            let made = snap::raw::Decoder::new().decompress(&raw[levels..], &mut all[levels..]);
            let made = made.map_err(|error| format!("a page cannot be unpacked: {error}"))?;
            if made != unpacked - levels {
                return Err(format!("a page of {unpacked} bytes unpacks to {made}"));
            }
            Bytes::from(all)
        } else {
            raw
        };
        if encoding == ValueEncoding::DeltaLengths {
            let count = self.delta_count(header, &buf).unwrap_or(u64::MAX);
            if count > values as u64 {
                return Err(format!("a page of {values} values claims {count} texts"));
            }
        }
        let num_values = values as u32;
        let encoding = encoding.as_crate();
        Ok(match body {
            PageBody::Dictionary => {
                Page::DictionaryPage { buf, num_values, encoding, is_sorted: false }
            }
            #[expect(deprecated, reason = "old files have it")]
            PageBody::V1 | PageBody::V1PackedLevels => Page::DataPage {
                buf,
                num_values,
                encoding,
                def_level_encoding: match body {
                    PageBody::V1PackedLevels => Encoding::BIT_PACKED,
                    _ => Encoding::RLE,
                },
                rep_level_encoding: Encoding::RLE,
                statistics: None,
            },
            PageBody::V2 { levels, nulls, .. } => Page::DataPageV2 {
                buf,
                num_values,
                encoding,
                num_nulls: nulls as u32,
                num_rows: num_values,
                def_levels_byte_len: levels as u32,
                rep_levels_byte_len: 0,
                is_compressed: false,
                statistics: None,
            },
        })
    }
}

impl Pages {
    /// Returns the number of values that a delta-encoded page claims: the third number of the
    /// encoded data, which follows the levels.
    fn delta_count(&self, header: &PageHeader, page: &[u8]) -> Option<u64> {
        let levels = match header.body {
            PageBody::V2 { levels, .. } => levels,
            PageBody::V1 if self.optional => {
                let length = page.first_chunk().map(|length| u32::from_le_bytes(*length))?;
                4 + length as usize
            }
            PageBody::V1PackedLevels if self.optional => header.values.div_ceil(8),
            _ => 0,
        };
        let mut numbers = Thrift::new(page.get(levels..)?);
        (0..3).try_fold(0, |_, _| numbers.varint().ok())
    }
}

impl PageHeader {
    /// Checks the header against the bytes of its page.
    fn check(
        &self,
        chunk: &[u8],
        snappy: bool,
        physical: PhysicalType,
        optional: bool,
        dictionary: bool,
    ) -> Result<()> {
        self.check_size(&chunk[self.at..self.at + self.packed], snappy)?;
        if !self.fits(physical, dictionary)? {
            return Err(format!("values of this kind cannot be {:?}", self.encoding.as_crate()));
        }
        // Levels mark missing values; without levels no value may be missing.
        if let PageBody::V2 { levels, nulls, .. } = self.body
            && (nulls > self.values || (!optional && (nulls > 0 || levels > 0)))
        {
            return Err(format!("{nulls} of {} values are missing", self.values));
        }
        Ok(())
    }

    /// Checks the sizes that the header claims against the bytes of the page.
    fn check_size(&self, page: &[u8], snappy: bool) -> Result<()> {
        let (levels, compressed) = match self.body {
            PageBody::V2 { levels, compressed, .. } => (levels, snappy && compressed),
            _ => (0, snappy),
        };
        if levels > self.packed || levels > self.unpacked {
            return Err(format!("a page of {} bytes has {levels} of levels", self.packed));
        }
        if compressed && self.unpacked > levels {
            let packed = &page[levels..];
            let claimed = snap::raw::decompress_len(packed).map_err(|error| error.to_string())?;
            let most = MAX_SNAPPY_RATIO * packed.len() + SNAPPY_SLACK_BYTES;
            if claimed != self.unpacked - levels || claimed > most {
                return Err(format!(
                    "a page of {} bytes claims to unpack to {}",
                    self.packed, self.unpacked
                ));
            }
        } else if !compressed && self.packed != self.unpacked {
            return Err(format!(
                "a page of {} bytes that is not compressed claims {}",
                self.packed, self.unpacked
            ));
        }
        Ok(())
    }

    /// Returns whether values of the column's type can have the encoding of the page.
    fn fits(&self, physical: PhysicalType, dictionary: bool) -> Result<bool> {
        let text = physical == PhysicalType::Text;
        let whole = matches!(physical, PhysicalType::Int32 | PhysicalType::Int64);
        Ok(match (self.body, self.encoding) {
            (PageBody::Dictionary, ValueEncoding::Plain | ValueEncoding::Dictionary) => {
                if dictionary {
                    return Err("it has two dictionaries".into());
                }
                let least = (self.values as u64).saturating_mul(physical.min_bytes() as u64);
                if least > self.unpacked as u64 {
                    return Err(format!(
                        "a dictionary of {} bytes claims {} values",
                        self.unpacked, self.values
                    ));
                }
                physical != PhysicalType::Flag
            }
            (PageBody::Dictionary, _) => false,
            (_, ValueEncoding::Plain) => true,
            (_, ValueEncoding::Dictionary) => {
                if !dictionary {
                    return Err("it has no dictionary".into());
                }
                true
            }
            (_, ValueEncoding::Runs) => physical == PhysicalType::Flag,
            (_, ValueEncoding::Deltas) => whole,
            (_, ValueEncoding::DeltaLengths) => text,
            (_, ValueEncoding::Split) => !text && physical != PhysicalType::Flag,
        })
    }
}

impl ValueEncoding {
    /// Returns the encoding by its number in a header.
    fn from_code(code: i64) -> Result<ValueEncoding> {
        Ok(match code {
            0 => ValueEncoding::Plain,
            2 | 8 => ValueEncoding::Dictionary,
            3 => ValueEncoding::Runs,
            5 => ValueEncoding::Deltas,
            6 => ValueEncoding::DeltaLengths,
            9 => ValueEncoding::Split,
            7 => return Err("its texts are DELTA_BYTE_ARRAY: use PLAIN or a dictionary".into()),
            _ => return Err(format!("its values are written in the unknown way {code}")),
        })
    }

    fn as_crate(self) -> Encoding {
        match self {
            ValueEncoding::Plain => Encoding::PLAIN,
            ValueEncoding::Dictionary => Encoding::RLE_DICTIONARY,
            ValueEncoding::Runs => Encoding::RLE,
            ValueEncoding::Deltas => Encoding::DELTA_BINARY_PACKED,
            ValueEncoding::DeltaLengths => Encoding::DELTA_LENGTH_BYTE_ARRAY,
            ValueEncoding::Split => Encoding::BYTE_STREAM_SPLIT,
        }
    }
}

/// A header as in the file.
#[derive(Debug, Default)]
struct RawPageHeader {
    kind: i64,
    unpacked: i64,
    packed: i64,
    values: i64,
    encoding: i64,
    levels: i64,
    nulls: i64,
    /// Bytes of the levels of lists; no requested column is a list.
    repeated: i64,
    packed_levels: bool,
    plain: bool,
    bodies: usize,
}

impl RawPageHeader {
    fn read(thrift: &mut Thrift<'_>) -> Result<RawPageHeader> {
        let mut raw = RawPageHeader {
            kind: -1,
            packed: -1,
            unpacked: -1,
            values: -1,
            ..RawPageHeader::default()
        };
        thrift.fields(|thrift, field, kind| {
            match (field, kind) {
                (1, ThriftType::Integer) => raw.kind = thrift.integer()?,
                (2, ThriftType::Integer) => raw.unpacked = thrift.integer()?,
                (3, ThriftType::Integer) => raw.packed = thrift.integer()?,
                (5 | 7 | 8, ThriftType::Struct) => raw.body(thrift, field)?,
                _ => return Ok(false),
            }
            Ok(true)
        })?;
        Ok(raw)
    }

    fn body(&mut self, thrift: &mut Thrift<'_>, body: i64) -> Result<()> {
        self.bodies += 1;
        thrift.fields(|thrift, field, kind| {
            match (body, field, kind) {
                (_, 1, ThriftType::Integer) => self.values = thrift.integer()?,
                (5 | 7, 2, ThriftType::Integer) | (8, 4, ThriftType::Integer) => {
                    self.encoding = thrift.integer()?;
                }
                (5, 3, ThriftType::Integer) => self.packed_levels = thrift.integer()? == 4,
                (8, 2, ThriftType::Integer) => self.nulls = thrift.integer()?,
                (8, 5, ThriftType::Integer) => self.levels = thrift.integer()?,
                (8, 6, ThriftType::Integer) => self.repeated = thrift.integer()?,
                (8, 7, ThriftType::Flag(compressed)) => self.plain = !compressed,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }

    /// Converts to the header of a page of values; `None` for pages of another kind.
    fn header(&self, at: usize, packed: usize, snappy: bool) -> Result<Option<PageHeader>> {
        let number = |number: i64, what: &str| {
            let number = i32::try_from(number).ok().and_then(|number| usize::try_from(number).ok());
            number.ok_or_else(|| format!("a page does not say {what}, or nothing that can be"))
        };
        let body = match self.kind {
            0 if self.packed_levels => PageBody::V1PackedLevels,
            0 => PageBody::V1,
            1 => return Ok(None),
            2 => PageBody::Dictionary,
            3 if self.repeated == 0 => PageBody::V2 {
                levels: number(self.levels, "how long its levels are")?,
                nulls: number(self.nulls, "how many values are missing")?,
                compressed: snappy && !self.plain,
            },
            _ => return Err(format!("it has a page of the unknown kind {}", self.kind)),
        };
        if self.bodies != 1 {
            return Err(format!("a page has {} headers of its own", self.bodies));
        }
        let unpacked = number(self.unpacked, "how long it is")?;
        let values = number(self.values, "how many values it has")?;
        let encoding = ValueEncoding::from_code(self.encoding)?;
        Ok(Some(PageHeader { at, packed, unpacked, values, encoding, body }))
    }
}

impl PageReader for Pages {
    fn get_next_page(&mut self) -> parquet::errors::Result<Option<Page>> {
        let Some(header) = self.pages.pop_front() else { return Ok(None) };
        self.page(&header).map(Some).map_err(ParquetError::General)
    }

    fn peek_next_page(&mut self) -> parquet::errors::Result<Option<PageMetadata>> {
        Ok(self.pages.front().map(|page| {
            let dictionary = page.body == PageBody::Dictionary;
            PageMetadata {
                num_rows: (!dictionary).then_some(page.values),
                num_levels: (!dictionary).then_some(page.values),
                is_dict: dictionary,
            }
        }))
    }

    fn skip_next_page(&mut self) -> parquet::errors::Result<()> {
        self.pages.pop_front();
        Ok(())
    }
}

impl Iterator for Pages {
    type Item = parquet::errors::Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}
