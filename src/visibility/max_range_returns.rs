//! Returns at the limit of a sensor's range: no surface, but a sphere about the sensor.
//!
//! Some scanners report rays without a return at the largest distance that they can represent.
//! These points have the same shape in every scan, about its own sensor, and bias the pose towards
//! aligned sensors. They also reveal the position of the sensor.

use rand::SeedableRng;
use rand::seq::index;
use rand_chacha::ChaCha8Rng;

use super::fibonacci_directions;
use crate::cloud::PointCloud;
use crate::math::cholesky;
use crate::math::{self, Vec3};

/// Depths of the shell of maximum-range returns, as shares of the range: exact values, and values
/// as noisy as a scanner's. Chosen by hand.
const SHELLS: [f64; 4] = [1e-3, 2e-3, 4e-3, 8e-3];
/// Depth of the nearly empty gap in front of the shell, as a share of the range: surfaces end
/// gradually. Chosen by hand.
const GAP_DEPTH: f64 = 0.05;
/// Maximum number of points in the gap, as a share of those in the shell, unless the shell is more
/// than [`MIN_CONTRAST`] times denser. Chosen by hand.
const MAX_GAP_SHARE: f64 = 0.05;
const MIN_CONTRAST: f64 = 100.0;
/// Maximum share of points beyond the limit: stray returns. Chosen by hand.
const MAX_BEYOND_SHARE: f64 = 1e-4;
/// Maximum number of the farthest points that may be outside a sphere. Chosen by hand.
const MAX_OUTSIDE: usize = 2;
/// Least and largest share of the points in the shell: fewer change nothing, more are a surface.
const SHELL_SHARE_RANGE: [f64; 2] = [0.002, 0.6];
/// Minimum number of points of a shell. Chosen by hand.
const MIN_SHELL_POINTS: f64 = 20.0;
/// Number of points used to fit a sphere. Chosen by hand.
const SAMPLE: usize = 4000;
/// Number of directions in which the farthest of them are taken. Chosen by hand.
const DIRECTIONS: usize = 192;
/// Minimum number of the farthest points on a sphere. Chosen by hand.
const MIN_ON_SPHERE: usize = 8;
/// Number of spheres tried. Chosen by hand.
const SPHERE_TRIALS: usize = 400;

/// The largest distance that a sensor reports, if many points are at it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct MaxRangeReturns {
    /// The sensor's position, in the cloud's frame.
    pub viewpoint: Vec3,
    /// The largest distance of a point from the sensor, except for strays.
    pub range: f64,
    /// Depth of the shell of these points, as a share of the range.
    pub depth: f64,
    /// Number of points in the shell.
    pub points: usize,
}

impl MaxRangeReturns {
    /// Finds the range limit of a sensor at `viewpoint`: none if the farthest points are only the
    /// end of a surface, or a surface themselves, or if the viewpoint is far from all points.
    pub fn detect_at(cloud: &PointCloud, viewpoint: Vec3) -> Option<MaxRangeReturns> {
        let distance = |p: Vec3| math::norm(math::sub(p, viewpoint));
        let mut distances: Vec<f64> = cloud.positions().map(distance).collect();
        let strays = (MAX_BEYOND_SHARE * distances.len() as f64).ceil() as usize;
        let mut farthest = |beyond: usize| {
            let at = distances.len().checked_sub(1 + beyond)?;
            Some(*distances.select_nth_unstable_by(at, f64::total_cmp).1)
        };
        let ranges = [farthest(0)?, farthest(strays)?];
        // Seen from outside, a far wall has a shell that is equally thin.
        let inside = |range: &f64| *range <= cloud.diagonal();
        let shells = ranges
            .into_iter()
            .filter(inside)
            .flat_map(|range| SHELLS.map(|depth| RangeShell { range, depth }));
        let limits = shells.filter_map(|shell| Some((shell, shell.contrast(&distances)?)));
        // A thinner shell may be only a part of them; among equally good ones the first.
        let best = limits.reduce(|best, next| if next.1 > best.1 { next } else { best });
        let (shell, _) = best?;
        let RangeShell { range, depth } = shell;
        let points = distances.iter().filter(|&&d| d >= shell.min_range()).count();
        Some(MaxRangeReturns { viewpoint, range, depth, points })
    }

    /// Finds the range limit of a sensor at an unknown position: the farthest points of the cloud
    /// are on a sphere.
    pub fn detect(cloud: &PointCloud) -> Option<MaxRangeReturns> {
        let center = cloud.centroid();
        let stride = cloud.len().div_ceil(SAMPLE).max(1);
        let sample = (0..cloud.len()).step_by(stride);
        let sample: Vec<Vec3> = sample.map(|i| math::sub(cloud.position(i), center)).collect();
        let farthest = |along: Vec3| {
            let ahead = |&i: &usize| math::dot(along, sample[i]);
            (0..sample.len()).max_by(|a, b| ahead(a).total_cmp(&ahead(b)))
        };
        let mut extremes: Vec<usize> =
            fibonacci_directions(DIRECTIONS).filter_map(farthest).collect();
        extremes.sort_unstable();
        extremes.dedup();
        let extremes: Vec<Vec3> = extremes.into_iter().map(|i| sample[i]).collect();
        SHELLS.iter().find_map(|&depth| {
            let sphere = Sphere::fit_robust(&extremes, depth)?;
            MaxRangeReturns::detect_at(cloud, math::add(sphere.center, center))
        })
    }

    /// Returns the points of `cloud` nearer than the limit.
    pub fn remove_from(&self, cloud: &PointCloud) -> PointCloud {
        let nearer = |i: &usize| {
            let distance = math::norm(math::sub(cloud.position(*i), self.viewpoint));
            distance < (1.0 - self.depth) * self.range
        };
        cloud.select(&(0..cloud.len()).filter(nearer).collect::<Vec<_>>())
    }
}

/// Distances from `range` down to a share `depth` below it.
#[derive(Clone, Copy)]
struct RangeShell {
    range: f64,
    depth: f64,
}

impl RangeShell {
    fn min_range(self) -> f64 {
        (1.0 - self.depth) * self.range
    }

    /// Returns the ratio of the densities of `distances` in the shell and right in front of it, if
    /// enough are in the shell and few enough in front for it not to be a surface.
    fn contrast(self, distances: &[f64]) -> Option<f64> {
        let void = (1.0 - GAP_DEPTH) * self.range;
        let [mut points, mut before] = [0.0; 2];
        for &d in distances {
            points += f64::from(u8::from(d >= self.min_range()));
            before += f64::from(u8::from(d >= void && d < self.min_range()));
        }
        let n = distances.len() as f64;
        let many = points >= MIN_SHELL_POINTS
            && points >= SHELL_SHARE_RANGE[0] * n
            && points <= SHELL_SHARE_RANGE[1] * n;
        let contrast = points * (GAP_DEPTH - self.depth) / (before * self.depth);
        (many && (before < MAX_GAP_SHARE * points || contrast > MIN_CONTRAST)).then_some(contrast)
    }
}

#[derive(Debug, Clone, Copy)]
struct Sphere {
    center: Vec3,
    radius: f64,
}

impl Sphere {
    /// Fits the sphere that encloses `points`, except for strays, and has most of them on it, at
    /// least [`MIN_ON_SPHERE`], to within a share `depth` of its radius: through four at random,
    /// then through all that are near.
    fn fit_robust(points: &[Vec3], depth: f64) -> Option<Sphere> {
        if points.len() < MIN_ON_SPHERE {
            return None;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let tries = (0..SPHERE_TRIALS).filter_map(|_| {
            let four = index::sample(&mut rng, points.len(), 4);
            let mut sphere =
                Sphere::fit_least_squares(&four.iter().map(|i| points[i]).collect::<Vec<_>>())?;
            for reach in [4.0, 2.0, 1.0] {
                let near =
                    points.iter().filter(|p| sphere.relative_distance(**p).abs() < reach * depth);
                sphere = Sphere::fit_least_squares(&near.copied().collect::<Vec<_>>())?;
            }
            let on = points.iter().filter(|p| sphere.relative_distance(**p).abs() < depth).count();
            let outside = points.iter().filter(|p| sphere.relative_distance(**p) >= depth).count();
            (outside <= MAX_OUTSIDE && on >= MIN_ON_SPHERE).then_some((on, sphere))
        });
        tries.max_by_key(|(on, _)| *on).map(|(_, sphere)| sphere)
    }

    /// Returns how far outside `point` is, in radii; negative inside.
    fn relative_distance(&self, point: Vec3) -> f64 {
        math::norm(math::sub(point, self.center)) / self.radius - 1.0
    }

    /// Fits the sphere of least squares, |p|² = 2 c·p + s (Coope 1993); none for points in a plane.
    fn fit_least_squares(points: &[Vec3]) -> Option<Sphere> {
        let unit = points.iter().map(|&p| math::norm(p)).fold(0.0, f64::max);
        let (mut normal, mut right) = ([[0.0; 4]; 4], [0.0; 4]);
        for &p in points {
            let [x, y, z] = math::scaled(p, 1.0 / unit);
            let (row, square) = ([2.0 * x, 2.0 * y, 2.0 * z, 1.0], x * x + y * y + z * z);
            for u in 0..4 {
                right[u] += row[u] * square;
                (0..4).for_each(|v| normal[u][v] += row[u] * row[v]);
            }
        }
        let [x, y, z, rest] = cholesky::solve(&cholesky::factor(&normal)?, &right);
        let center = [x, y, z];
        let radius = (rest + math::dot(center, center)).sqrt();
        let sphere = Sphere { center: math::scaled(center, unit), radius: radius * unit };
        (sphere.radius.is_finite() && sphere.radius > 0.0).then_some(sphere)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;

    const SENSOR: Vec3 = [0.0, 0.0, 1.7];

    /// A yard 20 m wide seen from its middle, and returns at 50 m in the direction of the open
    /// gate, `share` of the whole, up to `noise` nearer.
    fn yard(share: f64, noise: f64) -> Vec<Vec3> {
        let n = 6000;
        let gate = (f64::from(n) * share) as i32;
        let far = (0..gate).map(|i| {
            let (around, up) = (f64::from(i % 40) / 40.0 - 0.2, f64::from(i / 40) / 400.0 - 0.05);
            let range = 50.0 - noise * f64::from(i % 7) / 6.0;
            let ray = math::normalized([around.cos(), around.sin(), up]);
            math::add(SENSOR, math::scaled(ray, range))
        });
        let ground = (0..n - gate).map(|i| {
            let (x, y) = (f64::from(i % 70) / 3.5 - 10.0, f64::from(i / 70) / 3.5 - 10.0);
            if i % 2 == 0 { [x, y, 0.0] } else { [x, 10.0, 0.2 * (y + 10.0)] }
        });
        far.chain(ground).collect()
    }

    #[test]
    fn a_limit_is_found_wherever_the_cloud_stands() {
        let turn = Transform::from_rotation_vector([0.7, -2.0, 0.4]);
        let moved = Transform { translation: [3.0, -80.0, 12.0], ..turn };
        // Exact; as noisy as a scanner's; most of an open field.
        let kinds = [(0.1, 0.02), (0.1, 0.1), (0.5, 0.02)];
        for (pose, (share, noise)) in
            [Transform::IDENTITY, moved].into_iter().flat_map(|pose| kinds.map(|kind| (pose, kind)))
        {
            let yard = yard(share, noise);
            let cloud: Vec<Vec3> = yard.iter().map(|&p| pose.apply(p)).collect();
            let cloud = PointCloud::new(&cloud).unwrap();
            let found = MaxRangeReturns::detect(&cloud).unwrap();
            let off = math::norm(math::sub(found.viewpoint, pose.apply(SENSOR)));
            // A gate is a small part of the sphere: noise affects the centre.
            assert!(off < 10.0 * noise && (found.range - 50.0).abs() < 0.05 + noise, "{found:?}");
            let shell = (6000.0 * share) as usize;
            assert_eq!(
                MaxRangeReturns::detect_at(&cloud, pose.apply(SENSOR)).unwrap().points,
                shell
            );
            assert_eq!((found.points, found.remove_from(&cloud).len()), (shell, 6000 - shell));
        }
    }

    #[test]
    fn neither_a_stray_nor_a_wall_that_reaches_up_to_it_hides_a_limit() {
        // The ground extends to the limit: a tenth as many returns are in the gap in front of it.
        let ground = (0..60).map(|i| [47.5 + 0.04 * f64::from(i), 0.1 * f64::from(i % 7), 0.0]);
        let seen: Vec<Vec3> = yard(0.1, 0.02).into_iter().chain(ground).collect();
        for stray in [None, Some([90.0, 20.0, 30.0])] {
            let cloud: Vec<Vec3> = seen.iter().copied().chain(stray).collect();
            let cloud = PointCloud::new(&cloud).unwrap();
            let found = MaxRangeReturns::detect(&cloud).unwrap();
            assert!((found.range - 50.0).abs() < 0.1 && found.points >= 600, "{found:?}");
            let about = MaxRangeReturns::detect_at(&cloud, SENSOR).unwrap();
            assert!((600..620).contains(&about.points), "{about:?}");
            assert!(about.remove_from(&cloud).positions().all(|p| math::norm(p) < 60.0));
        }
    }

    #[test]
    fn what_ends_like_a_surface_or_is_one_has_no_limit() {
        // A yard without a gate; a few returns alone; the greater part of all.
        for share in [0.0, 0.001, 0.8] {
            let cloud = PointCloud::new(&yard(share, 0.02)).unwrap();
            assert_eq!(MaxRangeReturns::detect(&cloud), None, "{share}");
            assert_eq!(MaxRangeReturns::detect_at(&cloud, SENSOR), None, "{share}");
        }
        // A wall at the far end of a room, from a position that is far outside.
        let room = (0..6000).map(|i| {
            let [x, y] = [i % 40, i / 40 % 50].map(|k| 0.1 * f64::from(k));
            if i < 4500 { [x, y, 0.0] } else { [4.0, y, 0.1 * f64::from(i % 25)] }
        });
        let room = PointCloud::new(&room.collect::<Vec<_>>()).unwrap();
        assert_eq!(MaxRangeReturns::detect_at(&room, [-3000.0, 2.5, 1.0]), None);
        // A ball, a disc about the viewpoint, three points, none.
        let ball: Vec<Vec3> = fibonacci_directions(2000).collect();
        let disc = (0..2500).map(|i| [f64::from(i % 50) - 24.5, f64::from(i / 50) - 24.5, 0.0]);
        let disc: Vec<Vec3> = disc.filter(|&p| math::norm(p) < 24.0).collect();
        for points in [&ball[..], &disc, &ball[..3], &[]] {
            let cloud = PointCloud::new(points).unwrap();
            assert_eq!(MaxRangeReturns::detect(&cloud), None);
            assert_eq!(MaxRangeReturns::detect_at(&cloud, [0.0; 3]), None);
        }
    }
}
