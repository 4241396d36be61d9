//! The journal: rows in order of completion, in a file beside the output, from which an interrupted
//! run resumes.
//!
//! JSON Lines: first the inputs of the run, then one row a line, in the order in which pairs were
//! done. Each row has a checksum of the first line and of its own text. A line counts if it is
//! complete and its checksum matches; any other pair is done again.

use std::fs::{File, OpenOptions};
use std::io::{self, BufRead, BufReader, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::hash::Fnv1a;
use super::run_file::{is_run_header, with_suffix};
use super::{PairList, Row};
use crate::error::{Error, Result};
use crate::io::limited_file;

/// Seconds between requests to flush the journal to disk. Chosen by hand.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// An open journal with the positions of its rows.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    /// Byte at which the row of each pair begins; 0, the position of the header, for pairs not
    /// done.
    row_offsets: Vec<u64>,
    end: u64,
    done: usize,
    /// Lines that were modified, or of other pairs.
    damaged: usize,
    /// Checksum of the first line.
    header_checksum: u64,
    synced: Instant,
}

impl Journal {
    /// Returns the path of the journal of an output.
    pub(super) fn path_for(output: &Path) -> PathBuf {
        with_suffix(output, ".part")
    }

    /// Refuses an existing path that is no journal.
    ///
    /// # Errors
    /// [`Error::Config`]; [`Error::Io`].
    pub(super) fn check(path: &Path) -> Result<()> {
        let failed = |error| Error::io(path, error);
        let refuse = |rule: &str| Err(Error::config("output", path.display(), rule));
        if !path.exists() {
            return Ok(());
        }
        if !path.is_file() {
            return refuse("is there and not a regular file: name another output");
        }
        let file = File::open(path).map_err(failed)?;
        match first_line(&file, &mut BufReader::new(&file)).map_err(failed)? {
            Some(_) => Ok(()),
            None => refuse(NOT_A_JOURNAL),
        }
    }

    /// Opens the journal for the pairs of `list` under `header`. With `resume` it keeps existing
    /// rows; otherwise it starts empty.
    ///
    /// # Errors
    /// [`Error::Config`] when it was begun by another `header`, when it is not a journal, or when
    /// another process writes it; [`Error::Io`].
    pub(super) fn open(path: &Path, header: &Value, list: &PairList, resume: bool) -> Result<Self> {
        let failed = |error| Error::io(path, error);
        let refuse = |rule: &str| Err(Error::config("resume", path.display(), rule));
        if path.exists() && !path.is_file() {
            return refuse("is not a regular file: name another output");
        }
        let options = || OpenOptions::new().read(true).append(true).create(true).open(path);
        let file = options().map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => {
                return refuse("another process is at work on it");
            }
            // Some network file systems have no locks.
            Err(std::fs::TryLockError::Error(_)) => {}
        }
        let first = format!("{header}\n");
        let begun = Fnv1a::hash_bytes(first.as_bytes());
        let (path, synced, places) = (path.to_path_buf(), Instant::now(), vec![0; list.len()]);
        let mut journal = Journal {
            path,
            file,
            row_offsets: places,
            end: 0,
            done: 0,
            damaged: 0,
            header_checksum: begun,
            synced,
        };
        journal.read(header, &first, list, resume)?;
        Ok(journal)
    }

    /// Reads the existing rows, if `resume` is set, and cuts off an incomplete end.
    fn read(&mut self, header: &Value, first: &str, list: &PairList, resume: bool) -> Result<()> {
        let path = self.path.clone();
        let failed = |error| Error::io(&path, error);
        let refuse = |rule: String| Err(Error::config("resume", path.display(), rule));
        let mut reader = BufReader::new(self.file.try_clone().map_err(failed)?);
        reader.seek(SeekFrom::Start(0)).map_err(failed)?;
        let Some(mut line) = first_line(&self.file, &mut reader).map_err(failed)? else {
            return refuse(NOT_A_JOURNAL.into());
        };
        let cut = !line.ends_with(b"\n");
        let begun: Value = serde_json::from_slice(&line).unwrap_or_default();
        if cut || !resume {
            self.truncate()?;
            return self.append(first.as_bytes());
        }
        if let Some(rule) = header_difference(&begun, header) {
            return refuse(rule);
        }
        self.end = line.len() as u64;
        // The header may be formatted differently with the same content.
        self.header_checksum = Fnv1a::hash_bytes(&line);
        loop {
            match limited_file::read_line(&mut reader, &mut line) {
                Err(error) if error.kind() == io::ErrorKind::FileTooLarge => {
                    self.damaged += 1;
                    return self.truncate();
                }
                read => _ = read.map_err(failed)?,
            }
            if !line.ends_with(b"\n") {
                return self.truncate();
            }
            let same = |row: &Row| {
                row.index < list.len()
                    && list.pair(row.index) == [row.source.as_str(), row.target.as_str()]
            };
            match self.row(&line).filter(same) {
                Some(row) => self.mark_done(row.index),
                None => self.damaged += 1,
            }
            self.end += line.len() as u64;
        }
    }

    /// Parses the row in a line, if its checksum matches.
    fn row(&self, line: &[u8]) -> Option<Row> {
        let row = line.strip_suffix(b"\"}\n")?;
        let (row, sum) = row.split_at_checked(row.len().checked_sub(CHECKSUM_DIGITS)?)?;
        let row = row.strip_suffix(CHECKSUM_FIELD.as_bytes())?;
        if self.row_checksum(row).as_bytes() != sum {
            return None;
        }
        let mut whole = row.to_vec();
        whole.push(b'}');
        serde_json::from_slice(&whole).ok()
    }

    /// Returns the checksum of a row.
    fn row_checksum(&self, row: &[u8]) -> String {
        let mut hash = Fnv1a::default();
        hash.add_bytes(&self.header_checksum.to_le_bytes());
        hash.add_bytes(row);
        format!("{:016x}", hash.value())
    }

    /// Truncates the file at the end of its valid rows.
    fn truncate(&mut self) -> Result<()> {
        self.file.set_len(self.end).map_err(|error| Error::io(&self.path, error))
    }

    fn append(&mut self, line: &[u8]) -> Result<()> {
        self.file.write_all(line).map_err(|error| Error::io(&self.path, error))?;
        self.end += line.len() as u64;
        Ok(())
    }

    fn mark_done(&mut self, index: usize) {
        if self.row_offsets[index] == 0 {
            self.row_offsets[index] = self.end;
            self.done += 1;
        }
    }

    /// Adds a row.
    pub(super) fn add(&mut self, row: &Row) -> Result<()> {
        let fail = |error: io::Error| Error::io(&self.path, error);
        let mut line = serde_json::to_vec(row).map_err(|error| fail(error.into()))?;
        // Without the final brace, which comes after the checksum.
        line.pop();
        let sum = self.row_checksum(&line);
        line.extend_from_slice(format!("{CHECKSUM_FIELD}{sum}\"}}\n").as_bytes());
        let before = self.end;
        self.append(&line)?;
        self.end = before;
        self.mark_done(row.index);
        self.end += line.len() as u64;
        self.sync(SYNC_INTERVAL)
    }

    /// Flushes rows to disk, unless that was done less than `after` ago.
    pub(super) fn sync(&mut self, after: Duration) -> Result<()> {
        if self.synced.elapsed() < after {
            return Ok(());
        }
        self.synced = Instant::now();
        self.file.sync_data().map_err(|error| Error::io(&self.path, error))
    }

    /// Returns the number of rows.
    pub(super) fn done_count(&self) -> usize {
        self.done
    }

    /// Returns the number of modified lines, whose pairs are done again.
    pub(super) fn damaged_count(&self) -> usize {
        self.damaged
    }

    /// Returns the pairs that have no row yet, in order.
    pub(super) fn missing_indices(&self) -> Vec<usize> {
        (0..self.row_offsets.len()).filter(|&index| self.row_offsets[index] == 0).collect()
    }

    /// Iterates over all rows, in the order of the list.
    ///
    /// # Errors
    /// For each row: [`Error::Io`], and [`Error::Parse`] if the file was changed from outside.
    pub(super) fn rows(&self) -> Result<impl Iterator<Item = Result<Row>> + '_> {
        let failed = |error| Error::io(&self.path, error);
        let mut reader = BufReader::new(self.file.try_clone().map_err(failed)?);
        let (mut at, mut line) = (reader.seek(SeekFrom::Start(0)).map_err(failed)?, Vec::new());
        Ok(self.row_offsets.iter().enumerate().map(move |(index, &place)| {
            // The buffer is reused if possible.
            reader.seek_relative(place as i64 - at as i64).map_err(failed)?;
            limited_file::read_line(&mut reader, &mut line).map_err(failed)?;
            at = place + line.len() as u64;
            self.row(&line).filter(|row| row.index == index).ok_or_else(|| Error::Parse {
                path: self.path.clone(),
                line: None,
                byte: Some(place),
                what: format!("no row of pair {index}: the file was changed meanwhile"),
            })
        }))
    }

    /// Removes the file after its rows were written elsewhere.
    pub(super) fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(|error| Error::io(&self.path, error))
    }
}

/// Reads the first line of a journal, including its end, or its available part if the file was cut
/// within that line; `None` for a file that is no journal.
fn first_line(file: &File, reader: &mut impl BufRead) -> io::Result<Option<Vec<u8>>> {
    const START: &[u8] = b"{\"cfreg\":";
    let mut line = Vec::new();
    match limited_file::read_line(reader, &mut line) {
        Err(error) if error.kind() == io::ErrorKind::FileTooLarge => return Ok(None),
        read => _ = read?,
    }
    let ours = match line.ends_with(b"\n") {
        true => serde_json::from_slice(&line).is_ok_and(|begun| is_run_header(&begun)),
        false => {
            let whole = file.metadata()?.len() == line.len() as u64;
            whole && (START.starts_with(&line) || line.starts_with(START))
        }
    };
    Ok(ours.then_some(line))
}

/// The separator between a row and its checksum, and the length of the checksum.
const CHECKSUM_FIELD: &str = ",\"checksum\":\"";
const CHECKSUM_DIGITS: usize = 16;

const NOT_A_JOURNAL: &str =
    "is there and no journal of this program: move or remove it, or name another output";

/// Returns the difference between the inputs of a journal and `now`, if any.
pub(super) fn header_difference(begun: &Value, now: &Value) -> Option<String> {
    if begun.get("cfreg").is_none() {
        return Some(NOT_A_JOURNAL.into());
    }
    let (name, before, value) = differing_setting(begun, now, "")?;
    Some(format!(
        "was begun with {name} {before}, and this is {value}: run it as it was begun, start anew \
         with --overwrite, or name another output"
    ))
}

/// Returns the name of the first setting that differs, and both values.
fn differing_setting<'a>(
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
        differing_setting(of(before), of(fields), &name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn row(index: usize) -> Row {
        Row { error: Some("none".into()), ..Row::new(index, ["a", "b"]) }
    }

    fn header() -> Value {
        json!({"cfreg": "1", "list": "x", "pairs": 4, "method": 0})
    }

    fn list() -> PairList {
        PairList::new("", [["a", "b"]; 4])
    }

    #[test]
    fn whatever_is_cut_off_only_whole_rows_count() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv.part");
        let header = header();
        let order = [2, 0, 3, 1];
        let mut journal = Journal::open(&path, &header, &list(), false).unwrap();
        order.iter().for_each(|&index| journal.add(&row(index)).unwrap());
        let rows = |journal: &Journal| -> Vec<Row> {
            journal.rows().unwrap().collect::<Result<_>>().unwrap()
        };
        assert_eq!(rows(&journal), [0, 1, 2, 3].map(row));
        // Not while another process uses it.
        assert!(Journal::open(&path, &header, &list(), true).is_err());
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        for length in 0..=whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let mut journal = Journal::open(&path, &header, &list(), true).unwrap();
            let ends = whole[..length].iter().filter(|&&byte| byte == b'\n').count();
            assert_eq!(journal.done_count(), ends.saturating_sub(1), "{length}");
            for index in journal.missing_indices() {
                journal.add(&row(index)).unwrap();
            }
            assert_eq!(rows(&journal), [0, 1, 2, 3].map(row));
        }
    }

    #[test]
    fn what_differs_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv.part");
        let header = header();
        drop(Journal::open(&path, &header, &list(), false).unwrap());
        let said = |header: &Value| {
            let opened = Journal::open(&path, header, &list(), true);
            opened.err().unwrap().to_string()
        };
        let other = json!({"cfreg": "1", "list": {"a": 1}, "pairs": 4, "method": 0, "more": 3});
        let other = said(&other);
        assert!(other.contains("begun with list \"x\""), "{other}");
        let [one, two] = [json!({"a": {"b": 1, "c": 2}}), json!({"a": {"b": 1, "d": 3}})];
        assert_eq!(
            differing_setting(&one, &two, ""),
            Some(("a.d".into(), &Value::Null, &json!(3)))
        );
        assert_eq!(differing_setting(&one, &one, ""), None);
        let long = "x".repeat(limited_file::MAX_RECORD_BYTES + 1);
        for foreign in ["mine\n", "mine", "{}\n", "{\"cfreg\": 1}\n", "mine\n\n", &long] {
            std::fs::write(&path, foreign).unwrap();
            for resume in [true, false] {
                let said = Journal::open(&path, &header, &list(), resume).err().unwrap();
                assert!(said.to_string().contains("no journal"), "{foreign:.20}");
                assert!(std::fs::read_to_string(&path).unwrap() == foreign);
            }
        }
    }

    #[test]
    fn what_was_changed_is_done_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv.part");
        let (header, list) = (header(), list());
        let mut journal = Journal::open(&path, &header, &list, false).unwrap();
        (0..4).for_each(|index| journal.add(&row(index)).unwrap());
        drop(journal);
        let whole = std::fs::read_to_string(&path).unwrap();
        let reopened = |text: &str, header: &Value, list: &PairList| {
            std::fs::write(&path, text).unwrap();
            let journal = Journal::open(&path, header, list, true).unwrap();
            (journal.done_count(), journal.damaged_count(), journal.missing_indices())
        };
        assert_eq!(reopened(&whole, &header, &list), (4, 0, vec![]));
        // A digit, a name, a blank, a checksum; later rows are kept.
        for (was, is) in [
            ("\"trusted\":null", "\"trusted\":true"),
            ("\"source\":\"a\"", "\"source\":\"b\""),
            ("{\"index\":0", "{ \"index\":0"),
            ("\"index\":0", "\"index\":1"),
            ("checksum\":\"", "checksum\":\"0"),
            ("\"error\":\"none\"", "\"error\":\"nonf\""),
            ("}\n{\"index\":1", "}\n\n{\"index\":1"),
        ] {
            let at = whole.find(was).unwrap_or_else(|| whole.find("{\"index\":0").unwrap());
            let text = whole[..at].to_string() + &whole[at..].replacen(was, is, 1);
            assert!(text != whole, "{was}");
            let (done, damaged, missing) = reopened(&text, &header, &list);
            assert!(damaged == 1 && done + missing.len() == 4 && done >= 3, "{was} {done}");
        }
        // Every single byte, with any replacement.
        let first = whole.find('\n').unwrap() + 1;
        let second = first + whole[first..].find('\n').unwrap() + 1;
        for at in first..second - 1 {
            let mut bytes = whole.clone().into_bytes();
            bytes[at] ^= 1 + (at % 7) as u8;
            std::fs::write(&path, &bytes).unwrap();
            let journal = Journal::open(&path, &header, &list, true).unwrap();
            assert!(journal.damaged_count() > 0 && journal.missing_indices() == [0], "{at}");
        }
        // Rows of another list, and of another run.
        let other = PairList::new("", [["a", "b"], ["a", "b"], ["b", "a"], ["a", "b"]]);
        assert_eq!(reopened(&whole, &header, &other), (3, 1, vec![2]));
        let text = whole.replacen("\"method\":0", "\"method\":1", 1);
        let header = serde_json::from_str(text.lines().next().unwrap()).unwrap();
        assert_eq!(reopened(&text, &header, &list), (0, 4, vec![0, 1, 2, 3]));
    }
}
