//! One row of numbers per point, which the full connection compares.

use crate::error::{Error, Result};

/// N descriptors of dimension D, row-major f32: row `i` belongs to point `i`.
///
/// FPFH gives 33 bins a row. Any other embedding (learned features, colours, positions) works the
/// same: the weights depend on distances between rows only.
#[derive(Debug, Clone, PartialEq)]
pub struct Descriptors {
    dim: usize,
    data: Vec<f32>,
}

/// Largest width of descriptors that a cloud carries: learned descriptors have 32 to 512 values.
const MAX_WIDTH: usize = 512;
/// Largest value of descriptors that a cloud carries: squared distances of rows stay finite in f32.
const MAX_VALUE: f32 = 1e15;

impl Descriptors {
    /// Creates descriptors from rows of length `dim`, one after the other in `data`.
    ///
    /// # Errors
    /// [`Error::Shape`] when `dim` is 0 or does not divide `data.len()`,
    /// [`Error::NonFinite`] with the row of the first NaN or infinity.
    ///
    /// ```
    /// let descriptors = cfreg::Descriptors::new(2, vec![0.0, 1.0, 2.0, 3.0])?;
    /// assert_eq!(descriptors.row(1), [2.0, 3.0]);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn new(dim: usize, data: Vec<f32>) -> Result<Self> {
        if dim == 0 || !data.len().is_multiple_of(dim) {
            return Err(Error::Shape {
                what: format!("{} descriptor values in rows of {dim}", data.len()),
                expected: dim.max(1),
                found: data.len().checked_rem(dim).unwrap_or(0),
            });
        }
        match data.iter().position(|value| !value.is_finite()) {
            Some(at) => Err(Error::NonFinite { what: "descriptors".into(), index: at / dim }),
            None => Ok(Descriptors { dim, data }),
        }
    }

    /// Creates both sides of a connection from rows of length `dim` in f64, about their common
    /// mean: distances stay the same, and rows far from zero keep the digits in which they differ.
    ///
    /// # Errors
    /// [`Error::Shape`] as for [`new`](Self::new), [`Error::NonFinite`] with the row of the first
    /// NaN or infinity, [`Error::Config`] for a value beyond ±1e18, whose square exceeds f32.
    ///
    /// ```
    /// let (source, target) = ([1e9, 1e9 + 1.0], [1e9 + 3.0]);
    /// let [source, target] = cfreg::Descriptors::from_f64_pair(1, &source, &target)?;
    /// assert_eq!(target.row(0)[0] - source.row(1)[0], 2.0);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn from_f64_pair(dim: usize, source: &[f64], target: &[f64]) -> Result<[Descriptors; 2]> {
        for (name, side) in [("source_descriptors", source), ("target_descriptors", target)] {
            if let Some(at) = side.iter().position(|value| !value.is_finite()) {
                return Err(Error::NonFinite { what: name.into(), index: at / dim.max(1) });
            }
            if let Some(far) = side.iter().find(|value| value.abs() > 1e18) {
                return Err(Error::config(name, format!("{far:e}"), "must be within +-1e18"));
            }
        }
        let mut mean = vec![0.0; dim];
        let rows = || [source, target].into_iter().flat_map(|side| side.chunks(dim.max(1)));
        let share = 1.0 / rows().count().max(1) as f64;
        for row in rows() {
            mean.iter_mut().zip(row).for_each(|(mean, value)| *mean += share * value);
        }
        let side = |values: &[f64]| {
            let local = values.iter().zip(mean.iter().cycle()).map(|(value, mean)| value - mean);
            Descriptors::new(dim, local.map(|x| x as f32).collect())
        };
        Ok([side(source)?, side(target)?])
    }

    /// Returns the number of rows N.
    pub fn len(&self) -> usize {
        self.data.len() / self.dim
    }

    /// Returns whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Returns the number of values a row, D.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// Returns row `i`, of length D.
    ///
    /// # Panics
    /// When `i` is not below [`len`](Self::len).
    pub fn row(&self, i: usize) -> &[f32] {
        &self.data[i * self.dim..(i + 1) * self.dim]
    }

    /// Returns all rows in order.
    pub fn rows(&self) -> std::slice::ChunksExact<'_, f32> {
        self.data.chunks_exact(self.dim)
    }

    /// Returns the values, row after row.
    pub fn as_slice(&self) -> &[f32] {
        &self.data
    }

    /// Returns the values, row after row, without a copy.
    pub fn into_values(self) -> Vec<f32> {
        self.data
    }

    /// Concatenates the rows of several tables, all divided by the square root of the number of
    /// tables: squared distances are then the mean over the tables, and a bandwidth keeps its
    /// meaning. A single table is unchanged.
    ///
    /// # Errors
    /// [`Error::Shape`] for no table, or a table with another number of rows than the first.
    pub fn concatenate(tables: &[Descriptors]) -> Result<Descriptors> {
        let dim = tables.iter().map(Descriptors::dim).sum();
        let expected = tables.first().map_or(0, Descriptors::len);
        if let Some(other) = tables.iter().find(|table| table.len() != expected) {
            let what = "rows of descriptors to be put beside others".into();
            return Err(Error::Shape { what, expected, found: other.len() });
        }
        let factor = 1.0 / (tables.len() as f64).sqrt();
        let shared = |&value: &f32| (f64::from(value) * factor) as f32;
        let row = |i| tables.iter().flat_map(move |table| table.row(i)).map(shared);
        Descriptors::new(dim, (0..expected).flat_map(row).collect())
    }

    /// Scales every row to length 1, so that squared distances are 2 − 2 cos of the angle between
    /// two rows. A row of zeros stays.
    ///
    /// ```
    /// let descriptors = cfreg::Descriptors::new(2, vec![3.0, 4.0])?;
    /// assert_eq!(descriptors.normalized().row(0), [0.6, 0.8]);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn normalized(&self) -> Descriptors {
        let unit = |row: &[f32]| {
            let square: f64 = row.iter().map(|&x| f64::from(x) * f64::from(x)).sum();
            let factor = if square > 0.0 { 1.0 / square.sqrt() } else { 0.0 };
            row.iter().map(|&x| (f64::from(x) * factor) as f32).collect::<Vec<f32>>()
        };
        Descriptors { dim: self.dim, data: self.rows().flat_map(unit).collect() }
    }

    /// Refuses descriptors that a cloud of that many `points` cannot carry.
    ///
    /// # Errors
    /// [`Error::Shape`] for another number of rows, [`Error::Config`] for rows of more than 512
    /// values, for a value beyond ±1e15, and for a row of zeros, which is no descriptor.
    pub(super) fn check_carried(&self, points: usize) -> Result<()> {
        if self.dim > MAX_WIDTH {
            let rule = format!("values a row: at most {MAX_WIDTH} are possible");
            return Err(Error::config("descriptors", self.dim, rule));
        }
        self.check_count(points)?;
        if let Some(far) = self.data.iter().find(|value| value.abs() > MAX_VALUE) {
            return Err(Error::config("descriptors", far, "must be within +-1e15"));
        }
        match self.rows().position(|row| row.iter().all(|&value| value == 0.0)) {
            Some(row) => {
                let rule = "has zeros only, which is no descriptor: leave that point out";
                Err(Error::config("descriptors", format!("row {row}"), rule))
            }
            None => Ok(()),
        }
    }

    /// Refuses another number of rows than one for each of `points`.
    pub(super) fn check_count(&self, points: usize) -> Result<()> {
        if self.len() == points {
            return Ok(());
        }
        let what = "rows of descriptors for the points of a cloud".into();
        Err(Error::Shape { what, expected: points, found: self.len() })
    }

    /// Returns a row for each of `groups`, the weighted mean of its members' rows, as
    /// `(index, share)` with shares that sum to 1.
    pub(crate) fn means<M>(&self, groups: impl Iterator<Item = M>) -> Descriptors
    where
        M: Iterator<Item = (usize, f64)>,
    {
        let mut data = Vec::new();
        let mut mean = vec![0.0; self.dim];
        for members in groups {
            mean.fill(0.0);
            for (i, share) in members {
                let row = self.row(i);
                mean.iter_mut().zip(row).for_each(|(sum, &x)| *sum += share * f64::from(x));
            }
            data.extend(mean.iter().map(|&x| x as f32));
        }
        Descriptors { dim: self.dim, data }
    }

    /// Returns the rows at `indices`, in that order.
    ///
    /// # Panics
    /// When an index is not below [`len`](Self::len).
    pub fn select(&self, indices: &[usize]) -> Descriptors {
        let data = indices.iter().flat_map(|&i| self.row(i)).copied().collect();
        Descriptors { dim: self.dim, data }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_and_values_are_checked() {
        assert!(matches!(Descriptors::new(0, vec![]), Err(Error::Shape { .. })));
        assert!(matches!(Descriptors::new(3, vec![0.0; 4]), Err(Error::Shape { found: 1, .. })));
        let nan = Descriptors::new(2, vec![0.0, 0.0, 0.0, f32::NAN]);
        assert!(matches!(nan, Err(Error::NonFinite { index: 1, .. })));
        assert!(Descriptors::new(33, vec![]).unwrap().is_empty());
    }

    #[test]
    fn what_f32_cannot_hold_is_refused_by_side() {
        let both =
            |far| Descriptors::from_f64_pair(2, &[0.0; 4], &[0.0, 0.0, 0.0, far]).unwrap_err();
        assert!(matches!(both(f64::NAN), Error::NonFinite { index: 1, .. }));
        let message = "target_descriptors = 1e19: must be within +-1e18";
        assert_eq!(both(1e19).to_string(), message);
        assert!(matches!(Descriptors::from_f64_pair(0, &[1.0], &[]), Err(Error::Shape { .. })));
        assert!(matches!(Descriptors::from_f64_pair(2, &[1.0], &[]), Err(Error::Shape { .. })));
    }

    #[test]
    fn clouds_carry_rows_that_can_be_compared() {
        let rows = |dim, values: Vec<f32>| Descriptors::new(dim, values).unwrap();
        let refused =
            |table: Descriptors, points| table.check_carried(points).unwrap_err().to_string();
        assert!(rows(512, vec![1.0; 1024]).check_carried(2).is_ok());
        let wide = refused(rows(513, vec![1.0; 513]), 1);
        assert_eq!(wide, "descriptors = 513: values a row: at most 512 are possible");
        assert!(refused(rows(2, vec![1.0; 4]), 3).ends_with("expected 3, found 2"));
        let zero = refused(rows(2, vec![1.0, 0.0, 0.0, 0.0]), 2);
        assert!(zero.starts_with("descriptors = row 1: has zeros only"), "{zero}");
        assert!(refused(rows(1, vec![1e16]), 1).contains("within +-1e15"));
    }

    #[test]
    fn means_and_unit_rows_are_those_of_the_rows() {
        let table = Descriptors::new(2, vec![1.0, 0.0, 3.0, 4.0, 0.0, 0.0]).unwrap();
        let groups = [vec![(0, 0.5), (1, 0.5)], vec![(2, 1.0)]];
        let means = table.means(groups.iter().map(|group| group.iter().copied()));
        assert_eq!(means.as_slice(), [2.0, 2.0, 0.0, 0.0]);
        assert_eq!(table.normalized().as_slice(), [1.0, 0.0, 0.6, 0.8, 0.0, 0.0]);
    }

    #[test]
    fn tables_beside_each_other_have_the_mean_of_their_squared_distances() {
        let [a, b] = [[1.0, 2.0, 5.0, 0.0], [0.0, 7.0, 3.0, 3.0]]
            .map(|values| Descriptors::new(2, values.to_vec()).unwrap());
        let square = |table: &Descriptors| -> f32 {
            table.row(0).iter().zip(table.row(1)).map(|(x, y)| (x - y).powi(2)).sum()
        };
        let both = Descriptors::concatenate(&[a.clone(), b.clone()]).unwrap();
        assert_eq!((both.len(), both.dim()), (2, 4));
        assert!((square(&both) - (square(&a) + square(&b)) / 2.0).abs() < 1e-4);
        assert_eq!(Descriptors::concatenate(std::slice::from_ref(&a)).unwrap(), a);
        let short = Descriptors::new(1, vec![1.0]).unwrap();
        for tables in [vec![], vec![a, short]] {
            assert!(matches!(Descriptors::concatenate(&tables), Err(Error::Shape { .. })));
        }
    }
}
