//! [`Mesh`]: a triangle surface, and points sampled uniformly from it.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::PointCloud;
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Maximum number of sampled points: they take 2 GB.
pub const MAX_SAMPLED_POINTS: usize = 50_000_000;

/// A triangle mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Vertices, in any unit.
    pub vertices: Vec<Vec3>,
    /// Triangles as indices into `vertices`.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// Returns the centroid of the surface: the mean of its points by area. NaN without area.
    ///
    /// # Panics
    /// When a face refers to a missing vertex.
    pub fn centroid(&self) -> Vec3 {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for face in &self.faces {
            let [a, b, c] = face.map(|v| self.vertices[v as usize]);
            let area = triangle_area([a, b, c]);
            sum = math::add(sum, math::scaled(math::add(math::add(a, b), c), area / 3.0));
            total += area;
        }
        math::scaled(sum, 1.0 / total)
    }

    /// Removes the triangles that have an edge longer than `limit`: in the surface of a range grid
    /// these span a depth step and were never seen.
    pub fn without_long_edges(mut self, limit: f64) -> Mesh {
        let vertices = &self.vertices;
        let length =
            |a: u32, b: u32| math::norm(math::sub(vertices[a as usize], vertices[b as usize]));
        self.faces.retain(|&[a, b, c]| {
            [(a, b), (b, c), (c, a)].iter().all(|&(a, b)| length(a, b) <= limit)
        });
        self
    }

    /// Samples `count` points uniformly by area, independently of each other. The same `seed` gives
    /// the same points on every machine.
    ///
    /// # Errors
    /// [`Error::Config`] for more than [`MAX_SAMPLED_POINTS`]; [`Error::Shape`] when a face refers
    /// to a missing vertex; [`Error::TooFewPoints`] when the faces have no area.
    pub fn sample(&self, count: usize, seed: u64) -> Result<PointCloud> {
        if count > MAX_SAMPLED_POINTS {
            let rule = format!("must be at most {MAX_SAMPLED_POINTS}");
            return Err(Error::config("points", count, rule));
        }
        self.check_faces()?;
        let corners = |face: &[u32; 3]| face.map(|v| self.vertices[v as usize]);
        let mut total = 0.0;
        let ends: Vec<f64> = self
            .faces
            .iter()
            .map(|face| {
                total += self.face_area(face);
                total
            })
            .collect();
        self.check_area(total)?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let points: Vec<Vec3> = (0..count)
            .map(|_| {
                let at = rng.random::<f64>() * total;
                let face = ends.partition_point(|&end| end <= at).min(self.faces.len() - 1);
                let [a, b, c] = corners(&self.faces[face]);
                // Uniform over the triangle (Osada et al. 2002, eq. 1).
                let (u, v) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
                let [wa, wb, wc] = [1.0 - u, u * (1.0 - v), u * v];
                [0, 1, 2].map(|k| wa * a[k] + wb * b[k] + wc * c[k])
            })
            .collect();
        PointCloud::new(&points)
    }

    /// Checks that faces refer to existing vertices, that these are finite, and that the area is
    /// positive.
    pub(super) fn validate(&self) -> Result<()> {
        self.check_faces()?;
        let infinite = |&v: &u32| self.vertices[v as usize].iter().any(|x| !x.is_finite());
        if let Some(&index) = self.faces.as_flattened().iter().find(|v| infinite(v)) {
            let what = "a vertex of a mesh".into();
            return Err(Error::NonFinite { what, index: index as usize });
        }
        self.check_area(self.faces.iter().map(|face| self.face_area(face)).sum())
    }

    /// Checks that faces refer to existing vertices.
    pub(super) fn check_faces(&self) -> Result<()> {
        let expected = self.vertices.len();
        match self.faces.as_flattened().iter().find(|&&v| v as usize >= expected) {
            Some(&found) => {
                let what = "a vertex named by a face".into();
                Err(Error::Shape { what, expected, found: found as usize })
            }
            None => Ok(()),
        }
    }

    fn check_area(&self, total: f64) -> Result<()> {
        if total > 0.0 && total.is_finite() {
            return Ok(());
        }
        let what = "a mesh without area".into();
        Err(Error::TooFewPoints { what, found: self.faces.len(), needed: 1 })
    }

    /// Returns the area of a face whose vertices exist.
    pub(super) fn face_area(&self, face: &[u32; 3]) -> f64 {
        triangle_area(face.map(|v| self.vertices[v as usize]))
    }
}

fn triangle_area([a, b, c]: [Vec3; 3]) -> f64 {
    math::norm(math::cross(math::sub(b, a), math::sub(c, a))) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_even_by_area_and_seeded() {
        // Two triangles, one three times as large.
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-3.0, 0.0, 0.0]];
        let mesh = Mesh { vertices, faces: vec![[0, 1, 2], [0, 2, 3]] };
        // Miri takes a thousand times longer.
        let count = if cfg!(miri) { 500 } else { 20_000 };
        let cloud = mesh.sample(count, 7).unwrap();
        let count = count as f64;
        let right = cloud.positions().filter(|p| p[0] > 0.0).count() as f64 / count;
        // Three standard deviations of a share of 1/4.
        assert!((right - 0.25).abs() < 3.0 * (0.25 * 0.75 / count).sqrt(), "{right}");
        assert_eq!(cloud, mesh.sample(count as usize, 7).unwrap());
        assert_ne!(cloud, mesh.sample(count as usize, 8).unwrap());
        let apart = math::sub(mesh.centroid(), cloud.centroid());
        assert!(math::norm(apart) < 4.0 / count.sqrt(), "{apart:?}");
    }

    #[test]
    fn long_edges_take_their_triangles_along() {
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 9.0]];
        let mesh = Mesh { vertices, faces: vec![[0, 1, 2], [0, 1, 3]] };
        assert_eq!(mesh.without_long_edges(1.5).faces, [[0, 1, 2]]);
    }

    #[test]
    fn meshes_without_area_or_with_lost_vertices_are_refused() {
        let flat = Mesh { vertices: vec![[0.0; 3]; 3], faces: vec![[0, 1, 2]] };
        assert!(matches!(flat.sample(10, 0), Err(Error::TooFewPoints { .. })));
        let lost = Mesh { vertices: vec![[0.0; 3]; 3], faces: vec![[0, 1, 9]] };
        assert!(matches!(lost.sample(10, 0), Err(Error::Shape { .. })));
    }
}
