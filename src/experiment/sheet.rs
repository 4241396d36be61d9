//! Tables of results as CSV that know what made them.

use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::io;

/// Writes `rows` as CSV after a comment line with `maker`, all that they depend on, as JSON.
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
    io::write_bytes(path, &[first_line(maker).as_bytes(), b"\n", &body].concat())
}

/// Reads what [`write`] wrote, if it is there, by this very maker, and has `count` rows.
pub(super) fn read<R: DeserializeOwned>(
    path: &Path,
    maker: &impl Serialize,
    count: usize,
) -> Option<Vec<R>> {
    let text = std::fs::read_to_string(path).ok()?;
    let (first, body) = text.split_once('\n')?;
    if first != first_line(maker) {
        return None;
    }
    let rows: Vec<R> =
        csv::Reader::from_reader(body.as_bytes()).deserialize().collect::<Result<_, _>>().ok()?;
    (rows.len() == count).then_some(rows)
}

fn first_line(maker: &impl Serialize) -> String {
    // Plain structs of numbers and words: JSON has them all.
    format!("# {}", serde_json::to_string(maker).unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_back_to_their_maker_only_and_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        #[derive(Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        struct Row {
            number: u32,
            name: String,
            value: Option<f64>,
        }
        let row = |number, name: &str, value| Row { number, name: name.into(), value };
        let rows = vec![row(1, "one", Some(0.1)), row(2, "two, three", None)];
        write(&path, &"maker", &rows).unwrap();
        assert_eq!(read(&path, &"maker", 2), Some(rows));
        assert_eq!(read::<Row>(&path, &"other", 2), None);
        assert_eq!(read::<Row>(&path, &"maker", 3), None);
        let text = std::fs::read(&path).unwrap();
        std::fs::write(&path, &text[..text.len() - 3]).unwrap();
        assert_eq!(read::<Row>(&path, &"maker", 2), None);
    }
}
