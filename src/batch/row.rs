//! The results of a pair.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::cell_reader::CellReader;
use super::columns::{CellValue, Column};
use crate::cloud::Transform;
use crate::math::cholesky::Mat6;
use crate::method::Registration;
use crate::verify::{self, Decision};

/// The pose of one pair and its reliability. Values that a method does not report are `None`, an
/// empty cell in CSV and null in JSON Lines and Parquet; a pair without a pose has `index`,
/// `source`, `target` and `error` alone.
///
/// Columns have the names of the fields, but for `pose`, which is `t00` to `t33`, row by row,
/// `covariance`, which is `cov00`, `cov01` to `cov05`, `cov11` to `cov55`, `information`, which is
/// `info00` to `info55`, and `center`, which is `center_x`, `center_y`, `center_z`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Row {
    /// Number of the pair in the list, from 0.
    pub index: usize,
    /// File of the source cloud, as in the list.
    pub source: String,
    /// File of the target cloud, which is fixed.
    pub target: String,
    /// Why there is no pose; `None` with one.
    pub error: Option<String>,
    /// Whether there are no warnings.
    pub trusted: Option<bool>,
    /// Warnings, in words, `; ` between them.
    pub doubts: Option<String>,
    /// `accept`, `ambiguous`, `uncertain` or `reject`, of methods that have a verdict.
    pub decision: Option<String>,
    /// Probability that the pose is correct, in [0, 1].
    pub probability: Option<f64>,
    /// Overlap: share of a surface that coincides with the other and has similar normals, in [0,
    /// 1].
    pub overlap: Option<f64>,
    /// Evidence for and against the pose, in words, `; ` between the reasons.
    pub reasons: Option<String>,
    /// `T_target_source`, 4×4, row by row, including the scale.
    pub pose: Option<[f64; 16]>,
    /// The scale of the pose; 1 unless it was estimated.
    pub scale: Option<f64>,
    /// Covariance of the pose, upper triangle row by row: rotation vector (radians), then
    /// translation (the target's unit), of a motion about `center` after the pose
    /// ([`PoseCovariance`](verify::PoseCovariance)).
    pub covariance: Option<[f64; 21]>,
    /// Inverse of the covariance, as the weight of a pose graph edge: 0 along unobservable motions.
    pub information: Option<[f64; 21]>,
    /// Center of rotation of both, in the target's frame.
    pub center: Option<[f64; 3]>,
    /// Number of unobservable degrees of freedom, of six.
    pub undetermined: Option<usize>,
    /// Share of the source points with a target point within `max_distance`, in [0, 1].
    pub fitness: Option<f64>,
    /// Share of the target points with a transformed source point within `max_distance`.
    pub target_fitness: Option<f64>,
    /// Root mean square distance of the source points counted in `fitness`, in the target's unit.
    pub inlier_rmse: Option<f64>,
    /// Largest distance of an inlier.
    pub max_distance: Option<f64>,
    /// Chance-corrected fitness: fitness beyond that of a wrong rotation, at most 1.
    pub agreement: Option<f64>,
    /// Points of the source passed to the method, after downsampling.
    pub source_points: Option<usize>,
    /// Points of the target, after downsampling.
    pub target_points: Option<usize>,
    /// Number of iterations: weights computed and solved.
    pub iterations: Option<usize>,
    /// Seconds of the registration, without reading its clouds. A column only on request: it
    /// differs between any two runs.
    pub seconds: Option<f64>,
}

impl Row {
    /// Returns all columns of rows with their names, in order; `times` says whether to include
    /// `seconds`.
    pub fn columns(rows: &[Row], times: bool) -> Vec<(String, Column)> {
        let empty = |(name, cell): (String, CellValue)| {
            let column = match cell {
                CellValue::Text(_) => Column::Text(Vec::new()),
                CellValue::Flag(_) => Column::Flag(Vec::new()),
                CellValue::Count(_) => Column::Count(Vec::new()),
                CellValue::Number(_) => Column::Number(Vec::new()),
            };
            (name, column)
        };
        let mut columns: Vec<_> =
            Row::default().column_values(times).into_iter().map(empty).collect();
        for row in rows {
            for ((_, column), (_, cell)) in columns.iter_mut().zip(row.column_values(times)) {
                column.push(cell);
            }
        }
        columns
    }

    /// Creates the row of a pair without results.
    pub(super) fn new(index: usize, [source, target]: [&str; 2]) -> Row {
        Row { index, source: source.into(), target: target.into(), ..Row::default() }
    }

    /// Copies the results of a registration.
    pub(super) fn set_registration(&mut self, found: &Registration) {
        let Registration { transform, evaluation, points, .. } = found;
        let doubts: Vec<String> = found.doubts.iter().map(ToString::to_string).collect();
        self.trusted = Some(found.trusted);
        self.doubts = Some(doubts.join("; ")).filter(|words| !words.is_empty());
        if let Some(verdict) = &found.verdict {
            self.decision = Some(verdict.decision.to_string());
            self.probability = finite_or_none(verdict.probability);
            self.overlap = finite_or_none(verdict.overlap);
            self.reasons = Some(verdict.reasons.join("; ")).filter(|words| !words.is_empty());
            if let Some(covariance) = &verdict.covariance {
                self.covariance = Some(upper_triangle(&covariance.matrix));
                self.information = covariance.information().as_ref().map(upper_triangle);
                self.center = Some(covariance.center);
                self.undetermined = Some(covariance.unobservable.len());
            }
        }
        self.pose = Some(matrix_entries(transform));
        self.scale = finite_or_none(transform.scale);
        self.fitness = finite_or_none(evaluation.fitness);
        self.target_fitness = finite_or_none(evaluation.target_fitness);
        self.inlier_rmse = finite_or_none(evaluation.inlier_rmse);
        self.max_distance = finite_or_none(evaluation.max_distance);
        self.agreement = finite_or_none(evaluation.chance_corrected_fitness());
        self.source_points = Some(points.source.used);
        self.target_points = Some(points.target.used);
        self.iterations = Some(found.iterations as usize);
    }

    /// Returns the pose; `None` if there is none, or if the numbers are no valid pose.
    pub fn transform(&self) -> Option<Transform> {
        let pose = self.pose?;
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| pose[4 * i + j]));
        Transform::from_matrix(rows).ok()
    }

    /// Returns whether the pose may be used: it has no warnings, a verdict, if present, accepts it,
    /// and it is finite and proper ([`is_usable`](crate::verify::is_usable)).
    pub fn is_usable(&self) -> bool {
        let decision = self.decision.as_deref().map(str::parse::<Decision>).transpose();
        match (self.transform(), decision) {
            (Some(pose), Ok(decision)) if self.error.is_none() => {
                verify::is_usable(&pose, self.trusted == Some(true), decision)
            }
            _ => false,
        }
    }

    /// Returns the bytes of its texts.
    pub(super) fn text_bytes(&self) -> usize {
        let Row { source, target, error, doubts, decision, reasons, .. } = self;
        let words = [error, doubts, decision, reasons].into_iter().flatten();
        [source, target].into_iter().chain(words).map(String::len).sum()
    }

    /// Returns its cells with the names of their columns, in order: the same for every row.
    pub(super) fn column_values(&self, times: bool) -> Vec<(String, CellValue<'_>)> {
        let count = |count: Option<usize>| CellValue::Count(count.map(|count| count as i64));
        let mut cells: Vec<(String, CellValue)> = [
            ("index", count(Some(self.index))),
            ("source", CellValue::Text(Some(&self.source))),
            ("target", CellValue::Text(Some(&self.target))),
            ("error", CellValue::Text(self.error.as_deref())),
            ("trusted", CellValue::Flag(self.trusted)),
            ("doubts", CellValue::Text(self.doubts.as_deref())),
            ("decision", CellValue::Text(self.decision.as_deref())),
            ("probability", CellValue::Number(self.probability)),
            ("overlap", CellValue::Number(self.overlap)),
            ("reasons", CellValue::Text(self.reasons.as_deref())),
        ]
        .map(|(name, cell)| (name.to_string(), cell))
        .into();
        for k in 0..16 {
            let entry = CellValue::Number(self.pose.map(|pose| pose[k]));
            cells.push((format!("t{}{}", k / 4, k % 4), entry));
        }
        cells.push(("scale".into(), CellValue::Number(self.scale)));
        for (name, triangle) in [("cov", self.covariance), ("info", self.information)] {
            for k in 0..21 {
                let number = CellValue::Number(triangle.map(|triangle| triangle[k]));
                cells.push((entry_name(name, k), number));
            }
        }
        for (axis, name) in CENTER_COLUMNS.into_iter().enumerate() {
            cells.push((name.into(), CellValue::Number(self.center.map(|center| center[axis]))));
        }
        let rest = [
            ("undetermined", count(self.undetermined)),
            ("fitness", CellValue::Number(self.fitness)),
            ("target_fitness", CellValue::Number(self.target_fitness)),
            ("inlier_rmse", CellValue::Number(self.inlier_rmse)),
            ("max_distance", CellValue::Number(self.max_distance)),
            ("agreement", CellValue::Number(self.agreement)),
            ("source_points", count(self.source_points)),
            ("target_points", count(self.target_points)),
            ("iterations", count(self.iterations)),
        ];
        cells.extend(rest.map(|(name, cell)| (name.to_string(), cell)));
        if times {
            cells.push(("seconds".into(), CellValue::Number(self.seconds)));
        }
        cells
    }
}

impl Row {
    /// Reads a row from its cells; `get` returns the cell of a column name, as JSON or CSV text.
    ///
    /// # Errors
    /// A message with the column and its error.
    pub(super) fn read(get: impl Fn(&str) -> Option<Value>) -> Result<Row, String> {
        let cells = CellReader::new(get);
        let text = |name: &str| cells.text(name);
        let number = |name: &str| cells.number(name);
        let count = |name: &str| cells.count(name);
        Ok(Row {
            index: cells.needed("index", count)?,
            source: cells.needed("source", text)?,
            target: cells.needed("target", text)?,
            error: text("error")?,
            trusted: cells.flag("trusted")?,
            doubts: text("doubts")?,
            decision: text("decision")?,
            probability: number("probability")?,
            overlap: number("overlap")?,
            reasons: text("reasons")?,
            pose: all_or_none(|k| number(&format!("t{}{}", k / 4, k % 4)))?,
            scale: number("scale")?,
            covariance: all_or_none(|k| number(&entry_name("cov", k)))?,
            information: all_or_none(|k| number(&entry_name("info", k)))?,
            center: all_or_none(|k| number(CENTER_COLUMNS[k]))?,
            undetermined: count("undetermined")?,
            fitness: number("fitness")?,
            target_fitness: number("target_fitness")?,
            inlier_rmse: number("inlier_rmse")?,
            max_distance: number("max_distance")?,
            agreement: number("agreement")?,
            source_points: count("source_points")?,
            target_points: count("target_points")?,
            iterations: count("iterations")?,
            seconds: number("seconds")?,
        })
    }
}

/// Returns all of the numbers, or nothing if one is missing.
fn all_or_none<const N: usize>(
    get: impl Fn(usize) -> Result<Option<f64>, String>,
) -> Result<Option<[f64; N]>, String> {
    let mut all = [0.0; N];
    for (k, value) in all.iter_mut().enumerate() {
        let Some(number) = get(k)? else { return Ok(None) };
        *value = number;
    }
    Ok(Some(all))
}

/// Drops NaN and infinity, which JSON, the format of the journal, cannot hold.
fn finite_or_none(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn matrix_entries(transform: &Transform) -> [f64; 16] {
    let matrix = transform.matrix();
    // Adding zero turns -0 into 0.
    std::array::from_fn(|k| matrix[k / 4][k % 4] + 0.0)
}

const CENTER_COLUMNS: [&str; 3] = ["center_x", "center_y", "center_z"];

/// Returns the name of an entry of an upper triangle.
fn entry_name(name: &str, k: usize) -> String {
    let (i, j) = upper_triangle_indices().nth(k).unwrap_or_default();
    format!("{name}{i}{j}")
}

/// Iterates over rows and columns of the upper triangle of a 6×6 matrix.
pub(super) fn upper_triangle_indices() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i..6).map(move |j| (i, j)))
}

fn upper_triangle(matrix: &Mat6) -> [f64; 21] {
    let mut triangle = [0.0; 21];
    for (value, (i, j)) in triangle.iter_mut().zip(upper_triangle_indices()) {
        *value = matrix[i][j];
    }
    triangle
}

/// Returns the symmetric matrix with that upper triangle.
pub(crate) fn symmetric_from_triangle(triangle: &[f64; 21]) -> Mat6 {
    let mut matrix = [[0.0; 6]; 6];
    for (&value, (i, j)) in triangle.iter().zip(upper_triangle_indices()) {
        matrix[i][j] = value;
        matrix[j][i] = value;
    }
    matrix
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::batch::columns::FlatRow;

    #[test]
    fn a_row_comes_back_from_json_to_the_last_bit() {
        let mut row = Row::new(3, ["a,b.ply", "c.ply"]);
        let empty = row.clone();
        row.pose = Some(std::array::from_fn(|k| 1.0 / (k as f64 - 14.5)));
        row.covariance = Some(std::array::from_fn(|k| (k as f64).sqrt() * 1e-300));
        row.information = Some(std::array::from_fn(|k| k as f64));
        row.center = Some([0.1, 0.2, 0.3]);
        row.seconds = Some(0.1);
        let text = serde_json::to_string(&row).unwrap();
        assert_eq!(serde_json::from_str::<Row>(&text).unwrap(), row);
        // Every row has the same columns of the same types.
        let columns = |row: &Row| -> Vec<_> {
            let kind = |cell: &CellValue| match cell {
                CellValue::Text(_) => "text",
                CellValue::Flag(_) => "flag",
                CellValue::Count(_) => "count",
                CellValue::Number(_) => "number",
            };
            row.column_values(true).iter().map(|(name, cell)| (name.clone(), kind(cell))).collect()
        };
        assert_eq!(columns(&row), columns(&empty));
        let of = Row::columns(&[row.clone(), empty.clone()], true);
        assert_eq!(of[0], ("index".into(), Column::Count(vec![Some(3), Some(3)])));
        assert_eq!(of[1].1, Column::Text(vec![Some("a,b.ply".into()), Some("a,b.ply".into())]));
        assert_eq!(of.last().unwrap().1, Column::Number(vec![Some(0.1), None]));
        assert_eq!(row.column_values(false).len() + 1, row.column_values(true).len());
        let flat = serde_json::to_value(FlatRow(&row.column_values(true))).unwrap();
        assert_eq!((&flat["t33"], &flat["center_z"]), (&2.0.into(), &0.3.into()));
        // Round trip from the written cells.
        let read = |cells: &[(String, CellValue)]| {
            let words: HashMap<_, _> =
                cells.iter().map(|(name, cell)| (name, cell.to_csv())).collect();
            Row::read(|name| words.get(&name.to_string()).map(|word| word.as_str().into()))
        };
        assert_eq!(Row::read(|name| flat.get(name).cloned()), Ok(row.clone()));
        assert_eq!(read(&row.column_values(true)), Ok(row.clone()));
        assert_eq!(read(&empty.column_values(false)), Ok(empty.clone()));
        let broken = |column: &'static str, value: Value| {
            let get =
                |name: &str| Some(if name == column { &value } else { flat.get(name)? }.clone());
            Row::read(get).unwrap_err()
        };
        assert!(broken("t00", "x".into()).contains("column t00: \"x\" is not a number"));
        assert!(broken("t00", "\0".repeat(9999).into()).len() < 400);
        assert!(broken("undetermined", (-1).into()).contains("not a count"));
        assert!(broken("source", Value::Null).contains("nothing in it"));
        assert_eq!(flat["cov55"], 20f64.sqrt() * 1e-300);
        assert!(
            flat["error"].is_null()
                && flat.as_object().unwrap().len() == row.column_values(true).len()
        );
    }
}
