//! Surfaces as triangles, and points drawn evenly from them.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::cloud::PointCloud;
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Most points that are sampled: 2 GB of them.
pub const MOST_POINTS: usize = 50_000_000;

/// A triangle mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Corners, in any unit.
    pub vertices: Vec<Vec3>,
    /// Triangles as indices into `vertices`.
    pub faces: Vec<[u32; 3]>,
}

impl Mesh {
    /// `count` points drawn evenly by area, independently of each other. The same `seed`
    /// draws the same points on every machine.
    ///
    /// # Errors
    /// [`Error::Config`] for more than [`MOST_POINTS`]; [`Error::Shape`] when a face names a vertex that is not there;
    /// [`Error::TooFewPoints`] when the faces have no area.
    pub fn sample(&self, count: usize, seed: u64) -> Result<PointCloud> {
        if count > MOST_POINTS {
            let rule = format!("must be at most {MOST_POINTS}");
            return Err(Error::config("points", count, rule));
        }
        let n = self.vertices.len();
        if let Some(&found) = self.faces.as_flattened().iter().find(|&&v| v as usize >= n) {
            let what = "a vertex named by a face".into();
            return Err(Error::Shape { what, expected: n, found: found as usize });
        }
        let corners = |face: &[u32; 3]| face.map(|v| self.vertices[v as usize]);
        let mut total = 0.0;
        let ends: Vec<f64> = self
            .faces
            .iter()
            .map(|face| {
                let [a, b, c] = corners(face);
                total += math::norm(math::cross(math::sub(b, a), math::sub(c, a))) / 2.0;
                total
            })
            .collect();
        if total.is_nan() || total <= 0.0 || total.is_infinite() {
            let found = self.faces.len();
            return Err(Error::TooFewPoints {
                what: "a mesh without area".into(),
                found,
                needed: 1,
            });
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let points: Vec<Vec3> = (0..count)
            .map(|_| {
                let at = uniform(&mut rng) * total;
                let face = ends.partition_point(|&end| end <= at).min(self.faces.len() - 1);
                let [a, b, c] = corners(&self.faces[face]);
                // Even over the triangle (Osada et al. 2002, eq. 1).
                let (u, v) = (uniform(&mut rng).sqrt(), uniform(&mut rng));
                let [wa, wb, wc] = [1.0 - u, u * (1.0 - v), u * v];
                [0, 1, 2].map(|k| wa * a[k] + wb * b[k] + wc * c[k])
            })
            .collect();
        PointCloud::new(&points)
    }
}

/// Uniform in [0, 1), 53 bits.
pub(super) fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A closed surface without any symmetry, about 2 units across: a ball with smooth bumps
/// and dents of different sizes. Centred near zero.
pub fn boulder() -> Mesh {
    /// Direction, height, sharpness.
    const BUMPS: [(Vec3, f64, f64); 9] = [
        ([1.0, 0.2, 0.1], 0.9, 8.0),
        ([-0.3, 1.0, 0.4], 0.5, 25.0),
        ([0.2, -0.6, 0.9], -0.3, 8.0),
        ([-0.8, -0.5, -0.2], 0.7, 40.0),
        ([0.1, 0.3, -1.0], 0.4, 12.0),
        ([0.6, 0.9, 0.3], -0.25, 30.0),
        ([-0.6, 0.2, 0.9], 0.35, 60.0),
        ([0.5, -0.9, -0.4], 0.5, 20.0),
        ([-0.9, 0.4, -0.6], -0.3, 18.0),
    ];
    const RINGS: u32 = 90;
    const SECTORS: u32 = 180;
    let radius = |u: Vec3| {
        let bump = |&(at, height, sharpness): &(Vec3, f64, f64)| {
            height * (sharpness * (math::dot(u, math::normalized(at)) - 1.0)).exp()
        };
        0.6 + BUMPS.iter().map(bump).sum::<f64>()
    };
    let mut vertices = Vec::new();
    for ring in 0..=RINGS {
        let polar = std::f64::consts::PI * f64::from(ring) / f64::from(RINGS);
        for sector in 0..SECTORS {
            let azimuth = std::f64::consts::TAU * f64::from(sector) / f64::from(SECTORS);
            let u = [polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()];
            vertices.push(math::scaled(u, radius(u)));
        }
    }
    let mut faces = Vec::new();
    for ring in 0..RINGS {
        for sector in 0..SECTORS {
            let next = (sector + 1) % SECTORS;
            let (upper, lower) = (ring * SECTORS, (ring + 1) * SECTORS);
            faces.push([upper + sector, lower + sector, lower + next]);
            faces.push([upper + sector, lower + next, upper + next]);
        }
    }
    Mesh { vertices, faces }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_even_by_area_and_seeded() {
        // Two triangles, one three times as large.
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-3.0, 0.0, 0.0]];
        let mesh = Mesh { vertices, faces: vec![[0, 1, 2], [0, 2, 3]] };
        let cloud = mesh.sample(20_000, 7).unwrap();
        let right = cloud.positions().filter(|p| p[0] > 0.0).count() as f64 / 20_000.0;
        // Three standard deviations of a share of 1/4.
        assert!((right - 0.25).abs() < 3.0 * (0.25f64 * 0.75 / 20_000.0).sqrt(), "{right}");
        assert_eq!(cloud, mesh.sample(20_000, 7).unwrap());
        assert_ne!(cloud, mesh.sample(20_000, 8).unwrap());
    }

    #[test]
    fn meshes_without_area_or_with_lost_vertices_are_refused() {
        let flat = Mesh { vertices: vec![[0.0; 3]; 3], faces: vec![[0, 1, 2]] };
        assert!(matches!(flat.sample(10, 0), Err(Error::TooFewPoints { .. })));
        let lost = Mesh { vertices: vec![[0.0; 3]; 3], faces: vec![[0, 1, 9]] };
        assert!(matches!(lost.sample(10, 0), Err(Error::Shape { .. })));
    }

    #[test]
    fn the_boulder_is_about_two_units_and_smooth() {
        let cloud = boulder().sample(2000, 1).unwrap();
        assert!((2.5..4.0).contains(&cloud.diagonal()), "{}", cloud.diagonal());
        assert!(math::norm(cloud.centroid()) < 0.2);
    }
}
