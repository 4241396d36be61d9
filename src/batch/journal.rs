//! Rows as they come, in a file beside the output: what a run that was cut short goes on from.
//!
//! JSON Lines: first what the run was asked for, then a row a line, in the order in which pairs
//! were done. A line counts once its end is there; whatever follows the last whole line was cut
//! short, is cut off, and done again.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::Row;
use crate::error::{Error, Result};

/// Seconds after which the system is asked to have what was written on the disk.
const SYNC: Duration = Duration::from_secs(5);

/// A journal that is open, and where its rows begin.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    /// Where the row of each pair begins; 0, where the header is, for those not done.
    places: Vec<u64>,
    end: u64,
    done: usize,
    synced: Instant,
}

impl Journal {
    /// The place of the journal of an output.
    pub(super) fn beside(output: &Path) -> PathBuf {
        super::output::beside(output, ".part")
    }

    /// Opens the journal for `pairs` pairs under `header`, with `resume` the rows that are in it
    /// already, else none.
    ///
    /// # Errors
    /// [`Error::Config`] when it was begun by another `header`, when it is not a journal, or when
    /// another process writes it; [`Error::Io`].
    pub(super) fn open(path: &Path, header: &Value, pairs: usize, resume: bool) -> Result<Self> {
        let failed = |error| Error::io(path, error);
        let refuse = |rule: String| Err(Error::config("resume", path.display(), rule));
        if path.exists() && !path.is_file() {
            return refuse("is not a regular file: name another output".into());
        }
        let options = || OpenOptions::new().read(true).append(true).create(true).open(path);
        let file = options().map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => {
                return refuse("another process is at work on it".into());
            }
            // Some network file systems have no locks.
            Err(std::fs::TryLockError::Error(_)) => {}
        }
        let places = vec![0; pairs];
        let (path, synced) = (path.to_path_buf(), Instant::now());
        let mut journal = Journal { path, file, places, end: 0, done: 0, synced };
        if !resume {
            journal.cut()?;
        }
        journal.read(header)?;
        Ok(journal)
    }

    /// Takes over what is there, and cuts off what is not whole.
    fn read(&mut self, header: &Value) -> Result<()> {
        let path = self.path.clone();
        let failed = |error| Error::io(&path, error);
        let first = format!("{header}\n");
        let mut reader = BufReader::new(self.file.try_clone().map_err(failed)?);
        reader.seek(SeekFrom::Start(0)).map_err(failed)?;
        let mut line = Vec::new();
        reader.read_until(b'\n', &mut line).map_err(failed)?;
        if !line.ends_with(b"\n") {
            if !first.as_bytes().starts_with(&line) && !line.starts_with(b"{\"cfreg\":") {
                let rule = "is no journal of this program: name another output or remove it";
                return Err(Error::config("resume", path.display(), rule));
            }
            self.cut()?;
            return self.append(first.as_bytes());
        }
        let begun: Value = serde_json::from_slice(&line).unwrap_or_default();
        if let Some(rule) = difference(&begun, &serde_json::from_str(&first).unwrap_or_default()) {
            return Err(Error::config("resume", path.display(), rule));
        }
        self.end = line.len() as u64;
        loop {
            line.clear();
            reader.read_until(b'\n', &mut line).map_err(failed)?;
            let whole = line.ends_with(b"\n");
            let Some(row) = serde_json::from_slice::<Row>(&line).ok().filter(|_| whole) else {
                return self.cut();
            };
            if row.index >= self.places.len() {
                return self.cut();
            }
            self.count(row.index);
            self.end += line.len() as u64;
        }
    }

    /// Leaves what is before the end, and nothing else.
    fn cut(&mut self) -> Result<()> {
        self.file.set_len(self.end).map_err(|error| Error::io(&self.path, error))
    }

    fn append(&mut self, line: &[u8]) -> Result<()> {
        self.file.write_all(line).map_err(|error| Error::io(&self.path, error))?;
        self.end += line.len() as u64;
        Ok(())
    }

    fn count(&mut self, index: usize) {
        if self.places[index] == 0 {
            self.places[index] = self.end;
            self.done += 1;
        }
    }

    /// Adds a row.
    pub(super) fn add(&mut self, row: &Row) -> Result<()> {
        let fail = |error: io::Error| Error::io(&self.path, error);
        let mut line = serde_json::to_vec(row).map_err(|error| fail(error.into()))?;
        line.push(b'\n');
        let before = self.end;
        self.append(&line)?;
        self.end = before;
        self.count(row.index);
        self.end += line.len() as u64;
        self.sync(SYNC)
    }

    /// Has rows on the disk, unless that was done less than `after` ago.
    pub(super) fn sync(&mut self, after: Duration) -> Result<()> {
        if self.synced.elapsed() < after {
            return Ok(());
        }
        self.synced = Instant::now();
        self.file.sync_data().map_err(|error| Error::io(&self.path, error))
    }

    /// Number of rows.
    pub(super) fn done(&self) -> usize {
        self.done
    }

    /// The pairs that have no row yet, in order.
    pub(super) fn missing(&self) -> Vec<usize> {
        (0..self.places.len()).filter(|&index| self.places[index] == 0).collect()
    }

    /// All rows, in the order of the list.
    ///
    /// # Errors
    /// Each: [`Error::Io`], and [`Error::Parse`] where the file was changed from outside.
    pub(super) fn rows(&self) -> Result<impl Iterator<Item = Result<Row>> + '_> {
        let failed = |error| Error::io(&self.path, error);
        let mut reader = BufReader::new(self.file.try_clone().map_err(failed)?);
        let (mut at, mut line) = (reader.seek(SeekFrom::Start(0)).map_err(failed)?, Vec::new());
        Ok(self.places.iter().enumerate().map(move |(index, &place)| {
            // What is in the buffer is used where it can be.
            reader.seek_relative(place as i64 - at as i64).map_err(failed)?;
            line.clear();
            at = place + reader.read_until(b'\n', &mut line).map_err(failed)? as u64;
            let row = serde_json::from_slice::<Row>(&line).ok();
            row.filter(|row| row.index == index).ok_or_else(|| Error::Parse {
                path: self.path.clone(),
                line: None,
                byte: Some(place),
                what: format!("no row of pair {index}: was the file changed?"),
            })
        }))
    }

    /// Removes the file: its rows are elsewhere.
    pub(super) fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(|error| Error::io(&self.path, error))
    }
}

/// What a journal was begun with otherwise than `now`, if anything.
pub(super) fn difference(begun: &Value, now: &Value) -> Option<String> {
    if begun.get("cfreg").is_none() {
        return Some("is no journal of this program: name another output or remove it".into());
    }
    let (name, before, value) = setting(begun, now, "")?;
    Some(format!(
        "was begun with {name} {before}, and this is {value}: run it as it was begun, start anew \
         with --overwrite, or name another output"
    ))
}

/// The first setting that differs, by its name, and both values.
fn setting<'a>(
    begun: &'a Value,
    now: &'a Value,
    name: &str,
) -> Option<(String, &'a Value, &'a Value)> {
    let (Some(before), Some(fields)) = (begun.as_object(), now.as_object()) else {
        return (begun != now).then(|| (name.to_string(), begun, now));
    };
    let names = fields.keys().chain(before.keys().filter(|key| !fields.contains_key(*key)));
    names.into_iter().find_map(|key| {
        let of = |all: &'a serde_json::Map<String, Value>| all.get(key).unwrap_or(&Value::Null);
        let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
        setting(of(before), of(fields), &name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(index: usize) -> Row {
        Row { error: Some("none".into()), ..Row::new(index, ["a", "b"]) }
    }

    #[test]
    fn whatever_is_cut_off_only_whole_rows_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv.part");
        let header = json!({"cfreg": "1", "list": "x"});
        let order = [2, 0, 3, 1];
        let mut journal = Journal::open(&path, &header, 4, false).unwrap();
        order.iter().for_each(|&index| journal.add(&row(index)).unwrap());
        let rows = |journal: &Journal| -> Vec<Row> {
            journal.rows().unwrap().collect::<Result<_>>().unwrap()
        };
        assert_eq!(rows(&journal), [0, 1, 2, 3].map(row));
        // Not while another is at it.
        assert!(Journal::open(&path, &header, 4, true).is_err());
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let mut journal = Journal::open(&path, &header, 4, true).unwrap();
            let ends = whole[..length].iter().filter(|&&byte| byte == b'\n').count();
            assert_eq!(journal.done(), ends.saturating_sub(1), "{length}");
            for index in journal.missing() {
                journal.add(&row(index)).unwrap();
            }
            assert_eq!(rows(&journal), [0, 1, 2, 3].map(row));
        }
    }

    #[test]
    fn what_differs_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv.part");
        let header = json!({"cfreg": "1", "list": "x"});
        drop(Journal::open(&path, &header, 4, false).unwrap());
        let said = |header: &Value| {
            let opened = Journal::open(&path, header, 4, true);
            opened.err().unwrap().to_string()
        };
        let other = said(&json!({"cfreg": "1", "list": {"a": 1, "b": 2}, "more": 3}));
        assert!(other.contains("begun with list \"x\""), "{other}");
        let [one, two] = [json!({"a": {"b": 1, "c": 2}}), json!({"a": {"b": 1, "d": 3}})];
        assert_eq!(setting(&one, &two, ""), Some(("a.d".into(), &Value::Null, &json!(3))));
        assert_eq!(setting(&one, &one, ""), None);
        for foreign in ["mine\n", "mine", "{}\n"] {
            std::fs::write(&path, foreign).unwrap();
            assert!(said(&header).contains("no journal"), "{foreign}");
            assert_eq!(std::fs::read_to_string(&path).unwrap(), foreign);
        }
    }
}
