//! Reading of whole files.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};

use super::content_error::ContentError;
use crate::error::{Error, Result};

/// Most bytes read from a pipe, whose length is unknown before its end: 256 MiB, or 16 million
/// points of single precision. Chosen by hand.
pub const MAX_PIPE_BYTES: u64 = 256 << 20;

/// Opens a regular file, and returns its first bytes; `None` for a pipe.
///
/// # Errors
/// [`Error::Io`] as [`load`].
pub(super) fn open(path: &Path, count: usize) -> Result<Option<(File, Vec<u8>)>> {
    let refuse = |source| Error::io(path, source);
    // Before opening, which blocks on a pipe without a writer.
    if !std::fs::metadata(path).map_err(refuse)?.is_file() {
        return Ok(None);
    }
    let mut file = File::open(path).map_err(refuse)?;
    let mut start = Vec::new();
    (&mut file).take(count as u64).read_to_end(&mut start).map_err(refuse)?;
    Ok(Some((file, start)))
}

/// The content of a file: unpacked where it was gzip, and UTF-8 where it was UTF-16.
pub(super) struct Unpacked {
    pub content: Vec<u8>,
    /// The name of the file, without `.gz`.
    pub name: PathBuf,
}

/// Reads a file as [`load`], and unpacks it.
pub(super) fn load_unpacked(path: &Path) -> Result<Unpacked> {
    let mut content = load(path)?;
    let mut name = path.to_path_buf();
    if is_gzip(&content) {
        content = gunzip(&content).map_err(|fault| fault.into_error(path))?;
        if content.is_empty() {
            return Err(ContentError::new("gzip: is empty").into_error(path));
        }
        if super::format::extension(path) == "gz" {
            name = path.with_extension("");
        }
    }
    Ok(Unpacked { content: decode_utf16(content), name })
}

/// Returns whether a file that begins so is gzip.
pub(super) fn is_gzip(content: &[u8]) -> bool {
    content.starts_with(b"\x1f\x8b")
}

/// Unpacks gzip: at most 32 times its bytes and 64 MiB, because the true size stands nowhere.
/// Chosen by hand; the tables of text that were tried are packed to a tenth and more.
#[cfg(feature = "formats")]
fn gunzip(packed: &[u8]) -> Result<Vec<u8>, ContentError> {
    let limit = packed.len().saturating_mul(32).saturating_add(64 << 20);
    let mut content = Vec::new();
    let mut unpacking = flate2::read::MultiGzDecoder::new(packed).take(limit as u64 + 1);
    let read = unpacking.read_to_end(&mut content);
    read.map_err(|error| {
        ContentError::new(format!("gzip: cannot be unpacked: {error}; fetch or pack it again"))
    })?;
    if content.len() > limit {
        let what = format!("gzip: unpacks to more than {limit} bytes: unpack it with gunzip first");
        return Err(ContentError::new(what));
    }
    Ok(content)
}

#[cfg(not(feature = "formats"))]
fn gunzip(_packed: &[u8]) -> Result<Vec<u8>, ContentError> {
    Err(ContentError::new(
        "gzip: this build does not unpack it (feature formats): unpack it with gunzip first",
    ))
}

/// Returns UTF-16 with a byte order mark as UTF-8, as some spreadsheets and shells write text.
fn decode_utf16(content: Vec<u8>) -> Vec<u8> {
    let number = match content.get(..2) {
        Some([0xff, 0xfe]) => u16::from_le_bytes,
        Some([0xfe, 0xff]) => u16::from_be_bytes,
        _ => return content,
    };
    let units = content[2..].as_chunks::<2>().0.iter().map(|&pair| number(pair));
    let letters = char::decode_utf16(units).map(|letter| letter.unwrap_or('\u{fffd}'));
    letters.collect::<String>().into_bytes()
}

/// Reads a file or a pipe that is not empty.
///
/// Devices are refused: they have no end to check a header against. A file that grows during the
/// read is read up to the limit of a pipe.
pub(super) fn load(path: &Path) -> Result<Vec<u8>> {
    let refuse = |source| Error::io(path, source);
    // Before opening, which blocks on a pipe without a writer.
    let kind = std::fs::metadata(path).map_err(refuse)?;
    if !kind.is_file() && !is_pipe(&kind) {
        let what =
            if kind.is_dir() { "is a directory" } else { "is neither a regular file nor a pipe" };
        return Err(refuse(io::Error::new(ErrorKind::InvalidInput, what)));
    }
    let mut file = File::open(path).map_err(refuse)?;
    let limit = kind.len().max(MAX_PIPE_BYTES);
    let mut content = Vec::new();
    // A file is read at once; a pipe doubles the buffer up to the limit.
    let mut room = (kind.len() + 1).max(1 << 16);
    loop {
        let more = usize::try_from(room).unwrap_or(usize::MAX);
        content.try_reserve_exact(more).map_err(|error| refuse(io::Error::other(error)))?;
        let read = (&mut file).take(room).read_to_end(&mut content).map_err(refuse)?;
        if (read as u64) < room {
            break;
        }
        let there = content.len() as u64;
        if there > limit {
            let what = format!("a pipe is read up to {limit} bytes, and it has more: use a file");
            return Err(ContentError::new(what).into_error(path));
        }
        room = there.min(limit + 1 - there);
    }
    if content.is_empty() {
        return Err(ContentError::new("is empty").into_error(path));
    }
    Ok(content)
}

#[cfg(unix)]
fn is_pipe(kind: &std::fs::Metadata) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&kind.file_type())
}

#[cfg(not(unix))]
fn is_pipe(_kind: &std::fs::Metadata) -> bool {
    false
}
