//! The header of LAS and its records of variable length (ASPRS LAS 1.4-R15).

use std::io::{Read, Seek, SeekFrom};

use crate::io::content_error::ContentError;
use crate::io::scalar::Scalar;
use crate::math::Vec3;

/// Bytes of the header of versions 1.0 to 1.2, and the least of all.
const SMALLEST: usize = 227;
/// Bytes of the header of version 1.4.
pub(super) const HEADER_1_4: usize = 375;
/// Bytes before the content of a record of variable length.
pub(super) const VLR_HEADER: usize = 54;
/// Bytes of a point of each format, without extra bytes.
pub(super) const POINT_SIZES: [usize; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Byte positions of fields of the header.
pub(super) mod at {
    pub const MINOR_VERSION: usize = 25;
    pub const HEADER_SIZE: usize = 94;
    pub const POINTS: usize = 96;
    pub const VLR_COUNT: usize = 100;
    pub const FORMAT: usize = 104;
    pub const RECORD_SIZE: usize = 105;
    pub const LEGACY_COUNT: usize = 107;
    pub const SCALE: usize = 131;
    pub const OFFSET: usize = 155;
    pub const BOUNDS: usize = 179;
    pub const WAVEFORMS: usize = 227;
    pub const EVLR_START: usize = 235;
    pub const EVLR_COUNT: usize = 243;
    pub const COUNT: usize = 247;
}

/// A record of variable length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vlr {
    /// The byte at which its header begins, and that after its content.
    pub start: usize,
    pub end: usize,
    pub id: u16,
}

/// All bytes before the points, and what they say.
#[derive(Debug, Clone)]
pub(super) struct LasHeader {
    pub bytes: Vec<u8>,
    /// Bytes of the header alone.
    pub header_size: usize,
    pub format: u8,
    pub is_compressed: bool,
    pub record_size: usize,
    pub count: u64,
    pub scale: Vec3,
    pub offset: Vec3,
    pub vlrs: Vec<Vlr>,
    /// Bytes of the whole file.
    pub file_size: u64,
}

impl LasHeader {
    /// Reads the header and the records before the points.
    pub fn read<R: Read + Seek>(source: &mut R) -> Result<LasHeader, ContentError> {
        let refuse = |error: std::io::Error| ContentError::new(format!("cannot be read: {error}"));
        let file_size = source.seek(SeekFrom::End(0)).map_err(refuse)?;
        source.seek(SeekFrom::Start(0)).map_err(refuse)?;
        let mut bytes = Vec::new();
        source.by_ref().take(SMALLEST as u64).read_to_end(&mut bytes).map_err(refuse)?;
        if bytes.len() < SMALLEST || !bytes.starts_with(b"LASF") {
            let what = format!("a header of {SMALLEST} bytes that begins with LASF is expected");
            return Err(ContentError::byte(0, what));
        }
        let header_size = number(&bytes, at::HEADER_SIZE, Scalar::U16) as usize;
        let points = number(&bytes, at::POINTS, Scalar::U32) as u64;
        if header_size < SMALLEST || points < header_size as u64 || points > file_size {
            let what = format!(
                "the header claims {header_size} bytes and points from byte {points}, in a file of \
                 {file_size} bytes"
            );
            return Err(ContentError::byte(at::HEADER_SIZE, what));
        }
        source.by_ref().take(points - SMALLEST as u64).read_to_end(&mut bytes).map_err(refuse)?;
        LasHeader::parse(bytes, header_size, file_size)
    }

    fn parse(bytes: Vec<u8>, header_size: usize, file_size: u64) -> Result<Self, ContentError> {
        let stored = bytes[at::FORMAT];
        let format = stored & 0x3f;
        let record_size = number(&bytes, at::RECORD_SIZE, Scalar::U16) as usize;
        let Some(&smallest) = POINT_SIZES.get(usize::from(format)) else {
            let what = format!("points of format {format}, formats 0 to 10 are read");
            return Err(ContentError::byte(at::FORMAT, what));
        };
        if record_size < smallest {
            let what =
                format!("points of format {format} take {smallest} bytes, not {record_size}");
            return Err(ContentError::byte(at::RECORD_SIZE, what));
        }
        let three = |start: usize| [0, 1, 2].map(|k| number(&bytes, start + 8 * k, Scalar::F64));
        let (scale, offset) = (three(at::SCALE), three(at::OFFSET));
        if scale.iter().any(|x| !x.is_finite() || *x == 0.0)
            || offset.iter().any(|x| !x.is_finite())
        {
            let what = format!("the scale {scale:?} or the offset {offset:?} is not finite or 0");
            return Err(ContentError::byte(at::SCALE, what));
        }
        let mut count = number(&bytes, at::LEGACY_COUNT, Scalar::U32) as u64;
        if bytes[at::MINOR_VERSION] >= 4 && header_size >= HEADER_1_4 && bytes.len() >= HEADER_1_4 {
            count = bytes[at::COUNT..]
                .first_chunk()
                .map_or(count, |own| u64::from_le_bytes(*own).max(count));
        }
        let vlrs = vlrs(&bytes, header_size)?;
        let is_compressed = stored & 0xc0 != 0;
        Ok(LasHeader {
            bytes,
            header_size,
            format,
            is_compressed,
            record_size,
            count,
            scale,
            offset,
            vlrs,
            file_size,
        })
    }

    /// Returns the content of the record of that user and number.
    pub fn vlr(&self, user: &str, id: u16) -> Option<&[u8]> {
        let found = self.vlrs.iter().find(|vlr| vlr.id == id && self.user(vlr) == user)?;
        self.bytes.get(found.start + VLR_HEADER..found.end)
    }

    /// Returns the user of a record.
    pub fn user(&self, vlr: &Vlr) -> &str {
        let bytes = &self.bytes[vlr.start + 2..vlr.start + 18];
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
        std::str::from_utf8(&bytes[..end]).unwrap_or_default()
    }

    /// Returns the byte at which the points begin.
    pub fn points(&self) -> u64 {
        self.bytes.len() as u64
    }

    /// Returns whether the points have wave packets, of formats 4, 5, 9 and 10.
    pub fn has_waveforms(&self) -> bool {
        matches!(self.format, 4 | 5 | 9 | 10)
    }
}

/// Reads a number of the header; 0 beyond its end.
pub(super) fn number(bytes: &[u8], at: usize, scalar: Scalar) -> f64 {
    scalar.read(bytes.get(at..).unwrap_or_default(), false)
}

/// Lists the records between the header and the points.
fn vlrs(bytes: &[u8], header_size: usize) -> Result<Vec<Vlr>, ContentError> {
    let count = number(bytes, at::VLR_COUNT, Scalar::U32) as usize;
    let (mut vlrs, mut start) = (Vec::new(), header_size);
    for index in 0..count {
        let length = number(bytes, start + 20, Scalar::U16) as usize;
        let end = start + VLR_HEADER + length;
        if end > bytes.len() {
            let what = format!("record {index} of {count} ends beyond the start of the points");
            return Err(ContentError::byte(start, what));
        }
        vlrs.push(Vlr { start, end, id: number(bytes, start + 18, Scalar::U16) as u16 });
        start = end;
    }
    Ok(vlrs)
}
