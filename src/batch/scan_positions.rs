//! Approximate positions of scans.

use std::path::Path;

use crate::error::Result;
use crate::io::CsvReader;
use crate::io::limited_file::GROWTH_FACTOR;
use crate::math::Vec3;

/// Names of clouds and the position of each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ScanPositions {
    /// Names as in the file.
    pub names: Vec<String>,
    /// Positions in any frame and unit, common to all.
    pub positions: Vec<Vec3>,
}

const COLUMNS: [&str; 4] = ["cloud", "x", "y", "z"];

impl ScanPositions {
    /// Reads CSV with the columns `cloud`, `x`, `y`, `z`; other columns are ignored.
    ///
    /// # Errors
    /// [`Error::Io`](crate::Error::Io); [`Error::Parse`](crate::Error::Parse) without these
    /// columns, for a line without a cloud, and for a coordinate that is not a finite number.
    pub fn read(path: &Path) -> Result<ScanPositions> {
        let mut sheet = CsvReader::open(path)?;
        let mut columns = [0; 4];
        for (column, name) in columns.iter_mut().zip(COLUMNS) {
            *column = sheet.column(name)?;
        }
        let mut found = ScanPositions::default();
        while sheet.next()? {
            let name = sheet.cell(columns[0]);
            if name.is_empty() {
                return Err(sheet.parse_error("cloud is empty"));
            }
            let mut place = [0.0; 3];
            for (axis, value) in place.iter_mut().enumerate() {
                let word = sheet.cell(columns[axis + 1]);
                let number = word.parse().ok().filter(|x: &f64| x.is_finite());
                let what = || format!("{} is \"{word}\", not a finite number", COLUMNS[axis + 1]);
                *value = number.ok_or_else(|| sheet.parse_error(what()))?;
            }
            let name = name.to_string();
            let bytes = name.len() + GROWTH_FACTOR * (size_of::<String>() + size_of::<Vec3>());
            found.names.push(name);
            found.positions.push(place);
            sheet.reserve_memory(bytes)?;
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
            ScanPositions::read(&path)
        };
        let found = read("z,cloud,x,yaw,y\n3,a.ply,1, 0, 2\n").unwrap();
        assert_eq!((found.names, found.positions), (vec!["a.ply".into()], vec![[1.0, 2.0, 3.0]]));
        let said = |text: &str| read(text).unwrap_err().to_string();
        assert!(said("cloud,x,y\n").contains("no column z"));
        assert!(said("cloud,x,y,z\na,1,2,nan\n").contains("line 2: z is \"nan\""));
        assert!(said("cloud,x,y,z\n,1,2,3\n").contains("cloud is empty"));
    }
}
