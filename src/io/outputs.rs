//! Output files: written under a temporary name until complete, and never over an input.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Creates a new file in the folder of `path`, under an unused name. The file is deleted on drop
/// unless [`NamedTempFile::persist`] renames it to `path`.
pub(crate) fn create_temporary(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".cfreg-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Minus the user's umask, as for any new file.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder(path))
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."))
}

/// The identity of a file, independent of path and links: its device and inode number. A file that
/// does not exist yet is identified by its name and its folder.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct FileIdentity(FileKey, Option<PathBuf>);

#[cfg(unix)]
type FileKey = (u64, u64);
#[cfg(not(unix))]
type FileKey = PathBuf;

impl FileIdentity {
    /// Returns `None` if the folder does not exist either.
    pub(crate) fn from_path(path: &Path) -> Option<FileIdentity> {
        match FileIdentity::file_key(path) {
            Some(place) => Some(FileIdentity(place, None)),
            None => {
                let name = path.file_name()?.into();
                Some(FileIdentity(FileIdentity::file_key(folder(path))?, Some(name)))
            }
        }
    }

    #[cfg(unix)]
    fn file_key(path: &Path) -> Option<FileKey> {
        use std::os::unix::fs::MetadataExt;
        fs::metadata(path).ok().map(|facts| (facts.dev(), facts.ino()))
    }

    #[cfg(not(unix))]
    fn file_key(path: &Path) -> Option<FileKey> {
        fs::canonicalize(path).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_the_file_that_they_lead_to() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("within")).unwrap();
        fs::write(at("a"), "").unwrap();
        let of = |name: &str| FileIdentity::from_path(&at(name)).unwrap();
        assert_eq!((of("a"), of("new")), (of("within/../a"), of("within/../new")));
        assert!(of("a") != of("within") && of("a") != of("new") && of("new") != of("within/new"));
        assert_eq!(FileIdentity::from_path(&at("none/new")), None);
        #[cfg(unix)]
        {
            fs::hard_link(at("a"), at("hard")).unwrap();
            std::os::unix::fs::symlink("a", at("soft")).unwrap();
            assert_eq!((of("hard"), of("soft")), (of("a"), of("a")));
        }
    }

    #[test]
    fn a_file_that_is_not_persisted_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let file = create_temporary(&path).unwrap();
        assert!(file.path().parent() == Some(folder.path()));
        drop(file);
        create_temporary(&path).unwrap().persist(&path).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            fs::write(folder.path().join("usual"), "").unwrap();
            let mode =
                |name: &str| fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
            assert_eq!(mode("a.csv"), mode("usual"));
        }
    }
}
