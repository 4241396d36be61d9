//! Vertices and faces of formats of meshes.

use super::columns::{ColumnKind, ColumnMap, Vertex};
use super::content_error::ContentError;
use super::table::PointTable;
use crate::math::Vec3;

/// A mesh as its file has it.
#[derive(Debug, Default)]
pub(super) struct MeshTable {
    pub vertices: Vec<Vec3>,
    /// One a vertex, or none.
    pub normals: Vec<Vec3>,
    /// Red, green and blue from 0 to 1, one a vertex, or none.
    pub colors: Vec<Vec3>,
    pub faces: Vec<[u32; 3]>,
}

impl MeshTable {
    /// Adds a face as a fan about its first corner; a face of fewer than three corners has no
    /// triangle.
    pub fn push_face(&mut self, corners: &[u32]) {
        if let [first, rest @ ..] = corners {
            self.faces.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        }
    }

    /// Returns the vertices as rows, and the faces; `keeps_all` keeps rows that are not finite,
    /// which faces name.
    pub fn into_table(self, keeps_all: bool) -> Result<(PointTable, Vec<[u32; 3]>), ContentError> {
        let count = self.vertices.len();
        let has_normals = !self.normals.is_empty() && self.normals.len() == count;
        let has_colors = !self.colors.is_empty() && self.colors.len() == count;
        let mut names = vec!["x", "y", "z"];
        names.extend(has_normals.then_some(["nx", "ny", "nz"]).into_iter().flatten());
        names.extend(has_colors.then_some(["red", "green", "blue"]).into_iter().flatten());
        let columns = ColumnMap::from_names(names.into_iter().map(Some))
            .map_err(ContentError::new)?
            .with_kinds(|_, _| ColumnKind::Share);
        let mut table = PointTable::new(count, &columns);
        if keeps_all {
            table = table.keep_non_finite();
        }
        let mut vertex = Vertex::default();
        for (index, place) in self.vertices.iter().enumerate() {
            vertex.place = *place;
            if has_normals {
                vertex.normal = self.normals[index];
            }
            vertex.extras.clear();
            if has_colors {
                vertex.extras.extend(self.colors[index]);
            }
            let pushed = table.push(&vertex);
            pushed.map_err(|what| ContentError::new(format!("vertex {index}: {what}")))?;
        }
        Ok((table, self.faces))
    }
}
