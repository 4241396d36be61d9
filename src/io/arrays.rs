//! Arrays of numbers in NPY files, as NumPy writes them.
//!
//! The crates that read NPY (`npyz`, `ndarray-npy`) bring a parser of Python literals and big
//! integers, and take memory for a header of any length; a header has three entries.

use std::path::Path;

use super::content_error::{ContentError, MAX_HEADER_BYTES, check_claim, quote_start};
use super::load::load;
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
    parse(&content).map_err(|fault| fault.into_error(path))
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

const MAGIC: &[u8] = b"\x93NUMPY";

/// Parses the content of an NPY file (the format of NumPy's `numpy/lib/format.py`, versions 1 to
/// 3).
pub(super) fn parse(content: &[u8]) -> std::result::Result<NumericArray, ContentError> {
    let Some([major, _minor, rest @ ..]) = content.strip_prefix(MAGIC) else {
        return Err(ContentError::byte(0, "is not NPY: it does not start with \\x93NUMPY"));
    };
    let length_bytes = match major {
        1 => 2,
        2 | 3 => 4,
        _ => {
            let what = format!("is NPY of version {major}: versions 1 to 3 are read");
            return Err(ContentError::byte(MAGIC.len(), what));
        }
    };
    let short = || ContentError::byte(content.len(), "ends within its header");
    let (length, rest) = rest.split_at_checked(length_bytes).ok_or_else(short)?;
    let length = length.iter().rev().fold(0usize, |sum, &byte| sum << 8 | usize::from(byte));
    if length > MAX_HEADER_BYTES {
        let what = format!("claims a header of {length} bytes: at most 1 MiB is read");
        return Err(ContentError::byte(MAGIC.len() + 2, what));
    }
    let (header, data) = rest.split_at_checked(length).ok_or_else(short)?;
    let header = Header::parse(&String::from_utf8_lossy(header)).map_err(ContentError::new)?;
    let [rows, columns] = header.shape;
    let size = header.kind.size;
    let row_bytes = (columns as u64).saturating_mul(size as u64);
    check_claim("rows", rows as u64, row_bytes, data.len()).map_err(ContentError::new)?;
    let value = |at: usize| header.kind.value(&data[at * size..][..size]);
    let values = match header.by_columns {
        false => (0..rows * columns).map(value).collect(),
        true => {
            let places = (0..rows).flat_map(|i| (0..columns).map(move |j| j * rows + i));
            places.map(value).collect()
        }
    };
    Ok(NumericArray { shape: header.shape, values })
}

/// The header of an NPY file.
struct Header {
    shape: [usize; 2],
    /// Whether columns follow each other, and not rows.
    by_columns: bool,
    kind: NumberKind,
}

/// Kind of the stored numbers.
#[derive(Clone, Copy)]
struct NumberKind {
    /// `f` for floats, `i` and `u` for integers.
    letter: char,
    /// Bytes of a number.
    size: usize,
    big_endian: bool,
}

impl Header {
    /// Parses a dictionary of Python: `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4)}`.
    fn parse(text: &str) -> std::result::Result<Header, String> {
        let descr = entry(text, "descr")?;
        if descr.starts_with('[') {
            return Err("has named fields: a table of plain numbers is needed".into());
        }
        let quote = descr.chars().next().filter(|&quote| quote == '\'' || quote == '"');
        let kind = quote.and_then(|quote| descr[1..].split(quote).next());
        let kind = NumberKind::parse(kind.unwrap_or(descr))?;
        let order = entry(text, "fortran_order")?;
        let by_columns = match (order.starts_with("True"), order.starts_with("False")) {
            (true, _) => true,
            (_, true) => false,
            _ => return Err(format!("has the fortran_order {}", quote_start(order))),
        };
        let shape = entry(text, "shape")?;
        let bad = || format!("has the shape {}: (N,) or (N, D) is read", quote_start(shape));
        let inner =
            shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).ok_or_else(bad)?;
        let sizes = inner.0.split(',').map(str::trim).filter(|size| !size.is_empty());
        let sizes: Vec<usize> = sizes
            .map(|size| size.trim_end_matches('L').parse().map_err(|_| bad()))
            .collect::<std::result::Result<_, String>>()?;
        let shape = match sizes[..] {
            [rows] => [rows, 1],
            [rows, columns] if columns > 0 => [rows, columns],
            _ => return Err(bad()),
        };
        Ok(Header { shape, by_columns, kind })
    }
}

/// Returns the text of the value of `name`, and all that follows it.
fn entry<'a>(text: &'a str, name: &str) -> std::result::Result<&'a str, String> {
    let quoted = ['\'', '"'].into_iter().find_map(|quote| {
        text.split_once(&format!("{quote}{name}{quote}")).map(|(_, rest)| rest.trim_start())
    });
    let value = quoted.and_then(|rest| rest.strip_prefix(':')).map(str::trim_start);
    value.ok_or_else(|| format!("has a header without {name}: {}", quote_start(text)))
}

impl NumberKind {
    fn parse(text: &str) -> std::result::Result<NumberKind, String> {
        let unknown = || {
            format!(
                "has values of the kind {}: integers of 8 to 64 and floats of 16 to 64 bits are read",
                quote_start(text)
            )
        };
        let mut letters = text.chars();
        let (Some(order), Some(letter)) = (letters.next(), letters.next()) else {
            return Err(unknown());
        };
        let size: usize = letters.as_str().parse().map_err(|_| unknown())?;
        let is_known = match letter {
            'f' => matches!(size, 2 | 4 | 8),
            'i' | 'u' => matches!(size, 1 | 2 | 4 | 8),
            _ => false,
        };
        match is_known && matches!(order, '<' | '>' | '|' | '=') {
            true => Ok(NumberKind { letter, size, big_endian: order == '>' }),
            false => Err(unknown()),
        }
    }

    /// Returns the number in `bytes`, of which there are `size`.
    fn value(self, bytes: &[u8]) -> f64 {
        let bits = |bits: u64, &byte: &u8| bits << 8 | u64::from(byte);
        let bits = match self.big_endian {
            true => bytes.iter().fold(0, bits),
            false => bytes.iter().rev().fold(0, bits),
        };
        match (self.letter, self.size) {
            ('f', 2) => half(bits as u16),
            ('f', 4) => f64::from(f32::from_bits(bits as u32)),
            ('f', _) => f64::from_bits(bits),
            ('i', size) => {
                // The sign bit moves to the top, and back with copies of itself.
                let shift = 64 - 8 * size as u32;
                (((bits << shift) as i64) >> shift) as f64
            }
            _ => bits as f64,
        }
    }
}

/// Returns the value of a float of 16 bits (IEEE 754 binary16).
fn half(bits: u16) -> f64 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    let magnitude = match exponent {
        0 => fraction * 2f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        _ => (1024.0 + fraction) * 2f64.powi(exponent - 25),
    };
    sign * magnitude
}

#[cfg(test)]
mod tests {
    use super::*;

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
        assert_eq!((half(0x0001), half(0x7bff)), (2f64.powi(-24), 65504.0));
        assert!(half(0x7e00).is_nan() && half(0xfc00) == f64::NEG_INFINITY);
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
            ("|b1", "(2, 2)", "the kind \"|b1\""),
            ("<f16", "(2, 2)", "the kind"),
            ("<U3", "(2, 2)", "the kind"),
            ("<f4", "(2, 2, 2)", "(N,) or (N, D)"),
            ("<f4", "()", "(N,) or (N, D)"),
            ("<f4", "(2, 0)", "(N,) or (N, D)"),
            ("<f4", "(-1, 2)", "(N,) or (N, D)"),
            ("<f4", "(18446744073709551615, 2)", "the header claims"),
            ("<f4", "(2, 18446744073709551615)", "the header claims"),
            ("<f4", "(2, 2)", "enough for 1"),
        ] {
            let said = read(descr, "False", shape, &[0; 15]).unwrap_err();
            assert!(said.starts_with("a.npy: ") && said.contains(words), "{said}");
        }
        assert!(read("<f4", "Maybe", "(1, 1)", &[0; 4]).unwrap_err().contains("fortran_order"));
        for bad in [&b""[..], b"PK\x03\x04", b"\x93NUMPY", b"\x93NUMPY\x01\x00\xff\xff{"] {
            assert!(parse(bad).is_err());
        }
        let huge = [MAGIC, &[2, 0, 255, 255, 255, 255]].concat();
        assert!(parse(&huge).is_err());
        let fields = file("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,)}", b"");
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
