//! The file beside an output that records the settings of its run.

use std::path::{Path, PathBuf};

use serde_json::Value;

/// Returns whether this is the description of a run's inputs.
pub(super) fn is_run_header(value: &Value) -> bool {
    ["cfreg", "list", "pairs", "method"].iter().all(|name| value.get(name).is_some())
}

/// Suffix of the file with the run's inputs, for an output format that cannot hold them.
pub(super) const RUN_HEADER_SUFFIX: &str = ".run.json";

/// Returns the path with a suffix added to its name.
pub(super) fn with_suffix(path: &Path, end: &str) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(end);
    path.with_file_name(name)
}
