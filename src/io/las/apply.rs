//! Moving of LAS and LAZ: coordinates, normals among the extra bytes and the lines of wave packets
//! change; point format, scale, records of the header and all else stay.

use std::io::{Read, Seek, SeekFrom, Write};

use laz::{LazVlr, LazVlrBuilder};

use super::fields::{self, LasField};
use super::header::{LasHeader, POINT_SIZES, at, number};
use super::records::{LazPacker, laz_record};
use super::write::rounding_text;
use super::{coordinate, records};
use crate::cloud::Transform;
use crate::io::apply::{Moved, MovedBounds, Output, WriteFault};
use crate::io::columns::slot;
use crate::io::content_error::ContentError;
use crate::io::scalar::Scalar;
use crate::math::Vec3;

/// Moves the points of a file, and writes them as LAZ or as LAS.
pub(in crate::io) fn apply<R: Read + Seek + Send + Sync>(
    mut source: R,
    transform: &Transform,
    is_laz: bool,
    out: &mut Output<'_>,
) -> Result<Moved, WriteFault> {
    let header = LasHeader::read(&mut source)?;
    let mut moved = Moved { points: header.count, ..Moved::default() };
    let frame = Frame::new(&header, transform)?;
    let tail = tail(&header, &mut source)?;
    let mut head = head(&header, &frame, is_laz, &mut moved)?;
    out.write_all(&head)?;
    let motion = Motion::new(&header, transform, frame);
    let bounds = match is_laz {
        false => {
            let mut write = |record: &[u8]| out.write_all(record);
            motion.write(&mut source, &header, &mut write)?
        }
        true => {
            let mut packer = LazPacker::new(&mut *out, vlr(&header)?)?;
            let mut write = |record: &[u8]| packer.push(record);
            let bounds = motion.write(&mut source, &header, &mut write)?;
            packer.finish()?;
            bounds
        }
    };
    let end = out.stream_position()?;
    if let Some(first) = tail {
        source.seek(SeekFrom::Start(first))?;
        std::io::copy(&mut source, out)?;
    }
    finish_header(&mut head, &header, &bounds, tail.map(|first| (first, end)));
    out.seek(SeekFrom::Start(0))?;
    out.write_all(&head)?;
    out.seek(SeekFrom::End(0))?;
    let scale = header.scale.iter().fold(0.0, |most: f64, scale| most.max(scale.abs()));
    moved.differences.change(rounding_text(scale));
    Ok(moved)
}

/// Scale and offset of the coordinates that are written.
#[derive(Clone, Copy)]
struct Frame {
    scale: Vec3,
    offset: Vec3,
}

/// Largest stored coordinate, with room for points a little outside the box of the header.
const MAX_STORED: f64 = 2.1e9;

impl Frame {
    /// Keeps the offset of the file where the moved box of its header fits; else takes a round
    /// one near the middle of it.
    fn new(header: &LasHeader, transform: &Transform) -> Result<Frame, ContentError> {
        let value = |k: usize| number(&header.bytes, at::BOUNDS + 8 * k, Scalar::F64);
        let sides = [0, 2, 4].map(|k| [value(k + 1), value(k)]);
        let mut bounds = MovedBounds::new();
        for corner in 0..8 {
            let place = [0, 1, 2].map(|axis| sides[axis][corner >> axis & 1]);
            bounds.include(transform.apply(place));
        }
        let (low, high) = (bounds.low(), bounds.high());
        let mut frame = Frame { scale: header.scale, offset: header.offset };
        for axis in 0..3 {
            let scale = header.scale[axis].abs();
            let fits = |x: f64, offset: f64| ((x - offset) / scale).abs() < MAX_STORED;
            if fits(low[axis], frame.offset[axis]) && fits(high[axis], frame.offset[axis]) {
                continue;
            }
            let middle = (low[axis] + high[axis]) / 2.0;
            frame.offset[axis] = if middle.is_finite() { middle.round() } else { 0.0 };
            if !(fits(low[axis], frame.offset[axis]) && fits(high[axis], frame.offset[axis])) {
                let what = format!(
                    "the moved points span {} units, too many for the scale {scale} of the file: \
                     write another format, such as PLY",
                    high[axis] - low[axis]
                );
                return Err(ContentError::new(what));
            }
        }
        Ok(frame)
    }
}

/// The numbers of a record that move.
struct Motion<'a> {
    transform: &'a Transform,
    frame: Frame,
    normals: Option<[LasField; 3]>,
    /// The byte of x(t) in the wave packet.
    line: Option<usize>,
}

impl<'a> Motion<'a> {
    fn new(header: &LasHeader, transform: &'a Transform, frame: Frame) -> Self {
        let mut normals = [None, None, None];
        for field in fields::extra(header) {
            if let Some(slot) = slot(&field.name).filter(|slot| *slot >= 3) {
                normals[slot - 3] = Some(field);
            }
        }
        let [x, y, z] = normals;
        let line = header.has_waveforms().then(|| {
            let extra = if matches!(header.format, 10) { 38 } else { 30 };
            17 + match header.format {
                4 => 28,
                5 => 34,
                _ => extra,
            }
        });
        Motion { transform, frame, normals: x.zip(y).zip(z).map(|((x, y), z)| [x, y, z]), line }
    }

    /// Writes the moved records, and returns the box of the stored points.
    fn write<R: Read + Seek + Send + Sync>(
        &self,
        source: &mut R,
        header: &LasHeader,
        write: &mut dyn FnMut(&[u8]) -> std::io::Result<()>,
    ) -> Result<MovedBounds, WriteFault> {
        let (mut bounds, mut record) = (MovedBounds::new(), Vec::new());
        let mut failed = None;
        let done = records::for_each(source, header, |number, own| {
            record.clear();
            record.extend_from_slice(own);
            bounds.include(self.apply(header, &mut record, number)?);
            write(&record).map_err(|error| {
                failed = Some(error);
                ContentError::new("cannot be written")
            })
        });
        match failed {
            Some(error) => Err(error.into()),
            None => done.map(|()| bounds).map_err(WriteFault::from),
        }
    }

    /// Moves a record, and returns its stored place.
    fn apply(
        &self,
        header: &LasHeader,
        record: &mut [u8],
        number: u64,
    ) -> Result<Vec3, ContentError> {
        let place = [0, 1, 2].map(|axis| coordinate(header, record, axis));
        let moved = self.transform.apply(place);
        let mut stored = [0.0; 3];
        for axis in 0..3 {
            let (scale, offset) = (self.frame.scale[axis], self.frame.offset[axis]);
            let whole = ((moved[axis] - offset) / scale).round();
            if whole.abs() > f64::from(i32::MAX) {
                let what = format!(
                    "point {number} lies outside the bounds that the header states, too far for \
                     the moved file: write another format, such as PLY"
                );
                return Err(ContentError::new(what));
            }
            Scalar::I32.write(&mut record[4 * axis..], false, whole);
            stored[axis] = whole * scale + offset;
        }
        if let Some(normals) = &self.normals {
            let normal = self.transform.rotate([0, 1, 2].map(|k| normals[k].value(record)));
            (0..3).for_each(|k| normals[k].store(record, normal[k]));
        }
        if let Some(line) = self.line.filter(|line| line + 12 <= record.len()) {
            let own = [0, 1, 2].map(|k| Scalar::F32.read(&record[line + 4 * k..], false));
            let turned = self.transform.rotate(own).map(|x| x * self.transform.scale);
            (0..3).for_each(|k| Scalar::F32.write(&mut record[line + 4 * k..], false, turned[k]));
        }
        Ok(stored)
    }
}

/// Returns the byte of the source at which wave packets or extended records begin, after the points.
fn tail<R: Seek>(header: &LasHeader, source: &mut R) -> Result<Option<u64>, WriteFault> {
    let end = source.seek(SeekFrom::End(0))?;
    let minor = header.bytes[at::MINOR_VERSION];
    let start = |place: usize, since: u8| {
        let fits = minor >= since && header.header_size >= place + 8;
        let bytes = header.bytes.get(place..place + 8).filter(|_| fits)?;
        let value = u64::from_le_bytes(*bytes.first_chunk()?);
        (value > header.points() && value < end).then_some(value)
    };
    let has_records = number(&header.bytes, at::EVLR_COUNT, Scalar::U32) > 0.0;
    let records = start(at::EVLR_START, 4).filter(|_| has_records);
    Ok([start(at::WAVEFORMS, 3), records].into_iter().flatten().min())
}

/// Returns the description of the compression of new points.
fn vlr(header: &LasHeader) -> Result<LazVlr, ContentError> {
    let extra = header.record_size - POINT_SIZES[usize::from(header.format)];
    let builder = LazVlrBuilder::default().with_point_format(header.format, extra as u16);
    builder.map(LazVlrBuilder::build).map_err(|error| ContentError::new(error.to_string()))
}

/// Returns the header and the records before the points of the file that is written.
fn head(
    header: &LasHeader,
    frame: &Frame,
    is_laz: bool,
    moved: &mut Moved,
) -> Result<Vec<u8>, WriteFault> {
    let mut head = header.bytes[..header.header_size].to_vec();
    let mut count = 0u32;
    for vlr in &header.vlrs {
        match header.user(vlr) {
            LazVlr::USER_ID => continue,
            "copc" => {
                moved.differences.leave_out("the index of COPC, whose cells do not move");
                continue;
            }
            _ => {}
        }
        head.extend_from_slice(&header.bytes[vlr.start..vlr.end]);
        count += 1;
    }
    if is_laz {
        head.extend(laz_record(&vlr(header)?)?);
        count += 1;
    }
    // Bytes of others between the records and the points.
    let last = header.vlrs.last().map_or(header.header_size, |vlr| vlr.end);
    head.extend_from_slice(&header.bytes[last..]);
    let points = head.len() as u32;
    head[at::POINTS..at::POINTS + 4].copy_from_slice(&points.to_le_bytes());
    head[at::VLR_COUNT..at::VLR_COUNT + 4].copy_from_slice(&count.to_le_bytes());
    head[at::FORMAT] = header.format | if is_laz { 0x80 } else { 0 };
    for axis in 0..3 {
        Scalar::F64.write(&mut head[at::OFFSET + 8 * axis..], false, frame.offset[axis]);
    }
    if frame.offset != header.offset {
        moved.differences.change(format!("the offset of the coordinates is {:?}", frame.offset));
    }
    Ok(head)
}

/// Stores the bounds of the points, and where what follows them begins.
fn finish_header(
    head: &mut [u8],
    header: &LasHeader,
    bounds: &MovedBounds,
    tail: Option<(u64, u64)>,
) {
    for axis in 0..3 {
        for (side, value) in [bounds.high()[axis], bounds.low()[axis]].into_iter().enumerate() {
            let value = if value.is_finite() { value } else { 0.0 };
            Scalar::F64.write(&mut head[at::BOUNDS + 8 * (2 * axis + side)..], false, value);
        }
    }
    let Some((first, end)) = tail else { return };
    for (place, since) in [(at::WAVEFORMS, 3), (at::EVLR_START, 4)] {
        let fits = head[at::MINOR_VERSION] >= since && header.header_size >= place + 8;
        let own = head.get(place..place + 8).and_then(<[u8]>::first_chunk);
        let own = own.copied().map(u64::from_le_bytes).unwrap_or_default();
        if fits && own >= first {
            head[place..place + 8].copy_from_slice(&(own - first + end).to_le_bytes());
        }
    }
}
