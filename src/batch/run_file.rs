//! The file beside an output that records the settings of its run.

use std::path::{Path, PathBuf};

use serde_json::Value;

/// Whether this is what a run was asked for.
pub(super) fn is_run_header(value: &Value) -> bool {
    ["cfreg", "list", "pairs", "method"].iter().all(|name| value.get(name).is_some())
}

/// What is added to the name of an output that cannot hold what it was asked for: that is in
/// there.
pub(super) const RUN_HEADER_SUFFIX: &str = ".run.json";

/// The file with something added to its name.
pub(super) fn with_suffix(path: &Path, end: &str) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(end);
    path.with_file_name(name)
}
