//! What a file holds: rows of numbers, of which a cloud is made.

use super::columns::{Columns, Extra, Vertex};
use crate::cloud::{Attributes, Channels, PointCloud};
use crate::error::Result;
use crate::math::Vec3;

/// What a file holds.
#[derive(Debug)]
pub(super) struct Table {
    points: Vec<Vec3>,
    normals: Option<Vec<Vec3>>,
    /// The other columns, and their numbers.
    extras: Vec<(Extra, Vec<f64>)>,
    viewpoint: Option<Vec3>,
}

impl Table {
    /// No row of these columns yet, room for `capacity`.
    pub fn new(capacity: usize, columns: &Columns) -> Self {
        let normals = columns.has_normals().then(|| Vec::with_capacity(capacity));
        let extra = |extra: &Extra| (extra.clone(), Vec::with_capacity(capacity));
        let extras = columns.extras().iter().map(extra).collect();
        Table { points: Vec::with_capacity(capacity), normals, extras, viewpoint: None }
    }

    /// The table as seen from `viewpoint`.
    pub fn seen_from(self, viewpoint: Option<Vec3>) -> Self {
        Table { viewpoint, ..self }
    }

    /// Adds a row.
    pub fn push(&mut self, Vertex([x, y, z, nx, ny, nz], others): Vertex) {
        self.points.push([x, y, z]);
        if let Some(normals) = &mut self.normals {
            normals.push([nx, ny, nz]);
        }
        for ((_, numbers), value) in self.extras.iter_mut().zip(others) {
            numbers.push(value);
        }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The positions alone.
    pub fn into_points(self) -> Vec<Vec3> {
        self.points
    }

    /// The cloud of these rows: a column called weight has the weights of the points, others are
    /// channels. One that has no name for a channel, or a number that f32 does not hold at a
    /// point that does not drop out, is left out, as nobody may have asked for it, and noted.
    pub fn into_cloud(mut self) -> Result<PointCloud> {
        let finite = |&i: &usize| self.points[i].iter().all(|x| x.is_finite());
        let kept: Vec<usize> = (0..self.points.len()).filter(finite).collect();
        let mut channels = Channels::default();
        let mut weights = None;
        for (extra, numbers) in std::mem::take(&mut self.extras) {
            if extra.name.eq_ignore_ascii_case("weight") {
                weights = weights.or(Some(numbers));
                continue;
            }
            for (name, values) in extra.channels(&numbers) {
                let holds = |&i: &usize| values[i].is_finite();
                if !Channels::is_name(&name) || channels.get(&name).is_some() {
                    continue;
                }
                if let Some(&row) = kept.iter().find(|&i| !holds(i)) {
                    channels = channels.without(&name, row);
                } else {
                    // At rows that drop out, anything that is a number.
                    let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
                    let values = values.into_iter().map(finite).collect();
                    channels = channels.with(&name, values)?;
                }
            }
        }
        let has = Attributes {
            normals: self.normals.as_deref(),
            weights: weights.as_deref(),
            channels: Some(&channels),
        };
        let cloud = PointCloud::with_attributes(&self.points, has)?;
        match self.viewpoint {
            Some(viewpoint) => cloud.with_viewpoint(viewpoint),
            None => Ok(cloud),
        }
    }
}
