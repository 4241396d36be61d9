//! What several test files need.
#![allow(dead_code)] // Each test file uses a part of it.

pub mod compare;
pub mod files;
pub mod golden;
pub mod scans;
pub mod sides;

use std::path::{Path, PathBuf};

/// The folder of real scans: `CFREG_DATA`, else `../shared/data` beside the
/// repository. `None` where there is neither, after a line that says so.
pub fn shared_data() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("CFREG_DATA").map_or_else(beside, PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: no real scans at {}, set CFREG_DATA", folder.display());
    None
}
