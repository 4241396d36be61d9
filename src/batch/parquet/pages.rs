//! The pages of a column: their headers are weighed against the bytes that are there, all before
//! the first one is unpacked, and the crate decodes what is in them.

use std::collections::VecDeque;

use bytes::Bytes;
use parquet::basic::Encoding;
use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::ParquetError;

use super::footer::Physical;
use super::thrift::{Kind, Result, Thrift};

/// Most that Snappy makes of a byte, with some for short texts: three bytes copy 64.
const MOST_PACKED: usize = 22;
const SHORT: usize = 64;
/// Memory for a value of a dictionary in which texts are.
const VALUE: usize = 48;

/// The pages of a column, for the rows of one group.
#[derive(Debug)]
pub(super) struct Pages {
    pages: VecDeque<Header>,
    chunk: Bytes,
    snappy: bool,
    optional: bool,
}

/// The header of a page, and its place in the chunk.
#[derive(Debug, Clone, Default, PartialEq)]
struct Header {
    at: usize,
    packed: usize,
    unpacked: usize,
    values: usize,
    encoding: Encoded,
    body: Body,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Body {
    Dictionary,
    /// A data page of the first version; whether levels are packed bits instead of runs.
    #[default]
    One,
    OnePackedLevels,
    /// A data page of the second version; bytes of its levels, which are not compressed.
    Two {
        levels: usize,
        nulls: usize,
        compressed: bool,
    },
}

/// Ways in which values are written, of those that are read.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Encoded {
    #[default]
    Plain,
    Dictionary,
    Runs,
    Deltas,
    DeltaLengths,
    Split,
}

impl Pages {
    /// The pages of a chunk that holds `rows` values.
    ///
    /// # Errors
    /// A message that says how the header is broken.
    pub(super) fn new(
        chunk: Bytes,
        snappy: bool,
        rows: u64,
        physical: Physical,
        optional: bool,
    ) -> Result<Pages> {
        let mut pages = VecDeque::new();
        let (mut at, mut left, mut dictionary) = (0, rows, false);
        while at < chunk.len() && left > 0 {
            let mut thrift = Thrift::new(&chunk[at..]);
            let raw = Raw::read(&mut thrift)?;
            at += thrift.at();
            let there = chunk.len() - at;
            let packed = usize::try_from(raw.packed).ok().filter(|&packed| packed <= there);
            let packed = packed
                .ok_or_else(|| format!("a page of {} bytes where {there} are left", raw.packed))?;
            if let Some(header) = raw.header(at, packed, snappy)? {
                header.check(&chunk, snappy, physical, optional, dictionary)?;
                match header.body {
                    Body::Dictionary => dictionary = true,
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

    /// Bytes of the largest page.
    pub(super) fn largest(&self) -> usize {
        self.pages.iter().map(|page| page.unpacked).max().unwrap_or(0)
    }

    /// Bytes that are in memory at once while pages are decoded: the chunk, a dictionary and a page.
    pub(super) fn memory(&self) -> usize {
        let dictionary = |page: &&Header| page.body == Body::Dictionary;
        let held = |page: &Header| page.unpacked + VALUE * page.values;
        let held: usize = self.pages.iter().filter(dictionary).map(held).sum();
        // The lengths of texts are decoded before the texts.
        let lengths = |page: &Header| match page.encoding {
            Encoded::DeltaLengths => page.values.saturating_mul(size_of::<i32>()),
            _ => 0,
        };
        let lengths = self.pages.iter().map(lengths).max().unwrap_or(0);
        held.saturating_add(lengths).saturating_add(self.chunk.len() + 2 * self.largest())
    }

    fn page(&self, header: &Header) -> Result<Page> {
        let Header { at, packed, unpacked, values, encoding, body } = *header;
        let raw = self.chunk.slice(at..at + packed);
        let levels = if let Body::Two { levels, .. } = body { levels } else { 0 };
        let compressed = !matches!(body, Body::Two { compressed: false, .. });
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
        if encoding == Encoded::DeltaLengths {
            let count = self.delta_count(header, &buf).unwrap_or(u64::MAX);
            if count > values as u64 {
                return Err(format!("a page of {values} values claims {count} texts"));
            }
        }
        let num_values = values as u32;
        let encoding = encoding.as_crate();
        Ok(match body {
            Body::Dictionary => {
                Page::DictionaryPage { buf, num_values, encoding, is_sorted: false }
            }
            #[expect(deprecated, reason = "old files have it")]
            Body::One | Body::OnePackedLevels => Page::DataPage {
                buf,
                num_values,
                encoding,
                def_level_encoding: match body {
                    Body::OnePackedLevels => Encoding::BIT_PACKED,
                    _ => Encoding::RLE,
                },
                rep_level_encoding: Encoding::RLE,
                statistics: None,
            },
            Body::Two { levels, nulls, .. } => Page::DataPageV2 {
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
    /// How many values the numbers of a page claim to be, that are written by their differences:
    /// the third number of those, which stand behind the levels.
    fn delta_count(&self, header: &Header, page: &[u8]) -> Option<u64> {
        let levels = match header.body {
            Body::Two { levels, .. } => levels,
            Body::One if self.optional => {
                let length = page.first_chunk().map(|length| u32::from_le_bytes(*length))?;
                4 + length as usize
            }
            Body::OnePackedLevels if self.optional => header.values.div_ceil(8),
            _ => 0,
        };
        let mut numbers = Thrift::new(page.get(levels..)?);
        (0..3).try_fold(0, |_, _| numbers.varint().ok())
    }
}

impl Header {
    /// Weighs what the header says against the bytes of its page.
    fn check(
        &self,
        chunk: &[u8],
        snappy: bool,
        physical: Physical,
        optional: bool,
        dictionary: bool,
    ) -> Result<()> {
        let page = &chunk[self.at..self.at + self.packed];
        let (levels, compressed) = match self.body {
            Body::Two { levels, compressed, .. } => (levels, snappy && compressed),
            _ => (0, snappy),
        };
        if levels > self.packed || levels > self.unpacked {
            return Err(format!("a page of {} bytes has {levels} of levels", self.packed));
        }
        if compressed && self.unpacked > levels {
            let packed = &page[levels..];
            let claimed = snap::raw::decompress_len(packed).map_err(|error| error.to_string())?;
            let most = MOST_PACKED * packed.len() + SHORT;
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
        let text = physical == Physical::Text;
        let whole = matches!(physical, Physical::Int32 | Physical::Int64);
        let fits = match (self.body, self.encoding) {
            (Body::Dictionary, Encoded::Plain | Encoded::Dictionary) => {
                if dictionary {
                    return Err("it has two dictionaries".into());
                }
                let least = (self.values as u64).saturating_mul(physical.smallest() as u64);
                if least > self.unpacked as u64 {
                    return Err(format!(
                        "a dictionary of {} bytes claims {} values",
                        self.unpacked, self.values
                    ));
                }
                physical != Physical::Flag
            }
            (Body::Dictionary, _) => false,
            (_, Encoded::Plain) => true,
            (_, Encoded::Dictionary) => {
                if !dictionary {
                    return Err("it has no dictionary".into());
                }
                true
            }
            (_, Encoded::Runs) => physical == Physical::Flag,
            (_, Encoded::Deltas) => whole,
            (_, Encoded::DeltaLengths) => text,
            (_, Encoded::Split) => !text && physical != Physical::Flag,
        };
        if !fits {
            return Err(format!("values of this kind cannot be {:?}", self.encoding.as_crate()));
        }
        // Levels say which are there; without them all must be.
        if let Body::Two { levels, nulls, .. } = self.body
            && (nulls > self.values || (!optional && (nulls > 0 || levels > 0)))
        {
            return Err(format!("{nulls} of {} values are missing", self.values));
        }
        Ok(())
    }
}

impl Encoded {
    /// By its number in a header.
    fn of(code: i64) -> Result<Encoded> {
        Ok(match code {
            0 => Encoded::Plain,
            2 | 8 => Encoded::Dictionary,
            3 => Encoded::Runs,
            5 => Encoded::Deltas,
            6 => Encoded::DeltaLengths,
            9 => Encoded::Split,
            7 => return Err("its texts are DELTA_BYTE_ARRAY: use PLAIN or a dictionary".into()),
            _ => return Err(format!("its values are written in the unknown way {code}")),
        })
    }

    fn as_crate(self) -> Encoding {
        match self {
            Encoded::Plain => Encoding::PLAIN,
            Encoded::Dictionary => Encoding::RLE_DICTIONARY,
            Encoded::Runs => Encoding::RLE,
            Encoded::Deltas => Encoding::DELTA_BINARY_PACKED,
            Encoded::DeltaLengths => Encoding::DELTA_LENGTH_BYTE_ARRAY,
            Encoded::Split => Encoding::BYTE_STREAM_SPLIT,
        }
    }
}

/// A header as it is in the file.
#[derive(Debug, Default)]
struct Raw {
    kind: i64,
    unpacked: i64,
    packed: i64,
    values: i64,
    encoding: i64,
    levels: i64,
    nulls: i64,
    /// Bytes of the levels of lists, which none of the columns is.
    repeated: i64,
    packed_levels: bool,
    plain: bool,
    bodies: usize,
}

impl Raw {
    fn read(thrift: &mut Thrift<'_>) -> Result<Raw> {
        let mut raw = Raw { kind: -1, packed: -1, unpacked: -1, values: -1, ..Raw::default() };
        thrift.fields(|thrift, field, kind| {
            match (field, kind) {
                (1, Kind::Integer) => raw.kind = thrift.integer()?,
                (2, Kind::Integer) => raw.unpacked = thrift.integer()?,
                (3, Kind::Integer) => raw.packed = thrift.integer()?,
                (5 | 7 | 8, Kind::Struct) => raw.body(thrift, field)?,
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
                (_, 1, Kind::Integer) => self.values = thrift.integer()?,
                (5 | 7, 2, Kind::Integer) | (8, 4, Kind::Integer) => {
                    self.encoding = thrift.integer()?;
                }
                (5, 3, Kind::Integer) => self.packed_levels = thrift.integer()? == 4,
                (8, 2, Kind::Integer) => self.nulls = thrift.integer()?,
                (8, 5, Kind::Integer) => self.levels = thrift.integer()?,
                (8, 6, Kind::Integer) => self.repeated = thrift.integer()?,
                (8, 7, Kind::Flag(compressed)) => self.plain = !compressed,
                _ => return Ok(false),
            }
            Ok(true)
        })
    }

    /// The header of a page of values; `None` for pages of another kind.
    fn header(&self, at: usize, packed: usize, snappy: bool) -> Result<Option<Header>> {
        let number = |number: i64, what: &str| {
            let number = i32::try_from(number).ok().and_then(|number| usize::try_from(number).ok());
            number.ok_or_else(|| format!("a page does not say {what}, or nothing that can be"))
        };
        let body = match self.kind {
            0 if self.packed_levels => Body::OnePackedLevels,
            0 => Body::One,
            1 => return Ok(None),
            2 => Body::Dictionary,
            3 if self.repeated == 0 => Body::Two {
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
        let encoding = Encoded::of(self.encoding)?;
        Ok(Some(Header { at, packed, unpacked, values, encoding, body }))
    }
}

impl PageReader for Pages {
    fn get_next_page(&mut self) -> parquet::errors::Result<Option<Page>> {
        let Some(header) = self.pages.pop_front() else { return Ok(None) };
        self.page(&header).map(Some).map_err(ParquetError::General)
    }

    fn peek_next_page(&mut self) -> parquet::errors::Result<Option<PageMetadata>> {
        Ok(self.pages.front().map(|page| {
            let dictionary = page.body == Body::Dictionary;
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
