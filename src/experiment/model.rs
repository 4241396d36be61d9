//! What trials draw their clouds from.

use crate::cloud::{Mesh, PointCloud};
use crate::error::{Error, Result};
use crate::filter;
use crate::math::Vec3;

/// A scan, whose points are drawn, or a surface, which is sampled evenly by area.
#[derive(Debug, Clone, PartialEq)]
pub enum Model {
    /// Points as they were scanned: denser where the sensor looked straight on.
    Points(PointCloud),
    /// Triangles: what the paper samples (section IV-A).
    Surface(Mesh),
}

impl Model {
    /// `count` points; the same `seed` draws the same.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] for a scan of fewer points; those of [`Mesh::sample`].
    pub fn sample(&self, count: usize, seed: u64) -> Result<PointCloud> {
        match self {
            Model::Points(cloud) if cloud.len() < count => Err(Error::TooFewPoints {
                what: "the model".into(),
                found: cloud.len(),
                needed: count,
            }),
            Model::Points(cloud) => Ok(filter::sample(cloud, count, seed)),
            Model::Surface(mesh) => mesh.sample(count, seed),
        }
    }

    /// Mean of the points, or of the surface.
    pub fn centroid(&self) -> Vec3 {
        match self {
            Model::Points(cloud) => cloud.centroid(),
            Model::Surface(mesh) => mesh.centroid(),
        }
    }
}

impl From<PointCloud> for Model {
    fn from(cloud: PointCloud) -> Self {
        Model::Points(cloud)
    }
}

impl From<Mesh> for Model {
    fn from(mesh: Mesh) -> Self {
        Model::Surface(mesh)
    }
}
