//! Lists of pairs.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::hash::Fnv1a;
use crate::error::{Error, Result};
use crate::io;
use crate::io::limited_file::GROWTH_FACTOR;

/// Pairs of files, in order; a name of many pairs is stored once.
#[derive(Debug, Clone, Default)]
pub struct PairList {
    /// The file that the list was read from.
    file: Option<PathBuf>,
    folder: PathBuf,
    names: Vec<String>,
    pairs: Vec<[u32; 2]>,
}

/// Lists are equal if they have the same pairs of the same folder, independent of their file.
impl PartialEq for PairList {
    fn eq(&self, other: &PairList) -> bool {
        self.folder == other.folder && self.names == other.names && self.pairs == other.pairs
    }
}

impl PairList {
    /// Creates a list of pairs of source and target, files relative to `folder`.
    pub fn new<S: AsRef<str>>(
        folder: impl Into<PathBuf>,
        pairs: impl IntoIterator<Item = [S; 2]>,
    ) -> PairList {
        let mut builder = PairListBuilder::default();
        pairs.into_iter().for_each(|pair| _ = builder.add([pair[0].as_ref(), pair[1].as_ref()]));
        PairList { folder: folder.into(), ..builder.list }
    }

    /// Reads a list: CSV, or Parquet if the name ends in `.parquet`, with the columns `source` and
    /// `target`; other columns are ignored. Files are relative to `folder`.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] without these columns, without a pair, and for a row in
    /// which one of the two is missing.
    pub fn read(path: &Path, folder: &Path) -> Result<PairList> {
        let mut builder = PairListBuilder::default();
        if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("parquet")) {
            parquet(path, &mut builder)?;
        } else {
            read_csv(path, &mut builder)?;
        }
        if builder.list.is_empty() {
            return Err(Error::parse(
                path,
                None,
                "no pair: it needs rows below the names of the columns",
            ));
        }
        Ok(PairList { file: Some(path.into()), folder: folder.into(), ..builder.list })
    }

    /// Writes the list as CSV; an existing file is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(&self, path: &Path) -> Result<()> {
        let failed = |error: csv::Error| csv_error(path, error);
        // A name may begin like a comment.
        let mut table = csv::WriterBuilder::new().comment(Some(b'#')).from_writer(Vec::new());
        table.write_record(COLUMNS).map_err(failed)?;
        for index in 0..self.len() {
            table.write_record(self.pair(index)).map_err(failed)?;
        }
        let content = table.into_inner().map_err(|error| failed(error.into_error().into()))?;
        io::write_bytes(path, &content)
    }

    /// Returns the number of pairs.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Returns whether there is no pair.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Returns source and target of a pair, as in the list.
    ///
    /// # Panics
    /// When there is no pair `index`.
    pub fn pair(&self, index: usize) -> [&str; 2] {
        self.pairs[index].map(|name| self.names[name as usize].as_str())
    }

    /// Returns the folder that names are relative to.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the file that the list was read from, if any.
    pub(super) fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// Iterates over the files of all clouds, each once.
    pub(super) fn files(&self) -> impl Iterator<Item = PathBuf> {
        self.names.iter().map(|name| self.folder.join(name))
    }

    /// Returns a hash of the pairs.
    pub(super) fn hash(&self) -> u64 {
        let mut hash = Fnv1a::default();
        (0..self.len()).flat_map(|index| self.pair(index)).for_each(|name| hash.add_text(name));
        hash.value()
    }
}

/// A list under construction.
#[derive(Default)]
struct PairListBuilder {
    list: PairList,
    known: HashMap<String, u32>,
}

impl PairListBuilder {
    /// Adds a pair, and returns the bytes of memory that it takes.
    fn add(&mut self, pair: [&str; 2]) -> usize {
        let mut bytes = GROWTH_FACTOR * size_of::<[u32; 2]>();
        let pair = pair.map(|name| {
            self.known.get(name).copied().unwrap_or_else(|| {
                let number = self.list.names.len() as u32;
                self.list.names.push(name.into());
                self.known.insert(name.into(), number);
                bytes += 2 * (name.len() + GROWTH_FACTOR * size_of::<String>());
                number
            })
        });
        self.list.pairs.push(pair);
        bytes
    }
}

/// Converts an error of a CSV table, with its line.
pub(super) fn csv_error(path: &Path, error: csv::Error) -> Error {
    let line = error.position().map(|at| at.line() as usize);
    match error.into_kind() {
        csv::ErrorKind::Io(error) => Error::io(path, error),
        csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
            Error::parse(path, line, format!("{len} values where the header has {expected_len}"))
        }
        csv::ErrorKind::Utf8 { err, .. } => Error::parse(path, line, err.to_string()),
        other => Error::parse(path, line, format!("{other:?}")),
    }
}

const COLUMNS: [&str; 2] = ["source", "target"];

fn read_csv(path: &Path, builder: &mut PairListBuilder) -> Result<()> {
    let mut sheet = io::CsvReader::open(path)?;
    let [source, target] = [sheet.column(COLUMNS[0])?, sheet.column(COLUMNS[1])?];
    while sheet.next()? {
        let pair = [source, target].map(|at| sheet.cell(at));
        if let Some(empty) = pair.iter().position(|name| name.is_empty()) {
            return Err(sheet.parse_error(format!("{} is empty", COLUMNS[empty])));
        }
        let bytes = builder.add(pair);
        sheet.reserve_memory(bytes)?;
    }
    Ok(())
}

#[cfg(feature = "parquet")]
fn parquet(path: &Path, builder: &mut PairListBuilder) -> Result<()> {
    let mut budget = io::limited_file::LimitedFile::open(path)?.budget();
    super::parquet::read_pairs(path, COLUMNS, |number, pair| {
        let pair = pair.map(str::trim);
        if let Some(empty) = pair.iter().position(|name| name.is_empty()) {
            let what = format!("row {number}: {} is empty", COLUMNS[empty]);
            return Err(Error::parse(path, None, what));
        }
        let bytes = builder.add(pair);
        budget.reserve(bytes).map_err(|what| Error::parse(path, None, what))
    })
}

#[cfg(not(feature = "parquet"))]
fn parquet(path: &Path, _: &mut PairListBuilder) -> Result<()> {
    Err(Error::parse(path, None, "was built without the feature parquet: give the list as CSV"))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read(text: &str) -> Result<PairList> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pairs.csv");
        fs::write(&path, text).unwrap();
        PairList::read(&path, folder.path())
    }

    #[test]
    fn pairs_are_read_by_the_names_of_columns() {
        let list = read("id,target, source\n7,b.ply,a.ply\n8,c.ply,b.ply\n").unwrap();
        assert_eq!(
            (list.len(), list.pair(0), list.pair(1)),
            (2, ["a.ply", "b.ply"], ["b.ply", "c.ply"])
        );
        assert_eq!(list.names.len(), 3);
        let same = PairList::new(list.folder(), [["a.ply", "b.ply"], ["b.ply", "c.ply"]]);
        assert_eq!(list.hash(), same.hash());
        let other = PairList::new("", [["a.plyb.ply", ""], ["b.ply", "c.ply"]]);
        assert_ne!(list.hash(), other.hash());
        let path = list.folder().join("again.csv");
        fs::create_dir_all(list.folder()).unwrap();
        let odd = PairList::new(list.folder(), [["a, b.ply", "\"c\".ply"], ["#d.ply", "e.ply"]]);
        for list in [&list, &odd] {
            list.write(&path).unwrap();
            assert_eq!(&PairList::read(&path, list.folder()).unwrap(), list);
        }
        fs::remove_dir_all(list.folder()).unwrap();
    }

    #[test]
    fn what_cannot_be_understood_is_named() {
        let said = |text: &str| read(text).unwrap_err().to_string();
        assert!(said("source,to\na,b\n").contains("no column target"));
        assert!(said("").contains("no column source"));
        assert!(said("source,target\n").contains("no pair"));
        assert!(said("source,target\na,b\na,\n").contains("line 3: target is empty"));
        assert!(said("source,target\na,b\na").contains("1 values where the header has 2"));
    }
}
