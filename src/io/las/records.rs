//! The records of the points of LAS, and of LAZ unpacked.
//!
//! The crate `laz` packs and unpacks points; headers and records are read here, so that a file is
//! written again with all its bytes but those that move. `laz` takes sizes in the file for memory
//! without a check and may panic on damaged data: sizes are checked here first, and a panic becomes
//! an error.

use std::io::{BufReader, Read, Seek, SeekFrom, Write};

use laz::{LasZipCompressor, LasZipDecompressor, LazItemType, LazVlr};

use super::header::{LasHeader, VLR_HEADER};
use crate::io::content_error::ContentError;
use crate::io::guard::guard;

/// Fills a buffer with the next records.
type Unpack<'a> = Box<dyn FnMut(&mut [u8]) -> std::io::Result<()> + 'a>;

/// Bytes of records that are read at once. Chosen by hand.
const BATCH: usize = 1 << 17;
/// Most bytes of a compressed point: `laz` takes some 10 kB for each of them. Chosen by hand; the
/// formats have up to 67, and extra bytes come to a few dozen.
const MAX_PACKED_SIZE: usize = 1024;
/// Points of LAZ that a byte may hold at most: points that differ take more than a bit each.
/// Chosen by hand.
const MAX_POINTS_PER_BYTE: u64 = 16;

/// Bytes of stack for unpacking, taken from memory as they are used. `laz` calls itself once for each
/// change of the sequence of GPS times, some hundred times a byte in damaged files, with 80 bytes of
/// stack each; whole files have hardly any.
const UNPACK_STACK: usize = 1 << 28;

/// Returns the record of LASzip with its header.
pub(super) fn laz_record(vlr: &LazVlr) -> std::io::Result<Vec<u8>> {
    let mut content = Vec::new();
    vlr.write_to(&mut content)?;
    let mut record = vec![0; VLR_HEADER];
    record[2..2 + LazVlr::USER_ID.len()].copy_from_slice(LazVlr::USER_ID.as_bytes());
    record[18..20].copy_from_slice(&LazVlr::RECORD_ID.to_le_bytes());
    record[20..22].copy_from_slice(&(content.len() as u16).to_le_bytes());
    record[22..22 + LazVlr::DESCRIPTION.len()].copy_from_slice(LazVlr::DESCRIPTION.as_bytes());
    record.extend(content);
    Ok(record)
}

/// Packs records as LAZ.
pub(super) struct LazPacker<'a, W: Write + Seek + Send + Sync>(LasZipCompressor<'a, W>);

impl<'a, W: Write + Seek + Send + Sync + 'a> LazPacker<'a, W> {
    pub fn new(out: W, vlr: LazVlr) -> Result<Self, ContentError> {
        let packer = LasZipCompressor::new(out, vlr);
        packer.map(LazPacker).map_err(|error| ContentError::new(error.to_string()))
    }

    pub fn push(&mut self, record: &[u8]) -> std::io::Result<()> {
        guard(|| self.0.compress_one(record)).unwrap_or_else(cannot_pack)
    }

    pub fn finish(mut self) -> std::io::Result<()> {
        guard(|| self.0.done()).unwrap_or_else(cannot_pack)
    }
}

/// Tells a panic of `laz`: it subtracts times of arbitrary bits, which overflow where that is checked.
fn cannot_pack(what: String) -> std::io::Result<()> {
    let what = format!("the points cannot be packed ({what}): write LAS instead of LAZ");
    Err(std::io::Error::other(what))
}

/// Calls `use_record` with the number and the bytes of each point.
pub(super) fn for_each<R: Read + Seek + Send + Sync>(
    source: R,
    header: &LasHeader,
    mut use_record: impl FnMut(u64, &[u8]) -> Result<(), ContentError>,
) -> Result<(), ContentError> {
    let mut source = BufReader::with_capacity(1 << 18, source);
    source.seek(SeekFrom::Start(header.points())).map_err(|error| cut_short(0, header, &error))?;
    let size = header.record_size;
    let mut unpack: Unpack<'_> = if header.is_compressed {
        let vlr = laz_vlr(header)?;
        check_sizes(&mut source, header, &vlr)?;
        let decompressor = guard(|| LasZipDecompressor::new(source, vlr));
        let mut decompressor = decompressor
            .and_then(|made| made.map_err(|error| error.to_string()))
            .map_err(|what| ContentError::byte(header.bytes.len(), damaged(&what)))?;
        Box::new(move |batch| {
            let unpacked = on_large_stack(|| guard(|| decompressor.decompress_many(batch)))?;
            unpacked.unwrap_or_else(|what| Err(std::io::Error::other(what)))
        })
    } else {
        check_plain(header)?;
        Box::new(move |batch| source.read_exact(batch))
    };
    let most = (BATCH / size).max(1) as u64;
    let mut batch = vec![0; most.min(header.count) as usize * size];
    let mut first = 0;
    while first < header.count {
        let count = (header.count - first).min(most);
        let records = &mut batch[..count as usize * size];
        unpack(records).map_err(|error| cut_short(first, header, &error))?;
        for (record, number) in records.chunks_exact(size).zip(first..) {
            use_record(number, record)?;
        }
        first += count;
    }
    Ok(())
}

/// Runs `work` on a thread of its own with [`UNPACK_STACK`].
fn on_large_stack<T: Send>(work: impl FnOnce() -> T + Send) -> std::io::Result<T> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(UNPACK_STACK);
        let done = thread.spawn_scoped(scope, work)?.join();
        done.map_err(|_| std::io::Error::other("the thread that unpacks has ended"))
    })
}

fn cut_short(first: u64, header: &LasHeader, error: &std::io::Error) -> ContentError {
    ContentError::new(format!(
        "points from {first} of {} on cannot be read ({error}): the file is damaged or was cut \
         short, fetch it again",
        header.count
    ))
}

fn damaged(what: &str) -> String {
    format!("the compressed points are damaged ({what}): fetch the file again")
}

fn check_plain(header: &LasHeader) -> Result<(), ContentError> {
    let left = header.file_size - header.points();
    let there = left / header.record_size as u64;
    if there >= header.count {
        return Ok(());
    }
    let what = format!(
        "the header claims {} points of {} bytes, and {left} bytes are left, enough for {there}: \
         the file was cut short, fetch it again",
        header.count, header.record_size
    );
    Err(ContentError::byte(header.bytes.len(), what))
}

/// Reads the description of the compression, and checks it against the records.
pub(super) fn laz_vlr(header: &LasHeader) -> Result<LazVlr, ContentError> {
    let refuse = |what: String| ContentError::new(format!("the record of LASzip {what}"));
    let content = header
        .vlr(LazVlr::USER_ID, LazVlr::RECORD_ID)
        .ok_or_else(|| refuse("is missing, though the points are compressed".into()))?;
    let vlr = LazVlr::read_from(content).map_err(|error| refuse(format!("is damaged: {error}")))?;
    let fits = vlr.items().iter().all(|item| match item.item_type() {
        LazItemType::Byte(_) | LazItemType::Byte14(_) => item.size() > 0,
        LazItemType::Point10 => item.size() == 20,
        LazItemType::GpsTime | LazItemType::RGBNIR14 => item.size() == 8,
        LazItemType::RGB12 | LazItemType::RGB14 => item.size() == 6,
        LazItemType::WavePacket13 | LazItemType::WavePacket14 => item.size() == 29,
        LazItemType::Point14 => item.size() == 30,
    });
    let total: usize = vlr.items().iter().map(|item| usize::from(item.size())).sum();
    if total > MAX_PACKED_SIZE {
        return Err(refuse(format!(
            "describes {total} bytes a point, up to {MAX_PACKED_SIZE} are read"
        )));
    }
    if !fits || total != header.record_size {
        let size = header.record_size;
        return Err(refuse(format!("describes {total} bytes a point, and points have {size}")));
    }
    Ok(vlr)
}

/// Returns the layers of bytes that a chunk has for an item; `None` for items without layers.
fn layers(item: LazItemType) -> Option<usize> {
    match item {
        LazItemType::Point14 => Some(9),
        LazItemType::RGB14 | LazItemType::WavePacket14 => Some(1),
        LazItemType::RGBNIR14 => Some(2),
        LazItemType::Byte14(count) => Some(usize::from(count)),
        _ => None,
    }
}

/// Checks the sizes in the compressed points against the file, before `laz` takes memory for them.
fn check_sizes<R: Read + Seek>(
    source: &mut R,
    header: &LasHeader,
    vlr: &LazVlr,
) -> Result<(), ContentError> {
    let (start, end) = (header.points(), header.file_size);
    let refuse = |at: u64, what: String| ContentError::byte(at as usize, damaged(&what));
    if header.count > (end - start).saturating_mul(MAX_POINTS_PER_BYTE) {
        let what = format!("{} points in {} bytes", header.count, end - start);
        return Err(refuse(start, what));
    }
    let read = |source: &mut R, at: u64, bytes: &mut [u8]| {
        let done = source.seek(SeekFrom::Start(at)).and_then(|_| source.read_exact(bytes));
        done.map_err(|error| refuse(at, error.to_string()))
    };
    // The place of the table of chunks; where it could not be written, it stands at the end.
    let mut word = [0; 8];
    read(source, start, &mut word)?;
    let mut table = i64::from_le_bytes(word);
    if table <= start as i64 {
        read(source, end.saturating_sub(8), &mut word)?;
        table = i64::from_le_bytes(word);
    }
    if table > start as i64 && (table as u64).saturating_add(8) <= end {
        read(source, table as u64, &mut word)?;
        let chunks = u64::from(u32::from_le_bytes([word[4], word[5], word[6], word[7]]));
        // The first point of a chunk is not compressed.
        if chunks > (end - start) / header.record_size as u64 + 1 {
            return Err(refuse(table as u64, format!("{chunks} chunks")));
        }
    }
    let layers = vlr.items().iter().map(|item| layers(item.item_type())).sum::<Option<usize>>();
    if let Some(layers) = layers {
        check_layers(source, header, layers, read)?;
    }
    source.seek(SeekFrom::Start(start)).map(drop).map_err(|error| refuse(start, error.to_string()))
}

/// Walks over the chunks of layered compression: a point as it is, the count of points, the sizes
/// of the layers, and these.
fn check_layers<R: Read + Seek>(
    source: &mut R,
    header: &LasHeader,
    layers: usize,
    read: impl Fn(&mut R, u64, &mut [u8]) -> Result<(), ContentError>,
) -> Result<(), ContentError> {
    let end = header.file_size;
    let mut sizes = vec![0; 4 + 4 * layers];
    let (mut at, mut points) = (header.points() + 8, 0u64);
    while points < header.count {
        read(source, at + header.record_size as u64, &mut sizes)?;
        let mut words =
            sizes.as_chunks::<4>().0.iter().map(|word| u64::from(u32::from_le_bytes(*word)));
        let count = words.next().unwrap_or_default();
        let next = at + header.record_size as u64 + sizes.len() as u64 + words.sum::<u64>();
        if next > end || count == 0 {
            let what = format!("a chunk of {count} points claims to end at byte {next} of {end}");
            return Err(ContentError::byte(at as usize, damaged(&what)));
        }
        (at, points) = (next, points + count);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use laz::LazVlrBuilder;

    use super::*;

    /// Differences of times of arbitrary bits wrap around, and come back.
    #[test]
    fn times_of_any_bits_are_packed() {
        let vlr = || LazVlrBuilder::default().with_point_format(1, 0).unwrap().build();
        let times = [0, i64::MIN, i64::MAX, -1, 1 << 40, i64::MIN + 1, 0x7ff0_0000_0000_0000];
        let mut records = Vec::new();
        for time in times.into_iter().cycle().take(50) {
            records.extend([0; 20]);
            records.extend(time.to_le_bytes());
        }
        let mut packed = Cursor::new(Vec::new());
        let mut packer = LazPacker::new(&mut packed, vlr()).unwrap();
        records.chunks_exact(28).for_each(|record| packer.push(record).unwrap());
        packer.finish().unwrap();
        packed.set_position(0);
        let mut unpacked = vec![0; records.len()];
        LasZipDecompressor::new(packed, vlr()).unwrap().decompress_many(&mut unpacked).unwrap();
        assert_eq!(unpacked, records);
    }

    #[test]
    fn panics_of_the_packer_are_told() {
        let what = cannot_pack("attempt to subtract".into()).unwrap_err().to_string();
        assert!(what.contains("attempt to subtract") && what.contains("write LAS"), "{what}");
    }
}
