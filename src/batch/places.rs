//! Where scans stood, roughly.

use std::path::Path;

use super::list::csv_error;
use crate::error::{Error, Result};
use crate::math::Vec3;

/// Names of clouds, and where each of them stood.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Places {
    /// As they are written.
    pub names: Vec<String>,
    /// In any frame and unit, the same of all.
    pub places: Vec<Vec3>,
}

const COLUMNS: [&str; 4] = ["cloud", "x", "y", "z"];

impl Places {
    /// Reads CSV with the columns `cloud`, `x`, `y`, `z`; others are not looked at.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] without these columns, without a cloud in a line, and for
    /// what is no finite number.
    pub fn read(path: &Path) -> Result<Places> {
        let failed = |error| csv_error(path, error);
        let wrong = |line, what: String| Error::parse(path, line, what);
        let mut reader =
            csv::ReaderBuilder::new().comment(Some(b'#')).from_path(path).map_err(failed)?;
        let header = reader.headers().map_err(failed)?;
        let mut columns = [0; 4];
        for (column, name) in columns.iter_mut().zip(COLUMNS) {
            let at = header.iter().position(|title| title.trim() == name);
            *column =
                at.ok_or_else(|| wrong(Some(1), format!("no column {name} in the header")))?;
        }
        let mut found = Places::default();
        let mut record = csv::StringRecord::new();
        while reader.read_record(&mut record).map_err(failed)? {
            let line = record.position().map(|at| at.line() as usize);
            let word = |k: usize| record.get(columns[k]).unwrap_or("").trim();
            if word(0).is_empty() {
                return Err(wrong(line, "cloud is empty".into()));
            }
            let mut place = [0.0; 3];
            for (axis, value) in place.iter_mut().enumerate() {
                let word = word(axis + 1);
                let number = word.parse().ok().filter(|x: &f64| x.is_finite());
                let what = || format!("{} is \"{word}\", not a finite number", COLUMNS[axis + 1]);
                *value = number.ok_or_else(|| wrong(line, what()))?;
            }
            found.names.push(word(0).into());
            found.places.push(place);
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read_by_the_names_of_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            Places::read(&path)
        };
        let found = read("z,cloud,x,yaw,y\n3,a.ply,1, 0, 2\n").unwrap();
        assert_eq!((found.names, found.places), (vec!["a.ply".into()], vec![[1.0, 2.0, 3.0]]));
        let said = |text: &str| read(text).unwrap_err().to_string();
        assert!(said("cloud,x,y\n").contains("no column z"));
        assert!(said("cloud,x,y,z\na,1,2,nan\n").contains("line 2: z is \"nan\""));
        assert!(said("cloud,x,y,z\n,1,2,3\n").contains("cloud is empty"));
    }
}
