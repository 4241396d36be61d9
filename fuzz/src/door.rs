//! Readers take paths: files in memory that are written again for each input.

use std::cell::RefCell;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

thread_local! {
    static FILES: RefCell<HashMap<String, (PathBuf, File)>> = RefCell::default();
    static FOLDER: Folder = Folder::new();
}

/// Gone with its thread.
struct Folder(PathBuf);

impl Folder {
    /// A folder of this thread alone, where `CFREG_FUZZ_FOLDER` says, else in memory where the system has
    /// such a place.
    fn new() -> Folder {
        let memory = Path::new("/dev/shm");
        let place = match std::env::var_os("CFREG_FUZZ_FOLDER") {
            Some(folder) => folder.into(),
            None if memory.is_dir() => memory.to_path_buf(),
            None => std::env::temp_dir(),
        };
        let thread = format!("{:?}", std::thread::current().id()).replace(['(', ')'], "");
        let folder = place.join(format!("cfreg-fuzz-{}-{thread}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder for inputs");
        Folder(folder)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Where files of this thread are.
pub(crate) fn folder() -> PathBuf {
    FOLDER.with(|folder| folder.0.clone())
}

/// A file of this name and content.
pub(crate) fn file(name: &str, content: &[u8]) -> PathBuf {
    FILES.with_borrow_mut(|files| {
        if !files.contains_key(name) {
            let path = folder().join(name);
            let file = File::create(&path).expect("a file for inputs");
            files.insert(name.into(), (path, file));
        }
        let (path, file) = &mut files.get_mut(name).expect("it is there now");
        file.seek(SeekFrom::Start(0)).expect("the file can be written again");
        file.write_all(content).expect("there is room for the input");
        file.set_len(content.len() as u64).expect("the file can be cut");
        path.clone()
    })
}
