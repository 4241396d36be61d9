//! CSV tables of results with their provenance: the first line contains everything that they depend
//! on, as JSON, and the last line contains the number of rows.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::files;
use cfreg::error::{Error, Result};

/// Writes `rows` with their provenance `maker`.
///
/// # Errors
/// [`Error::Io`].
pub(super) fn write<R: Serialize>(path: &Path, maker: &impl Serialize, rows: &[R]) -> Result<()> {
    let failed =
        |error: &dyn std::fmt::Display| Error::io(path, std::io::Error::other(error.to_string()));
    let mut table = csv::Writer::from_writer(Vec::new());
    for row in rows {
        table.serialize(row).map_err(|error| failed(&error))?;
    }
    let body = table.into_inner().map_err(|error| failed(&error))?;
    let (first, last) = (first_line(maker), last_line(rows.len()));
    files::write_bytes(path, &[first.as_bytes(), b"\n", &body, last.as_bytes()].concat())
}

/// Reads the output of [`write`], if it exists, is complete and has the same `maker`.
pub(super) fn read<R: DeserializeOwned>(path: &Path, maker: &impl Serialize) -> Option<Vec<R>> {
    let text = std::fs::read_to_string(path).ok()?;
    let (first, body) = text.split_once('\n')?;
    if first != first_line(maker) {
        return None;
    }
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(body.as_bytes());
    let rows: Vec<R> = reader.deserialize().collect::<Result<_, _>>().ok()?;
    body.ends_with(&last_line(rows.len())).then_some(rows)
}

fn first_line(maker: &impl Serialize) -> String {
    // Plain structs of numbers and strings: JSON can represent them all.
    format!("# {}", serde_json::to_string(maker).unwrap_or_default())
}

fn last_line(rows: usize) -> String {
    format!("# {rows} rows\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_to_their_maker_whole_or_not_at_all() {
        #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        struct Row {
            number: u32,
            name: String,
            value: Option<f64>,
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        let row = |number, name: &str, value| Row { number, name: name.into(), value };
        let rows = vec![row(1, "one", Some(0.1 + 0.2)), row(2, "no \"pose\", why", None)];
        write(&path, &"maker", &rows).unwrap();
        assert_eq!(read(&path, &"maker"), Some(rows));
        assert_eq!(read::<Row>(&path, &"other"), None);
        // Truncated, between rows and within one.
        let text = std::fs::read_to_string(&path).unwrap();
        for end in [text.rfind('#').unwrap(), text.len() - 15, text.len() - 1, 3] {
            std::fs::write(&path, &text[..end]).unwrap();
            assert_eq!(read::<Row>(&path, &"maker"), None, "{end}");
        }
    }
}
