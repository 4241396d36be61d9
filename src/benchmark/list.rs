//! Lists of pairs with known poses: CSV, and the `gt.log` of 3DMatch.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use crate::cloud::Transform;
use crate::error::{Error, Result};
use crate::io::limited_file::{self, LimitedFile};
use crate::io::{CsvReader, quote_start};

/// Two clouds and the pose between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// Data set of the pair; pairs of a set are counted together.
    pub dataset: String,
    /// File of the source cloud.
    pub source: PathBuf,
    /// File of the target cloud, which is fixed.
    pub target: PathBuf,
    /// Source into target frame; `None` for unrelated clouds.
    pub truth: Option<Transform>,
    /// Share of the source that the target also covers, if known.
    pub overlap: Option<f64>,
    /// The clouds' unit in metres.
    pub unit: f64,
}

impl Pair {
    /// Returns the bytes of memory of a pair in a list.
    fn bytes(&self) -> usize {
        let texts = [self.source.as_os_str().len(), self.target.as_os_str().len()];
        limited_file::GROWTH_FACTOR * size_of::<Pair>() + self.dataset.len() + texts[0] + texts[1]
    }
}

/// A table of pairs with poses, with columns found by name.
pub(super) struct PairTable(CsvReader);

impl PairTable {
    /// Opens a table before its first row.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] without the columns `source`, `target`, `t00` to `t33`.
    pub(super) fn open(path: &Path) -> Result<PairTable> {
        let sheet = CsvReader::open(path)?;
        let entries = (0..16).map(entry_name);
        for name in ["source", "target"].into_iter().map(String::from).chain(entries) {
            sheet.column(&name)?;
        }
        Ok(PairTable(sheet))
    }

    /// Reads the next row; `false` at the end.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`].
    pub(super) fn next(&mut self) -> Result<bool> {
        self.0.next()
    }

    /// Counts memory taken for the current row.
    ///
    /// # Errors
    /// [`Error::Parse`] if the table takes more than its size allows.
    pub(super) fn take(&mut self, bytes: usize) -> Result<()> {
        self.0.reserve_memory(bytes)
    }

    /// Returns the text in the column `name`; empty if there is none.
    pub(super) fn text(&self, name: &str) -> &str {
        self.0.find(name).unwrap_or("")
    }

    /// Returns the number in the column `name`, if there is one.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>> {
        match self.text(name) {
            "" => Ok(None),
            text => match text.parse() {
                Ok(number) => Ok(Some(number)),
                Err(_) => Err(self.wrong(format!("{name} is {}, no number", quote_start(text)))),
            },
        }
    }

    /// Returns the pose, if there is one.
    pub(super) fn pose(&self) -> Result<Option<Transform>> {
        if (0..16).all(|k| self.text(&entry_name(k)).is_empty()) {
            return Ok(None);
        }
        let mut matrix = [[0.0; 4]; 4];
        for (k, value) in matrix.as_flattened_mut().iter_mut().enumerate() {
            let missing = || self.wrong(format!("{} is empty", entry_name(k)));
            *value = self.number(&entry_name(k))?.ok_or_else(missing)?;
        }
        Transform::from_matrix(matrix).map(Some).map_err(|error| self.wrong(error.to_string()))
    }

    /// Creates an error in this row.
    pub(super) fn wrong(&self, what: String) -> Error {
        self.0.parse_error(what)
    }

    /// Returns the line of the current row.
    pub(super) fn line(&self) -> usize {
        self.0.line()
    }
}

/// Returns the name of the k-th entry of a pose, row by row.
fn entry_name(k: usize) -> String {
    format!("t{}{}", k / 4, k % 4)
}

/// Reads a list.
///
/// CSV needs a header with `source`, `target` (files, relative to `folder`) and `t00` to `t33`
/// (T_target_source, row by row); `dataset`, `overlap` (a share) and `units` (`m`, `cm` or `mm`)
/// are optional. A row whose pose is empty, or whose overlap is 0, is a pair of unrelated clouds.
///
/// A file whose name ends in `.log` is read as 3DMatch's: for each pair a line with the numbers of
/// target and source and four of the pose; the clouds are `cloud_bin_N.ply` beside it, or in the
/// folder of the same name without `-evaluation`, as in the full data sets.
///
/// # Errors
/// [`Error::Io`], and [`Error::Parse`] with the invalid line.
pub fn read(path: &Path, folder: &Path) -> Result<Vec<Pair>> {
    let pairs = match path.extension().is_some_and(|end| end == "log") {
        true => read_log(path, BufReader::new(LimitedFile::open(path)?))?,
        false => read_csv(path, folder)?,
    };
    if pairs.is_empty() {
        return Err(parse_error(path, 1, "no pair"));
    }
    Ok(pairs)
}

fn parse_error(path: &Path, line: usize, what: impl Into<String>) -> Error {
    Error::parse(path, Some(line), what)
}

fn read_csv(path: &Path, folder: &Path) -> Result<Vec<Pair>> {
    let mut pairs = Vec::new();
    let mut row = PairTable::open(path)?;
    while row.next()? {
        let overlap = row.number("overlap")?;
        let truth = if overlap == Some(0.0) { None } else { row.pose()? };
        let unit = match row.text("units") {
            "" | "m" => 1.0,
            "cm" => 0.01,
            "mm" => 0.001,
            other => {
                return Err(row.wrong(format!("unit {}: must be m, cm or mm", quote_start(other))));
            }
        };
        let dataset = Some(row.text("dataset")).filter(|set| !set.is_empty()).unwrap_or("pairs");
        let pair = Pair {
            dataset: dataset.into(),
            source: folder.join(row.text("source")),
            target: folder.join(row.text("target")),
            truth,
            overlap,
            unit,
        };
        row.take(pair.bytes())?;
        pairs.push(pair);
    }
    Ok(pairs)
}

/// Reads the next line of numbers of a log, with its line number; blank lines are skipped.
fn read_numbers(
    path: &Path,
    reader: &mut impl BufRead,
    line: &mut usize,
) -> Result<Option<(usize, Vec<f64>)>> {
    let mut bytes = Vec::new();
    while limited_file::read_line(reader, &mut bytes).map_err(|error| Error::io(path, error))? {
        *line += 1;
        let text =
            std::str::from_utf8(&bytes).map_err(|_| parse_error(path, *line, "is not text"))?;
        // A row of a pose has four, the line before it two or more.
        let words = text.split_whitespace().take(5).map(|word| {
            word.parse().map_err(|_| {
                parse_error(path, *line, format!("{} is no number", quote_start(word)))
            })
        });
        let numbers = words.collect::<Result<Vec<f64>>>()?;
        if !numbers.is_empty() {
            return Ok(Some((*line, numbers)));
        }
    }
    Ok(None)
}

fn read_log(path: &Path, mut reader: impl BufRead) -> Result<Vec<Pair>> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let set = dataset_name(folder)?;
    let scene = set.strip_suffix("-evaluation").unwrap_or(&set);
    let file = |number: f64| {
        let cloud = format!("cloud_bin_{number}.ply");
        let beside = folder.join(&cloud);
        match folder.file_name() {
            _ if scene == set || beside.exists() => beside,
            Some(_) => folder.with_file_name(scene).join(cloud),
            None => folder.join("..").join(scene).join(cloud),
        }
    };
    let (mut pairs, mut line) = (Vec::new(), 0);
    while let Some((at, head)) = read_numbers(path, &mut reader, &mut line)? {
        let mut matrix = [[0.0; 4]; 4];
        for row in &mut matrix {
            let next = read_numbers(path, &mut reader, &mut line)?.filter(|_| head.len() >= 2);
            let (line, words) = next.ok_or_else(|| {
                parse_error(path, at, "a pair is a line with two numbers and four of a pose")
            })?;
            *row = words[..]
                .try_into()
                .map_err(|_| parse_error(path, line, "a row of a pose has four numbers"))?;
        }
        pairs.push(Pair {
            dataset: scene.into(),
            source: file(head[1]),
            target: file(head[0]),
            truth: Some(
                Transform::from_matrix(matrix)
                    .map_err(|error| parse_error(path, at, error.to_string()))?,
            ),
            overlap: None,
            unit: 1.0,
        });
    }
    Ok(pairs)
}

/// Returns the name of a folder, also if its path ends in dots, or is empty.
fn dataset_name(folder: &Path) -> Result<String> {
    let whole = match folder.file_name() {
        Some(_) => folder.to_path_buf(),
        None => {
            let dots = Path::new(".").join(folder);
            dots.canonicalize().map_err(|error| Error::io(&dots, error))?
        }
    };
    // The root folder has no name.
    Ok(whole.file_name().map_or("pairs".into(), |name| name.to_string_lossy().into_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str =
        "source,target,t00,t01,t02,t03,t10,t11,t12,t13,t20,t21,t22,t23,t30,t31,t32,t33";

    fn read_text(name: &str, text: &str) -> Result<Vec<Pair>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        read(&path, folder.path())
    }

    #[test]
    fn a_table_is_read_with_what_it_has() {
        let row = "a.ply,b.ply,1,0,0,5,0,1,0,0,0,0,1,0,0,0,0,1";
        let pairs = read_text("p.csv", &format!("{HEADER}\n{row}\n")).unwrap();
        assert_eq!(pairs[0].truth.unwrap().translation, [5.0, 0.0, 0.0]);
        assert_eq!((pairs[0].unit, pairs[0].overlap), (1.0, None));
        assert!(pairs[0].source.ends_with("a.ply") && pairs[0].dataset == "pairs");
        let text =
            format!("dataset,{HEADER},overlap,units\nx,{row},0.5,cm\ny,a,b,,,,,,,,,,,,,,,,,,mm\n");
        let pairs = read_text("p.csv", &text).unwrap();
        assert_eq!((pairs[0].overlap, pairs[0].unit), (Some(0.5), 0.01));
        assert_eq!((pairs[1].truth, pairs[1].unit), (None, 0.001));
    }

    #[test]
    fn a_log_names_target_and_source() {
        let text = "0\t 2\t 60\n1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n";
        let pairs = read_text("gt.log", text).unwrap();
        assert!(pairs[0].source.ends_with("cloud_bin_2.ply"));
        assert!(pairs[0].target.ends_with("cloud_bin_0.ply"));
        assert_eq!(pairs[0].truth.unwrap().translation, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_log_is_the_set_that_its_folder_is_called() {
        let text = "0 2 60\n1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n";
        let first = |path: &str| read_log(Path::new(path), text.as_bytes()).unwrap().remove(0);
        let pair = first("rooms/kitchen-evaluation/gt.log");
        assert_eq!(pair.dataset, "kitchen");
        assert_eq!(pair.source, Path::new("rooms/kitchen/cloud_bin_2.ply"));
        // The path does not contain the folder's name.
        let here = std::env::current_dir().unwrap();
        let here = here.file_name().unwrap().to_string_lossy();
        for path in ["gt.log", "./gt.log", "src/../gt.log"] {
            assert_eq!(first(path).dataset, here, "{path}");
        }
        assert_eq!(first("gt.log").source, Path::new("cloud_bin_2.ply"));
    }

    #[test]
    fn what_cannot_be_understood_is_named() {
        let said = |name, text: &str| read_text(name, text).unwrap_err().to_string();
        assert!(said("p.csv", "source,target\na,b\n").contains("t00"));
        let bad = format!("{HEADER}\na,b,1,0,0,x,0,1,0,0,0,0,1,0,0,0,0,1\n");
        assert!(said("p.csv", &bad).contains("\"x\""));
        let long = "w".repeat(10_000);
        let unit = format!("units,{HEADER}\n{long},a,b,1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n");
        for (name, text) in
            [("gt.log", &long), ("p.csv", &bad.replace('x', &long)), ("p.csv", &unit)]
        {
            assert!(said(name, text).len() < 300, "{name}");
        }
        let mirrored = format!("{HEADER}\na,b,-1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1\n");
        assert!(read_text("p.csv", &mirrored).is_err());
        assert!(said("p.csv", HEADER).contains("no pair"));
        assert!(said("gt.log", "0 1 2\n1 0 0\n").contains("line"));
        assert!(
            said("gt.log", "0 1 2\n1 0 0\n0 1 0 2\n0 0 1 3\n0 0 0 1\n").contains("four numbers")
        );
    }
}
