//! Files that a command is to write, looked at before minutes of work and not after.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Refuses an output that is an input or another output, or whose folder is not there.
pub(super) fn check(inputs: &[&Path], outputs: &[(&'static str, Option<&Path>)]) -> Result<()> {
    let mut taken: Vec<PathBuf> = inputs.iter().map(|path| place(path)).collect();
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
        let place = place(path);
        if taken.contains(&place) {
            return refuse("would overwrite an input or another output of this command");
        }
        // Devices such as /dev/null may be named as often as one likes.
        if !path.exists() || path.is_file() {
            taken.push(place);
        }
    }
    Ok(())
}

/// The file a path stands for, whether it is there already or not.
fn place(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let beside = || {
        let folder = std::fs::canonicalize(folder.unwrap_or(Path::new("."))).ok()?;
        Some(folder.join(path.file_name()?))
    };
    std::fs::canonicalize(path).ok().or_else(beside).unwrap_or_else(|| path.to_path_buf())
}
