//! Checks of the files that a command will write, before it starts to work.

use std::path::Path;

use crate::error::{Error, Result};
use crate::io::outputs::FileIdentity;

/// Refuses an output that is an input or another output, also through links, or whose folder does
/// not exist.
pub(super) fn check(inputs: &[&Path], outputs: &[(&'static str, Option<&Path>)]) -> Result<()> {
    let mut taken: Vec<FileIdentity> =
        inputs.iter().filter_map(|path| FileIdentity::from_path(path)).collect();
    for &(option, path) in outputs {
        let Some(path) = path else { continue };
        let refuse = |rule: &str| Err(Error::config(option, path.display(), rule));
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        if !folder.is_dir() {
            return refuse("its folder does not exist");
        }
        if path.is_dir() {
            return refuse("is a folder");
        }
        // Devices such as /dev/null may be named more than once.
        if path.exists() && !path.is_file() {
            continue;
        }
        let Some(file) = FileIdentity::from_path(path) else { continue };
        if taken.contains(&file) {
            return refuse("would overwrite an input or another output of this command");
        }
        taken.push(file);
    }
    Ok(())
}

/// Refuses an output path that was derived from another name, if a file is there that `ours` does
/// not recognise as written by this program.
pub(super) fn check_default_path(
    option: &'static str,
    path: &Path,
    ours: impl FnOnce(&Path) -> bool,
) -> Result<()> {
    if !path.exists() || ours(path) {
        return Ok(());
    }
    let rule = "exists and was not written by this program: move it, or choose another path";
    Err(Error::config(option, path.display(), rule))
}
