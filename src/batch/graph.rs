//! The pose graph of the rows of a list.

use std::path::Path;

use super::Row;
use super::row::symmetric_from_triangle;
use crate::error::{Error, Result};
use crate::io;
use crate::pose_graph::{PoseEdge, PoseGraph};

/// The pose graph of the rows of a list, and the numbers of rows without an edge.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct RowGraph {
    /// One edge for each row whose pose may be used ([`Row::is_usable`]). Clouds are numbered in
    /// the order of first use, including those without an edge.
    pub graph: PoseGraph,
    /// Rows whose pose may not be used, or that have none.
    pub not_accepted: usize,
    /// Rows whose pose may be used but is left out: without a covariance (of methods without a
    /// verdict), with a scale, or of a cloud to itself.
    pub skipped: usize,
}

impl RowGraph {
    /// Builds the graph of these rows.
    ///
    /// # Errors
    /// [`Error::Config`] with the pair for numbers that are no pose, and for products outside the
    /// range of f64.
    pub fn new<'a>(rows: impl IntoIterator<Item = &'a Row>) -> Result<RowGraph> {
        let mut found = RowGraph::default();
        for row in rows {
            found.graph.add_vertex(&row.target);
            found.graph.add_vertex(&row.source);
            let refuse = |rule: &str| Error::config("rows", format!("pair {}", row.index), rule);
            let pose = row.transform();
            if row.pose.is_some() && pose.is_none() {
                let rule = "its pose is not a rotation and a shift: was the file changed?";
                return Err(refuse(rule));
            }
            let Some(pose) = pose.filter(|_| row.is_usable()) else {
                found.not_accepted += 1;
                continue;
            };
            let (Some(information), Some(center)) = (row.information, row.center) else {
                found.skipped += 1;
                continue;
            };
            if pose.scale != 1.0 || row.source == row.target {
                found.skipped += 1;
                continue;
            }
            let edge = PoseEdge {
                source: &row.source,
                target: &row.target,
                pose,
                information: symmetric_from_triangle(&information),
                center,
                probability: row.probability.unwrap_or(0.0),
            };
            found.graph.add_edge(&edge).map_err(|error| refuse(&error.to_string()))?;
        }
        Ok(found)
    }

    /// Writes the names of the clouds, CSV with the columns `vertex` and `cloud`; an existing file
    /// is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_names(&self, path: &Path) -> Result<()> {
        let failed = |error| super::list::csv_error(path, error);
        let mut table = csv::Writer::from_writer(Vec::new());
        table.write_record(["vertex", "cloud"]).map_err(failed)?;
        for (number, name) in self.graph.names().iter().enumerate() {
            table.write_record([&number.to_string(), name]).map_err(failed)?;
        }
        let content = table.into_inner().map_err(|error| failed(error.into_error().into()))?;
        io::write_bytes(path, &content)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;

    fn row(source: &str, target: &str, decision: &str, pose: Transform, probability: f64) -> Row {
        Row {
            source: source.into(),
            target: target.into(),
            trusted: Some(decision == "accept"),
            decision: Some(decision.into()),
            probability: Some(probability),
            pose: Some(std::array::from_fn(|k| pose.matrix()[k / 4][k % 4])),
            information: Some([1.0; 21]),
            center: Some([0.0; 3]),
            ..Row::default()
        }
    }

    #[test]
    fn usable_rows_with_a_covariance_are_edges() {
        let one = Transform::from_rotation_vector([0.0, 0.3, 0.0]);
        let rows = [
            row("c", "a", "accept", one, 0.7),
            row("b", "a", "accept", one, 0.99),
            row("d", "a", "ambiguous", one, 0.9),
            row("e", "e", "accept", Transform::IDENTITY, 0.9),
        ];
        let found = RowGraph::new(&rows).unwrap();
        assert_eq!(found.graph.names(), ["a", "c", "b", "d", "e"]);
        assert_eq!((found.graph.edge_count(), found.graph.component_count()), (2, 3));
        assert_eq!((found.not_accepted, found.skipped), (1, 1));
        for (information, center) in [(1e308, 0.0), (1.0, -1e80)] {
            let row = Row {
                information: Some([information; 21]),
                center: Some([center; 3]),
                ..row("b", "a", "accept", one, 0.9)
            };
            let said = RowGraph::new(&[row]).unwrap_err().to_string();
            assert!(said.starts_with("rows = pair 0: ") && said.contains("1e75"), "{said}");
        }
        let mut sheared = row("b", "a", "accept", one, 0.9);
        sheared.index = 7;
        sheared.pose = Some(std::array::from_fn(|k| k as f64));
        let said = RowGraph::new(&[sheared]).unwrap_err().to_string();
        assert!(said.starts_with("rows = pair 7: its pose is not a rotation"), "{said}");
        // A pose may be accepted and have warnings, for example for flat clouds.
        let doubted = Row { trusted: Some(false), ..row("b", "a", "accept", one, 0.99) };
        let failed = Row { error: Some("none".into()), ..row("b", "a", "accept", one, 0.99) };
        let untold = Row { trusted: None, ..row("b", "a", "accept", one, 0.99) };
        let found = RowGraph::new(&[doubted, failed, untold]).unwrap();
        assert_eq!((found.graph.edge_count(), found.not_accepted), (0, 3));
    }
}
