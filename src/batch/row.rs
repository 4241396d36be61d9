//! What is told of a pair.

use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use crate::cloud::Transform;
use crate::method::Registration;
use crate::quality::PoseCovariance;

/// One pair: its pose, and how far to trust it. What a method does not tell is `None`, an empty
/// cell in CSV and null in JSON Lines and Parquet; a pair without an answer has `index`,
/// `source`, `target` and `error` alone.
///
/// Columns have the names of the fields, but for `pose`, which is `t00` to `t33`, row by row,
/// `covariance`, which is `cov00`, `cov01` to `cov05`, `cov11` to `cov55`, and `center`, which is
/// `center_x`, `center_y`, `center_z`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Row {
    /// Number of the pair in the list, from 0.
    pub index: usize,
    /// File of the cloud that is moved, as in the list.
    pub source: String,
    /// File of the cloud that stays.
    pub target: String,
    /// Why there is no answer; `None` with one.
    pub error: Option<String>,
    /// Whether there is no ground for doubt.
    pub trusted: Option<bool>,
    /// Grounds for doubt, in words, `; ` between them.
    pub doubts: Option<String>,
    /// `accept`, `ambiguous` or `reject`, of methods that have a verdict.
    pub decision: Option<String>,
    /// Probability that the pose is right, in [0, 1].
    pub probability: Option<f64>,
    /// Share of a surface that lies on the other and faces alike, in [0, 1].
    pub overlap: Option<f64>,
    /// What speaks for and against the pose, in words, `; ` between them.
    pub reasons: Option<String>,
    /// `T_target_source`, 4×4, row by row, a scale included.
    pub pose: Option<[f64; 16]>,
    /// The scale in it; 1 unless it was estimated.
    pub scale: Option<f64>,
    /// Covariance of the pose, upper triangle row by row: rotation vector (radians), then shift
    /// (the target's unit), of a motion about `center` after the pose
    /// ([`PoseCovariance`]).
    pub covariance: Option<[f64; 21]>,
    /// What turns of `covariance` are about, in the target's frame.
    pub center: Option<[f64; 3]>,
    /// Motions, of six, that nothing holds.
    pub undetermined: Option<usize>,
    /// Share of the source points with a target point within `max_distance`, in [0, 1].
    pub fitness: Option<f64>,
    /// Share of the target points with a moved source point within it.
    pub target_fitness: Option<f64>,
    /// Root mean square distance of the source points counted in `fitness`, in the target's unit.
    pub inlier_rmse: Option<f64>,
    /// Largest distance that counts.
    pub max_distance: Option<f64>,
    /// Fitness beyond what a wrong rotation gets by chance, at most 1.
    pub agreement: Option<f64>,
    /// Points of the source handed to the method, after thinning.
    pub source_points: Option<usize>,
    /// Points of the target.
    pub target_points: Option<usize>,
    /// How often weights were made and solved.
    pub iterations: Option<usize>,
    /// Seconds of the registration, its clouds read before. A column only where it is asked for:
    /// no two runs agree on it.
    pub seconds: Option<f64>,
}

impl Row {
    /// A pair about which nothing is known yet.
    pub(super) fn new(index: usize, [source, target]: [&str; 2]) -> Row {
        Row { index, source: source.into(), target: target.into(), ..Row::default() }
    }

    /// Takes over what was found.
    pub(super) fn fill(&mut self, found: &Registration) {
        let Registration { transform, evaluation, points, .. } = found;
        let doubts: Vec<String> = found.doubts.iter().map(ToString::to_string).collect();
        self.trusted = Some(found.trusted);
        self.doubts = Some(doubts.join("; ")).filter(|words| !words.is_empty());
        if let Some(verdict) = &found.verdict {
            self.decision = Some(verdict.decision.to_string());
            self.probability = finite(verdict.probability);
            self.overlap = finite(verdict.overlap);
            self.reasons = Some(verdict.reasons.join("; ")).filter(|words| !words.is_empty());
            if let Some(covariance) = &verdict.covariance {
                self.covariance = Some(triangle(covariance));
                self.center = Some(covariance.center);
                self.undetermined = Some(covariance.undetermined.len());
            }
        }
        self.pose = Some(entries(transform));
        self.scale = finite(transform.scale);
        self.fitness = finite(evaluation.fitness);
        self.target_fitness = finite(evaluation.target_fitness);
        self.inlier_rmse = finite(evaluation.inlier_rmse);
        self.max_distance = finite(evaluation.max_distance);
        self.agreement = finite(evaluation.agreement());
        self.source_points = Some(points.source.used);
        self.target_points = Some(points.target.used);
        self.iterations = Some(found.iterations as usize);
    }

    /// Its cells with the names of their columns, in order: the same for every row.
    pub(super) fn cells(&self, times: bool) -> Vec<(String, Cell<'_>)> {
        let count = |count: Option<usize>| Cell::Count(count.map(|count| count as i64));
        let mut cells: Vec<(String, Cell)> = [
            ("index", count(Some(self.index))),
            ("source", Cell::Text(Some(&self.source))),
            ("target", Cell::Text(Some(&self.target))),
            ("error", Cell::Text(self.error.as_deref())),
            ("trusted", Cell::Flag(self.trusted)),
            ("doubts", Cell::Text(self.doubts.as_deref())),
            ("decision", Cell::Text(self.decision.as_deref())),
            ("probability", Cell::Number(self.probability)),
            ("overlap", Cell::Number(self.overlap)),
            ("reasons", Cell::Text(self.reasons.as_deref())),
        ]
        .map(|(name, cell)| (name.to_string(), cell))
        .into();
        for k in 0..16 {
            let entry = Cell::Number(self.pose.map(|pose| pose[k]));
            cells.push((format!("t{}{}", k / 4, k % 4), entry));
        }
        cells.push(("scale".into(), Cell::Number(self.scale)));
        for (k, (i, j)) in upper().enumerate() {
            let entry = Cell::Number(self.covariance.map(|covariance| covariance[k]));
            cells.push((format!("cov{i}{j}"), entry));
        }
        for (axis, name) in ["center_x", "center_y", "center_z"].into_iter().enumerate() {
            cells.push((name.into(), Cell::Number(self.center.map(|center| center[axis]))));
        }
        let rest = [
            ("undetermined", count(self.undetermined)),
            ("fitness", Cell::Number(self.fitness)),
            ("target_fitness", Cell::Number(self.target_fitness)),
            ("inlier_rmse", Cell::Number(self.inlier_rmse)),
            ("max_distance", Cell::Number(self.max_distance)),
            ("agreement", Cell::Number(self.agreement)),
            ("source_points", count(self.source_points)),
            ("target_points", count(self.target_points)),
            ("iterations", count(self.iterations)),
        ];
        cells.extend(rest.map(|(name, cell)| (name.to_string(), cell)));
        if times {
            cells.push(("seconds".into(), Cell::Number(self.seconds)));
        }
        cells
    }
}

/// What stands in a column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell<'a> {
    Text(Option<&'a str>),
    Flag(Option<bool>),
    Count(Option<i64>),
    Number(Option<f64>),
}

impl Cell<'_> {
    /// As CSV has it, every digit kept; nothing for `None`.
    pub(super) fn word(&self) -> String {
        match self {
            Cell::Text(text) => text.unwrap_or_default().into(),
            Cell::Flag(flag) => flag.map_or_else(String::new, |flag| flag.to_string()),
            Cell::Count(count) => count.map_or_else(String::new, |count| count.to_string()),
            Cell::Number(number) => number.map_or_else(String::new, |x| format!("{x:?}")),
        }
    }
}

impl Serialize for Cell<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Cell::Text(text) => text.serialize(serializer),
            Cell::Flag(flag) => flag.serialize(serializer),
            Cell::Count(count) => count.serialize(serializer),
            Cell::Number(number) => number.serialize(serializer),
        }
    }
}

/// A row as one object without any within, as JSON Lines have it.
pub(super) struct Flat<'a>(pub(super) &'a [(String, Cell<'a>)]);

impl Serialize for Flat<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, cell) in self.0 {
            map.serialize_entry(name, cell)?;
        }
        map.end()
    }
}

/// JSON, in which rows are kept, has neither NaN nor infinity.
fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}

fn entries(transform: &Transform) -> [f64; 16] {
    let matrix = transform.matrix();
    // Adding zero turns -0 into 0.
    std::array::from_fn(|k| matrix[k / 4][k % 4] + 0.0)
}

/// Rows and columns of the upper triangle of a 6×6 matrix.
fn upper() -> impl Iterator<Item = (usize, usize)> {
    (0..6).flat_map(|i| (i..6).map(move |j| (i, j)))
}

fn triangle(covariance: &PoseCovariance) -> [f64; 21] {
    let mut triangle = [0.0; 21];
    for (value, (i, j)) in triangle.iter_mut().zip(upper()) {
        *value = covariance.matrix[i][j];
    }
    triangle
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_comes_back_from_json_to_the_last_bit() {
        let mut row = Row::new(3, ["a,b.ply", "c.ply"]);
        let empty = row.clone();
        row.pose = Some(std::array::from_fn(|k| 1.0 / (k as f64 - 14.5)));
        row.covariance = Some(std::array::from_fn(|k| (k as f64).sqrt() * 1e-300));
        row.center = Some([0.1, 0.2, 0.3]);
        row.seconds = Some(0.1);
        let text = serde_json::to_string(&row).unwrap();
        assert_eq!(serde_json::from_str::<Row>(&text).unwrap(), row);
        // Every row has the same columns of the same kinds.
        let columns = |row: &Row| -> Vec<_> {
            let kind = |cell: &Cell| match cell {
                Cell::Text(_) => "text",
                Cell::Flag(_) => "flag",
                Cell::Count(_) => "count",
                Cell::Number(_) => "number",
            };
            row.cells(true).iter().map(|(name, cell)| (name.clone(), kind(cell))).collect()
        };
        assert_eq!(columns(&row), columns(&empty));
        assert_eq!(row.cells(false).len() + 1, row.cells(true).len());
        let flat = serde_json::to_value(Flat(&row.cells(true))).unwrap();
        assert_eq!((&flat["t33"], &flat["center_z"]), (&2.0.into(), &0.3.into()));
        assert_eq!(flat["cov55"], 20f64.sqrt() * 1e-300);
        assert!(
            flat["error"].is_null() && flat.as_object().unwrap().len() == row.cells(true).len()
        );
    }
}
