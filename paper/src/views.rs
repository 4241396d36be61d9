//! Two views of a mesh with a given overlap.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Motion;
use super::protocol::Trial;
use cfreg::cloud::{Mesh, Transform};
use cfreg::error::{Error, Result};
use cfreg::math::{self, Vec3};

/// Distance of a sensor from the centroid, in diagonals of the bounding box: near enough for
/// perspective to matter, as with an object on a turntable.
const DISTANCE: f64 = 3.0;
/// Tolerance of the overlap of two views; a face or so of a coarse mesh.
const TOLERANCE: f64 = 0.002;
/// Most views that are tried: from half a turn, bisection alone ends at a thousandth of a degree.
const MAX_ITERATIONS: usize = 18;

/// A mesh, to be seen from pairs of viewpoints.
#[derive(Debug, Clone)]
pub struct Views {
    mesh: Mesh,
    center: Vec3,
    distance: f64,
}

/// A view and the next: where their sensors stand, which faces they see.
struct ViewPair {
    sensors: [Vec3; 2],
    seen: [Vec<bool>; 2],
    overlap: f64,
}

impl Views {
    /// Creates views of `mesh`, whose faces have their fronts outwards.
    ///
    /// # Errors
    /// The errors of [`Mesh::visible_faces`].
    pub fn new(mesh: Mesh) -> Result<Self> {
        // This finds missing vertices; rendering the mesh finds all other defects.
        mesh.area_of(&vec![true; mesh.faces.len()])?;
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &vertex in mesh.faces.as_flattened() {
            let vertex = mesh.vertices[vertex as usize];
            for axis in 0..3 {
                (low[axis], high[axis]) =
                    (low[axis].min(vertex[axis]), high[axis].max(vertex[axis]));
            }
        }
        let (center, distance) = (mesh.centroid(), DISTANCE * math::norm(math::sub(high, low)));
        mesh.visible_faces(math::add(center, [0.0, 0.0, distance]))?;
        Ok(Views { mesh, center, distance })
    }

    /// Generates a pair of views: `points` sampled by area from the visible part of each,
    /// independently, and the reached overlap, by area: the share of the area seen by the source's
    /// sensor that the target's sensor sees, too. It is within 0.002 of `overlap`, except for
    /// coarse meshes.
    ///
    /// The source's sensor is in a random direction, three diagonals of the bounding box from the
    /// centroid; the target's is rotated about the centroid from there, about a random axis across
    /// the line of sight. With an overlap of 1 both are at the same position. Each cloud has its
    /// sensor as its viewpoint; the target is moved by the paper's large motion. For the same
    /// `seed` and `number`, pairs of different overlaps share the first sensor, the axis and the
    /// motion.
    ///
    /// # Errors
    /// [`Error::Config`] for an overlap outside [0, 1], or below that of opposite views, and for
    /// fewer than three points or more than a mesh gives; [`Error::TooFewPoints`] if a sensor sees
    /// nothing.
    pub fn trial(
        &self,
        overlap: f64,
        points: usize,
        seed: u64,
        number: u64,
    ) -> Result<(Trial, f64)> {
        if !(0.0..=1.0).contains(&overlap) {
            return Err(Error::config("overlap", overlap, "must be between 0 and 1"));
        }
        if points < 3 {
            return Err(Error::config("points", points, "must be at least 3"));
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(number);
        let direction = random_direction(&mut rng);
        let axis = math::normalized(math::cross(direction, self::random_direction(&mut rng)));
        let truth = Motion::Large.draw(self.center, &mut rng);
        let seeds = [rng.next_u64(), rng.next_u64()];
        let pair = self.pair(direction, axis, overlap)?;
        let cloud = |at: usize| {
            let part = self.mesh.select_faces(&pair.seen[at])?;
            part.sample(points, seeds[at])?.with_viewpoint(pair.sensors[at])
        };
        let (source, target) = (cloud(0)?, cloud(1)?.transformed(&truth)?);
        Ok((Trial { source, target, truth }, pair.overlap))
    }

    /// Turns the second sensor until the views overlap as asked.
    fn pair(&self, direction: Vec3, axis: Vec3, asked: f64) -> Result<ViewPair> {
        let sensor = |angle: f64| {
            let turn = Transform::from_rotation_vector(math::scaled(axis, angle));
            math::add(self.center, math::scaled(turn.rotate(direction), self.distance))
        };
        let first = self.mesh.visible_faces(sensor(0.0))?;
        let area = self.mesh.area_of(&first)?;
        let view = |angle: f64| {
            let seen = self.mesh.visible_faces(sensor(angle))?;
            let both: Vec<bool> = first.iter().zip(&seen).map(|(&a, &b)| a && b).collect();
            let overlap = if area > 0.0 { self.mesh.area_of(&both)? / area } else { 0.0 };
            let seen = [first.clone(), seen];
            Ok::<ViewPair, Error>(ViewPair { sensors: [sensor(0.0), sensor(angle)], seen, overlap })
        };
        // False position, with the weight halved for an end that stays twice (Dowell and Jarratt
        // 1971, "Illinois"): the overlap falls from 1 to about 0 over half a turn, nearly linearly.
        let (mut near, mut far) = ((0.0, 1.0 - asked), (std::f64::consts::PI, 0.0));
        let mut best = if near.1 <= TOLERANCE { view(0.0)? } else { view(far.0)? };
        far.1 = best.overlap - asked;
        if far.1 > TOLERANCE && near.1 > TOLERANCE {
            let rule = format!("opposite views overlap by {:.3} already", best.overlap);
            return Err(Error::config("overlap", asked, rule));
        }
        let mut last = None;
        for _ in 0..MAX_ITERATIONS {
            if (best.overlap - asked).abs() <= TOLERANCE {
                break;
            }
            let angle = near.0 + (far.0 - near.0) * near.1 / (near.1 - far.1);
            let tried = view(angle)?;
            let off = tried.overlap - asked;
            let stays = if off > 0.0 {
                near = (angle, off);
                &mut far.1
            } else {
                far = (angle, off);
                &mut near.1
            };
            if last.replace(off > 0.0) == Some(off > 0.0) {
                *stays /= 2.0;
            }
            if off.abs() < (best.overlap - asked).abs() {
                best = tried;
            }
        }
        Ok(best)
    }
}

/// Evenly from the unit sphere, by rejection from the cube.
fn random_direction(rng: &mut ChaCha8Rng) -> Vec3 {
    loop {
        let p = [(); 3].map(|()| 2.0 * rng.random::<f64>() - 1.0);
        let square = math::dot(p, p);
        if square > 1e-6 && square <= 1.0 {
            return math::normalized(p);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cfreg::cloud::shape::boulder;

    /// Returns the share of `cloud`, at `pose` of the mesh, that is within `reach` of a point of
    /// `other`.
    fn near(cloud: &[Vec3], other: &[Vec3], reach: f64) -> f64 {
        let close = |p: &&Vec3| other.iter().any(|q| math::norm(math::sub(**p, *q)) < reach);
        cloud.iter().filter(close).count() as f64 / cloud.len() as f64
    }

    #[test]
    fn views_overlap_as_asked_and_so_do_their_points() {
        let views = Views::new(boulder()).unwrap();
        for (number, asked) in [1.0, 0.8, 0.5, 0.3, 0.1, 0.0].into_iter().enumerate() {
            let (trial, reached) = views.trial(asked, 2000, 5, number as u64).unwrap();
            assert!((reached - asked).abs() <= TOLERANCE, "{asked}: {reached}");
            let source: Vec<Vec3> =
                trial.source.positions().map(|p| trial.truth.apply(p)).collect();
            let target: Vec<Vec3> = trial.target.positions().collect();
            // Points are 0.04 apart; points beyond the rim of the shared part, which is about 6
            // long about an area of 3, but within reach of it count as shared.
            let found = near(&source, &target, 0.06);
            assert!(found > reached - 0.03 && found < reached + 0.15, "{asked}: {found}");
        }
    }

    #[test]
    fn a_trial_is_its_number_and_carries_its_sensors() {
        let views = Views::new(boulder()).unwrap();
        let [one, again, other] = [0, 0, 1].map(|n| views.trial(0.6, 300, 7, n).unwrap());
        assert_eq!(one, again);
        assert_ne!(one, other);
        let whole = views.trial(1.0, 300, 7, 0).unwrap();
        // One sensor for both, and one motion for every overlap.
        let (source, target) = (&whole.0.source, &whole.0.target);
        let moved = whole.0.truth.apply(source.viewpoint().unwrap());
        assert!(math::norm(math::sub(moved, target.viewpoint().unwrap())) < 1e-9);
        assert_eq!(whole.0.truth, one.0.truth);
        assert_eq!(source.viewpoint(), one.0.source.viewpoint());
        let moved = whole.0.source.transformed(&whole.0.truth).unwrap();
        assert_ne!(moved.points(), target.points());
        // Every point is on the sensor's side of the boulder, whose normals point outwards.
        let sensor = source.viewpoint().unwrap();
        let far = source.positions().filter(|&p| math::dot(p, sensor) < 0.0).count();
        assert!(far < 30, "{far}");
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let views = Views::new(boulder()).unwrap();
        for (overlap, points) in [(1.1, 300), (-0.1, 300), (f64::NAN, 300), (0.5, 2)] {
            assert!(matches!(views.trial(overlap, points, 0, 0), Err(Error::Config { .. })));
        }
        let mut lost = boulder();
        lost.faces[3][0] = u32::MAX;
        assert!(matches!(Views::new(lost), Err(Error::Shape { .. })));
        let empty = Mesh { vertices: vec![], faces: vec![] };
        assert!(matches!(Views::new(empty), Err(Error::TooFewPoints { .. })));
    }
}
