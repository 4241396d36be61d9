//! Rows as they come, in a file beside the output: what a run that was cut short goes on from.
//!
//! JSON Lines: first what the run was asked for, then a row a line, in the order in which pairs
//! were done, each with a checksum of the first line and of its own. A line counts once its end is
//! there and the checksum is that of what stands before it; the pair of any other is done again.

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

/// Seconds after which the system is asked to have what was written on the disk.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// A journal that is open, and where its rows begin.
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    /// Where the row of each pair begins; 0, where the header is, for those not done.
    row_offsets: Vec<u64>,
    end: u64,
    done: usize,
    /// Lines that are not as they were written, or of other pairs.
    damaged: usize,
    /// Checksum of the first line.
    header_checksum: u64,
    synced: Instant,
}

impl Journal {
    /// The place of the journal of an output.
    pub(super) fn path_for(output: &Path) -> PathBuf {
        with_suffix(output, ".part")
    }

    /// Refuses what is there and no journal.
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

    /// Opens the journal for the pairs of `list` under `header`, with `resume` the rows that are in
    /// it already, else none.
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

    /// Takes over what is there, if it is to, and cuts off what is not whole.
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
        // Written otherwise, though it says the same.
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

    /// The row in a line, if it is as it was written.
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

    /// The checksum of a row.
    fn row_checksum(&self, row: &[u8]) -> String {
        let mut hash = Fnv1a::default();
        hash.add_bytes(&self.header_checksum.to_le_bytes());
        hash.add_bytes(row);
        format!("{:016x}", hash.value())
    }

    /// Leaves what is before the end, and nothing else.
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
        // Without the brace at the end, which comes behind the checksum.
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

    /// Has rows on the disk, unless that was done less than `after` ago.
    pub(super) fn sync(&mut self, after: Duration) -> Result<()> {
        if self.synced.elapsed() < after {
            return Ok(());
        }
        self.synced = Instant::now();
        self.file.sync_data().map_err(|error| Error::io(&self.path, error))
    }

    /// Number of rows.
    pub(super) fn done_count(&self) -> usize {
        self.done
    }

    /// Number of lines whose pairs are done again, as they were changed.
    pub(super) fn damaged_count(&self) -> usize {
        self.damaged
    }

    /// The pairs that have no row yet, in order.
    pub(super) fn missing_indices(&self) -> Vec<usize> {
        (0..self.row_offsets.len()).filter(|&index| self.row_offsets[index] == 0).collect()
    }

    /// All rows, in the order of the list.
    ///
    /// # Errors
    /// Each: [`Error::Io`], and [`Error::Parse`] where the file was changed from outside.
    pub(super) fn rows(&self) -> Result<impl Iterator<Item = Result<Row>> + '_> {
        let failed = |error| Error::io(&self.path, error);
        let mut reader = BufReader::new(self.file.try_clone().map_err(failed)?);
        let (mut at, mut line) = (reader.seek(SeekFrom::Start(0)).map_err(failed)?, Vec::new());
        Ok(self.row_offsets.iter().enumerate().map(move |(index, &place)| {
            // What is in the buffer is used where it can be.
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

    /// Removes the file: its rows are elsewhere.
    pub(super) fn remove(self) -> Result<()> {
        std::fs::remove_file(&self.path).map_err(|error| Error::io(&self.path, error))
    }
}

/// The first line of a journal, its end included, or what there is of it in one that was cut short
/// within; `None` for what is no journal.
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

/// What a journal was begun with otherwise than `now`, if anything.
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

/// The first setting that differs, by its name, and both values.
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
        // Not while another is at it.
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
        // A digit, a name, a blank, a checksum; what follows is taken over.
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
        // Every single byte, whatever is put in its place.
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
