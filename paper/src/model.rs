//! Models that trials sample their clouds from.

use cfreg::cloud::{Mesh, PointCloud};
use cfreg::error::{Error, Result};
use cfreg::filter;
use cfreg::math::Vec3;

/// A scan, whose points are drawn, or a surface, which is sampled uniformly by area.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "few models exist at a time")]
pub enum Model {
    /// Scanned points: denser where the sensor's incidence was perpendicular.
    Points(PointCloud),
    /// Triangles: the paper samples these (section IV-A).
    Surface(Mesh),
}

impl Model {
    /// Samples `count` points; the same `seed` gives the same points.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] for a scan of fewer points; the errors of [`Mesh::sample`].
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

    /// Returns an identifier of the model: a hash of all coordinates and faces, the same on every
    /// machine (FNV-1a, 64 bits, by Fowler, Noll and Vo).
    pub fn digest(&self) -> String {
        match self {
            Model::Points(cloud) => digest(cloud.positions(), &[]),
            Model::Surface(mesh) => digest(mesh.vertices.iter().copied(), &mesh.faces),
        }
    }

    /// Returns the mean of the points, or of the surface.
    pub fn centroid(&self) -> Vec3 {
        match self {
            Model::Points(cloud) => cloud.centroid(),
            Model::Surface(mesh) => mesh.centroid(),
        }
    }
}

fn digest(points: impl Iterator<Item = Vec3>, faces: &[[u32; 3]]) -> String {
    let coordinates = points.flatten().map(f64::to_bits);
    let corners = faces.as_flattened().iter().map(|&corner| u64::from(corner));
    let hash = coordinates
        .chain(corners)
        .flat_map(u64::to_le_bytes)
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
    format!("{hash:016x}")
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
