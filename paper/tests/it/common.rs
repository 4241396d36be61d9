//! The folder of real scans.

use std::path::{Path, PathBuf};

/// `CFREG_DATA`, else `../shared/data` beside the repository. `None` where there is neither, after a
/// line that says so.
pub fn shared_data() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let folder = std::env::var_os("CFREG_DATA").map_or_else(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no real scans at {}, set CFREG_DATA", folder.display());
    None
}
