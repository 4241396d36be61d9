//! Shapes without a file.

use crate::cloud::Mesh;
use crate::math::{self, Vec3};

/// Creates a closed surface without any symmetry, about 2 units across: a ball with smooth bumps
/// and dents of different sizes, centred near zero.
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
    #[cfg_attr(miri, ignore = "a mesh of 32,000 triangles takes Miri very long")]
    fn the_boulder_is_about_two_units_and_smooth() {
        let cloud = boulder().sample(2000, 1).unwrap();
        assert!((2.5..4.0).contains(&cloud.diagonal()), "{}", cloud.diagonal());
        assert!(math::norm(cloud.centroid()) < 0.2);
    }
}
