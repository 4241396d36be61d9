//! Reading of whole files.

use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use super::content_error::ContentError;
use crate::error::{Error, Result};

/// Most bytes read from a pipe, whose length is unknown before its end: 256 MiB, or 16 million
/// points of single precision. Chosen by hand.
pub const MAX_PIPE_BYTES: u64 = 256 << 20;

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
