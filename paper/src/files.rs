//! Result files, replaced as a whole.

use std::io::Write;
use std::path::Path;

use cfreg::{Error, Result};

/// Writes `content` to `path` through a temporary file beside it; creates missing folders.
///
/// # Errors
/// [`Error::Io`].
pub(crate) fn write_bytes(path: &Path, content: &[u8]) -> Result<()> {
    let write = || {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = folder.unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder)?;
        let mut file = tempfile::Builder::new().tempfile_in(folder)?;
        file.write_all(content)?;
        file.persist(path).map_err(|error| error.error)?;
        Ok(())
    };
    write().map_err(|error| Error::io(path, error))
}
