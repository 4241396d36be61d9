//! Tables of numbers in NPY files: descriptors and correspondences.

use std::path::Path;

use super::content_error::ContentError;
use super::load::load;
use super::npy::Array;
use crate::cloud::Descriptors;
use crate::error::{Error, Result};

/// A table of numbers, (N, D), row after row.
#[derive(Debug, Clone, PartialEq)]
pub struct NumericArray {
    shape: [usize; 2],
    values: Vec<f64>,
}

/// Indices of a source and of a target point each, and one score each, if there are any.
pub type ScoredPairs = (Vec<(u32, u32)>, Option<Vec<f32>>);

/// Reads a table of numbers from an NPY file: integers of 8 to 64 bits, floats of 16 to 64 bits, in
/// either byte order, by rows or by columns. A one-dimensional array is a table of one column.
///
/// # Errors
/// [`Error::Io`] when the file cannot be read, [`Error::Parse`] when it is not NPY, or holds no
/// numbers or more than two dimensions.
///
/// ```no_run
/// let table = cfreg::io::read_array("features.npy")?;
/// println!("{:?}", table.shape());
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn read_array(path: impl AsRef<Path>) -> Result<NumericArray> {
    let path = path.as_ref();
    let content = load(path)?;
    parse(&content).map_err(|fault| fault.in_format("NPY").into_error(path))
}

/// Reads descriptors, (N, D), one row a point, from an NPY file; see [`read_array`].
///
/// # Errors
/// Those of [`read_array`], and [`Error::NonFinite`] for a value that is not finite in f32.
pub fn read_descriptors(path: impl AsRef<Path>) -> Result<Descriptors> {
    let NumericArray { shape: [_, width], values } = read_array(&path)?;
    let rows = Descriptors::new(width, values.into_iter().map(|x| x as f32).collect());
    rows.map_err(|error| match error {
        Error::NonFinite { index, .. } => {
            Error::NonFinite { what: path.as_ref().display().to_string(), index }
        }
        other => other,
    })
}

/// Reads correspondences from an NPY file: a row of the source and a row of the target each, from
/// 0, (M, 2), and optionally a score each, (M, 3).
///
/// # Errors
/// Those of [`read_array`], and [`Error::Parse`] for another number of columns and for an index
/// that is not a whole number from 0 to 2³² − 1.
pub fn read_correspondences(path: impl AsRef<Path>) -> Result<ScoredPairs> {
    let path = path.as_ref();
    read_array(path)?.into_pairs().map_err(|fault| fault.into_error(path))
}

impl NumericArray {
    /// Returns the numbers of rows and columns.
    pub fn shape(&self) -> [usize; 2] {
        self.shape
    }

    /// Returns the values, row after row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    fn into_pairs(self) -> std::result::Result<ScoredPairs, ContentError> {
        let [_, columns] = self.shape;
        if !matches!(columns, 2 | 3) {
            let what = format!(
                "has rows of {columns} numbers: correspondences have a row of the source and one \
                 of the target, and optionally a score"
            );
            return Err(ContentError::new(what));
        }
        let index = |row: usize, value: f64| match value >= 0.0
            && value <= f64::from(u32::MAX)
            && value.fract() == 0.0
        {
            true => Ok(value as u32),
            false => {
                let what = format!("correspondence {row} has {value}, which is no row from 0 on");
                Err(ContentError::new(what))
            }
        };
        let rows = self.values.chunks_exact(columns);
        let pair = |(k, row): (usize, &[f64])| Ok((index(k, row[0])?, index(k, row[1])?));
        let pairs = rows.clone().enumerate().map(pair).collect::<Result<_, ContentError>>()?;
        Ok((pairs, (columns == 3).then(|| rows.map(|row| row[2] as f32).collect())))
    }
}

/// Parses the content of an NPY file.
pub(super) fn parse(content: &[u8]) -> std::result::Result<NumericArray, ContentError> {
    let array = Array::parse(content)?;
    let refuse = |what: String| Err(ContentError::byte(array.start, what));
    if array.fields.len() != 1 || array.fields[0].name.is_some() {
        return refuse("has named fields: a table of plain numbers is needed".into());
    }
    let shape = match array.shape[..] {
        [rows] => [rows, 1],
        [rows, columns] if columns > 0 => [rows, columns],
        _ => return refuse(format!("has the shape {:?}: (N,) or (N, D) is read", array.shape)),
    };
    let [rows, columns] = shape;
    let places = (0..rows * columns).map(|at| (at / columns, at % columns));
    let values = places.map(|(row, column)| array.at(row, column, shape)).collect();
    Ok(NumericArray { shape, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAGIC: &[u8] = b"\x93NUMPY";

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    fn read(descr: &str, order: &str, shape: &str, data: &[u8]) -> Result<Vec<f64>, String> {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        match parse(&file(&header, data)) {
            Ok(table) => Ok(table.values),
            Err(fault) => Err(fault.into_error(Path::new("a.npy")).to_string()),
        }
    }

    #[test]
    fn every_kind_of_number_is_read() {
        let numbers = [1.0, -2.0, 0.5];
        let doubles: Vec<u8> = numbers.iter().flat_map(|x: &f64| x.to_le_bytes()).collect();
        let big: Vec<u8> = numbers.iter().flat_map(|&x| (x as f32).to_be_bytes()).collect();
        let halves: Vec<u8> =
            [0x3c00u16, 0xc000, 0x3800].iter().flat_map(|x| x.to_le_bytes()).collect();
        for (descr, data) in [("<f8", &doubles), (">f4", &big), ("<f2", &halves)] {
            assert_eq!(read(descr, "False", "(3,)", data).unwrap(), numbers, "{descr}");
        }
        assert_eq!(read("|i1", "False", "(3L, 1)", &[1, 254, 128]).unwrap(), [1.0, -2.0, -128.0]);
        assert_eq!(read("|u1", "False", "(1, 2)", &[1, 254]).unwrap(), [1.0, 254.0]);
        assert_eq!(read(">i2", "False", "(1,)", &[0xff, 0xfe]).unwrap(), [-2.0]);
        let large = read("<u8", "False", "(1,)", &u64::MAX.to_le_bytes()).unwrap();
        assert_eq!(large, [u64::MAX as f64]);
    }

    #[test]
    fn columns_become_rows() {
        let columns = [1, 2, 3, 4, 5, 6];
        let rows = read("|u1", "True", "(2, 3)", &columns).unwrap();
        assert_eq!(rows, [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]);
        assert!(read("|u1", "False", "(0, 3)", &[]).unwrap().is_empty());
    }

    #[test]
    fn other_content_is_named() {
        for (descr, shape, words) in [
            ("<f16", "(2, 2)", "the type \"<f16\""),
            ("<U3", "(2, 2)", "the type"),
            ("<f4", "(2, 2, 2)", "cut short"),
            ("<f4", "(1, 1, 2)", "(N,) or (N, D)"),
            ("<f4", "()", "(N,) or (N, D)"),
            ("<f4", "(2, 0)", "(N,) or (N, D)"),
            ("<f4", "(-1, 2)", "shape is no tuple"),
            ("<f4", "(18446744073709551615, 2)", "dictionary"),
            ("<f4", "(2, 9223372036854775807)", "cut short"),
            ("<f4", "(2, 2)", "cut short"),
        ] {
            let said = read(descr, "False", shape, &[0; 15]).unwrap_err();
            assert!(said.starts_with("a.npy, byte ") && said.contains(words), "{said}");
        }
        assert!(read("<f4", "Maybe", "(1, 1)", &[0; 4]).is_err());
        for bad in [&b""[..], b"PK\x03\x04", b"\x93NUMPY", b"\x93NUMPY\x01\x00\xff\xff{"] {
            assert!(parse(bad).is_err());
        }
        let huge = [MAGIC, &[2, 0, 255, 255, 255, 255]].concat();
        assert!(parse(&huge).is_err());
        let fields =
            file("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,)}", &[0; 4]);
        assert!(format!("{:?}", parse(&fields)).contains("named fields"));
    }

    #[test]
    fn correspondences_are_whole_numbers() {
        let table = |columns, values: &[f64]| NumericArray {
            shape: [values.len() / columns, columns],
            values: values.to_vec(),
        };
        let (pairs, scores) =
            table(3, &[0.0, 7.0, 0.5, 4294967295.0, 1.0, 2.0]).into_pairs().unwrap();
        assert_eq!((pairs, scores), (vec![(0, 7), (u32::MAX, 1)], Some(vec![0.5, 2.0])));
        assert_eq!(table(2, &[1.0, 2.0]).into_pairs().unwrap(), (vec![(1, 2)], None));
        for bad in [-1.0, 0.5, f64::NAN, 4294967296.0] {
            assert!(table(2, &[bad, 0.0]).into_pairs().is_err(), "{bad}");
        }
        assert!(table(4, &[0.0; 4]).into_pairs().is_err());
    }
}
