//! CSV tables, read row by row with columns found by name.

use std::collections::HashMap;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};

use csv_core::ReadRecordResult;

use super::limited_file::{LimitedFile, MAX_RECORD_BYTES, MemoryBudget, mebibytes, too_large};
use crate::error::{Error, Result};

/// Most columns of a table. Chosen by hand, far above the number that programs write.
const COLUMNS: usize = 1 << 20;

/// A table read row by row; lines that begin with `#` are comments.
pub(crate) struct CsvReader {
    path: PathBuf,
    reader: BufReader<LimitedFile>,
    parser: csv_core::Reader,
    /// The column of each name; the first column of a repeated name counts.
    columns: HashMap<String, usize>,
    width: usize,
    /// The cells of the current row, concatenated, in UTF-8, and the end of each. Both buffers are
    /// longer than the row.
    text: Vec<u8>,
    ends: Vec<usize>,
    /// Number of cells in the current row.
    cells: usize,
    line: usize,
    budget: MemoryBudget,
}

impl CsvReader {
    /// Opens a table and reads its column names.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] for a header that is not text.
    pub(crate) fn open(path: &Path) -> Result<CsvReader> {
        let file = LimitedFile::open(path)?;
        let mut sheet = CsvReader {
            path: path.to_path_buf(),
            budget: file.budget(),
            reader: BufReader::with_capacity(1 << 16, file),
            parser: csv_core::ReaderBuilder::new().comment(Some(b'#')).build(),
            columns: HashMap::new(),
            width: 0,
            text: vec![0; 256],
            ends: vec![0; 32],
            cells: 0,
            line: 1,
        };
        if sheet.record()? {
            sheet.width = sheet.cells;
            for column in 0..sheet.width {
                let name = sheet.cell(column).to_string();
                sheet.columns.entry(name).or_insert(column);
            }
        }
        Ok(sheet)
    }

    /// Reads the next row; `false` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] for a row whose number of cells differs from the header's.
    pub(crate) fn next(&mut self) -> Result<bool> {
        if !self.record()? {
            return Ok(false);
        }
        let (found, width) = (self.cells, self.width);
        if found != width {
            return Err(self.parse_error(format!("{found} values where the header has {width}")));
        }
        Ok(true)
    }

    /// Returns the column of that name.
    ///
    /// # Errors
    /// [`Error::Parse`] if there is none.
    pub(crate) fn column(&self, name: &str) -> Result<usize> {
        let missing =
            || Error::parse(&self.path, Some(1), format!("no column {name} in the header"));
        self.columns.get(name).copied().ok_or_else(missing)
    }

    /// Returns the trimmed cell of the current row in a column.
    pub(crate) fn cell(&self, column: usize) -> &str {
        let from = column.checked_sub(1).map_or(0, |before| self.ends[before]);
        std::str::from_utf8(&self.text[from..self.ends[column]]).unwrap_or_default().trim()
    }

    /// Returns the cell in the column of that name, if there is one.
    pub(crate) fn find(&self, name: &str) -> Option<&str> {
        self.columns.get(name).map(|&column| self.cell(column))
    }

    /// Returns the first line of the current row.
    pub(crate) fn line(&self) -> usize {
        self.line
    }

    /// Creates an error in the current row.
    pub(crate) fn parse_error(&self, what: impl Into<String>) -> Error {
        Error::parse(&self.path, Some(self.line), what)
    }

    /// Counts memory taken for the current row.
    ///
    /// # Errors
    /// [`Error::Parse`] if the table takes more than its size allows.
    pub(crate) fn reserve_memory(&mut self, bytes: usize) -> Result<()> {
        self.budget.reserve(bytes).map_err(|what| Error::parse(&self.path, None, what))
    }

    /// Reads the next record, of any width.
    fn record(&mut self) -> Result<bool> {
        let failed = |error| Error::io(&self.path, error);
        let (mut length, mut cells) = (0, 0);
        self.line = self.parser.line() as usize;
        let result = loop {
            let input = match self.reader.fill_buf() {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                input => input.map_err(failed)?,
            };
            let (text, ends) = (&mut self.text[length..], &mut self.ends[cells..]);
            let (result, read, written, ended) = self.parser.read_record(input, text, ends);
            self.reader.consume(read);
            length += written;
            cells += ended;
            match result {
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::OutputFull if length < MAX_RECORD_BYTES => {
                    self.text.resize((2 * length).min(MAX_RECORD_BYTES), 0);
                }
                ReadRecordResult::OutputFull => {
                    let most = mebibytes(MAX_RECORD_BYTES as u64);
                    let what = format!("the row from line {} on has more than {most}", self.line);
                    return Err(failed(too_large(what)));
                }
                ReadRecordResult::OutputEndsFull if cells < COLUMNS => {
                    self.ends.resize((2 * cells).min(COLUMNS), 0);
                }
                ReadRecordResult::OutputEndsFull => {
                    let what = format!("line {} has more than {COLUMNS} columns", self.line);
                    return Err(failed(too_large(what)));
                }
                ReadRecordResult::Record | ReadRecordResult::End => break result,
            }
        };
        self.cells = cells;
        let text = &self.text[..length];
        let within = |&end: &usize| text.get(end).is_some_and(|byte| byte & 0xc0 == 0x80);
        if std::str::from_utf8(text).is_err() || self.ends[..cells].iter().any(within) {
            return Err(self.parse_error("is not UTF-8 text"));
        }
        Ok(matches!(result, ReadRecordResult::Record))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(text: &[u8]) -> (tempfile::TempDir, Result<CsvReader>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(&path, text).unwrap();
        let sheet = CsvReader::open(&path);
        (folder, sheet)
    }

    #[test]
    fn cells_are_found_by_name() {
        let text = "\u{feff}# what\nb, a ,\"c\",b\r\n1,\" x,\"\"y\"\" \n\",é,4\n\n5,6,7,8";
        let (_folder, sheet) = open(text.as_bytes());
        let mut sheet = sheet.unwrap();
        assert!(sheet.next().unwrap());
        assert_eq!(
            (sheet.find("a"), sheet.find("b"), sheet.find("c"), sheet.find("d")),
            (Some("x,\"y\""), Some("1"), Some("é"), None)
        );
        assert!(sheet.next().unwrap() && sheet.find("c") == Some("7"));
        assert!(!sheet.next().unwrap() && !sheet.next().unwrap());
        assert!(sheet.column("d").unwrap_err().to_string().contains("no column d"));
    }

    #[test]
    fn broken_tables_are_errors() {
        let (_folder, sheet) = open(b"");
        assert!(!sheet.unwrap().next().unwrap());
        let (_folder, sheet) = open(b"a,b\n1,2\n3\n");
        let mut sheet = sheet.unwrap();
        assert!(sheet.next().unwrap());
        let said = sheet.next().unwrap_err().to_string();
        assert!(said.contains("line 3: 1 values where the header has 2"), "{said}");
        for text in [&b"a,\xff\n"[..], b"\xc3,\xa9\n"] {
            assert!(open(text).1.err().unwrap().to_string().contains("not UTF-8"));
        }
        let long = vec![b'x'; MAX_RECORD_BYTES + 1];
        assert!(open(&long).1.err().unwrap().to_string().contains("more than 16 MiB"));
        let wide = vec![b','; COLUMNS];
        assert!(open(&wide).1.err().unwrap().to_string().contains("columns"));
    }

    #[test]
    fn a_wide_table_takes_linear_time() {
        let mut text: String = (0..70_000).map(|k| format!("c{k},")).collect();
        text += "end\n";
        for _ in 0..20 {
            text += &"1,".repeat(70_000);
            text += "1\n";
        }
        let start = std::time::Instant::now();
        let (_folder, sheet) = open(text.as_bytes());
        let mut sheet = sheet.unwrap();
        while sheet.next().unwrap() {
            assert_eq!(sheet.find("c69999"), Some("1"));
        }
        assert!(start.elapsed().as_secs_f64() < 2.0, "{:?}", start.elapsed());
    }
}
