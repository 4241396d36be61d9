//! The camera for two clouds.

use serde::Serialize;

use super::display::{DisplayCloud, robust_bounds};
use crate::cloud::{PointCloud, Transform};
use crate::math::eigen;
use crate::math::{self, Mat3, Vec3};

/// The visible region: a ball about the target's middle, in its frame.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Viewport {
    pub(super) center: Vec3,
    pub(super) radius: f64,
}

/// The direction of view.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Camera {
    /// Unit vector towards the camera.
    pub(super) toward: Vec3,
    /// Unit vector that points up in space; the page rotates the view about it.
    pub(super) upright: Vec3,
    /// Up in the picture: the normalised component of `upright` perpendicular to `toward`.
    pub(super) up: Vec3,
}

/// Tangent of the tilt for flat scenes, so that they do not look like a map. Chosen by hand.
const FLAT_TILT: f64 = 0.8;
/// Offsets for other scenes, to the right and from above, so that they have depth. Chosen by hand.
const SIDE_OFFSET: [f64; 2] = [0.3, 0.2];
/// Most points of a cloud that are measured. Chosen by hand.
const MAX_SAMPLED_POINTS: usize = 2000;
/// Share of these points to be visible; the rest may be outliers. Chosen by hand.
const VISIBLE_SHARE: f64 = 0.99;

impl Viewport {
    /// Computes the viewport of both clouds, with the source at `pose`.
    pub(super) fn new(source: &DisplayCloud, target: &DisplayCloud, pose: &Transform) -> Viewport {
        let some = |shown: &DisplayCloud| -> Vec<Vec3> {
            let step = shown.cloud.len().div_ceil(MAX_SAMPLED_POINTS).max(1);
            shown.cloud.positions().step_by(step).collect()
        };
        let local = |place: Vec3| math::sub(place, target.middle);
        let sides = [
            some(source).into_iter().map(|p| local(pose.apply(p))).collect::<Vec<Vec3>>(),
            some(target).into_iter().map(local).collect(),
        ];
        // Each cloud separately, so that a smaller cloud does not count as outliers of the larger.
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for side in &sides {
            for axis in 0..3 {
                let mut along: Vec<f64> = side.iter().map(|p| p[axis]).collect();
                along.sort_by(f64::total_cmp);
                let at = |share: f64| along[(share * (along.len() - 1) as f64).round() as usize];
                low[axis] = low[axis].min(at(1.0 - VISIBLE_SHARE));
                high[axis] = high[axis].max(at(VISIBLE_SHARE));
            }
        }
        let center = math::scaled(math::add(low, high), 0.5);
        let radius = sides.iter().map(|side| {
            let mut away: Vec<f64> =
                side.iter().map(|&p| math::norm(math::sub(p, center))).collect();
            away.sort_by(f64::total_cmp);
            // Few points have no outliers.
            away[(VISIBLE_SHARE * (away.len() - 1) as f64).round() as usize]
        });
        let radius = radius.fold(0.0, f64::max);
        Viewport { center, radius: if radius > 0.0 { radius } else { 1.0 } }
    }
}

impl Camera {
    /// Views the target from the direction of its largest projection, on the side of its sensor if
    /// that is known.
    pub(super) fn facing(target: &PointCloud) -> Camera {
        let (low, high) = robust_bounds(target);
        let middle = math::scaled(math::add(low, high), 0.5);
        let inside = |p: &Vec3| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis]));
        let step = target.len().div_ceil(MAX_SAMPLED_POINTS).max(1);
        let mut spread = [[0.0; 3]; 3];
        for place in target.positions().step_by(step).filter(inside) {
            let off = math::sub(place, middle);
            let part = math::outer(off, off);
            (0..3).for_each(|i| (0..3).for_each(|j| spread[i][j] += part[i][j]));
        }
        // Perpendicular to the two longest axes of the cloud.
        let (_, axes) = eigen::symmetric(&spread);
        let mut toward = axes[0];
        // Unknown viewpoint: from above, or from the front.
        let sensor = target.viewpoint().map_or([0.1, -0.2, 1.0], |at| math::sub(at, middle));
        if math::dot(toward, sensor) < 0.0 {
            toward = math::scaled(toward, -1.0);
        }
        let [x, y, z] = math::sub(high, low);
        // z is up if the cloud is flat perpendicular to z, as maps and sweeps are; else y, as for
        // objects in most files.
        if toward[2].abs() > 0.8 && x.min(y) > 3.0 * z {
            let toward = math::normalized([0.0, -FLAT_TILT, 1.0]);
            return Camera::from_direction(toward, [0.0, 0.0, 1.0]);
        }
        let upright = if toward[1].abs() > 0.9 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let up = orthogonal_unit(upright, toward);
        let right = math::cross(up, toward);
        let aside =
            math::add(math::scaled(right, SIDE_OFFSET[0]), math::scaled(up, SIDE_OFFSET[1]));
        let toward = math::normalized(math::add(toward, aside));
        Camera::from_direction(toward, upright)
    }

    fn from_direction(toward: Vec3, upright: Vec3) -> Camera {
        Camera { toward, upright, up: orthogonal_unit(upright, toward) }
    }

    /// Returns the rows: to the right, upwards, towards the camera.
    pub(super) fn axes(&self) -> Mat3 {
        [math::cross(self.up, self.toward), self.up, self.toward]
    }
}

/// Returns the normalised component of `vector` perpendicular to the unit vector `along`.
fn orthogonal_unit(vector: Vec3, along: Vec3) -> Vec3 {
    math::normalized(math::sub(vector, math::scaled(along, math::dot(vector, along))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_clouds_are_seen_from_above_and_axes_are_right_handed() {
        let grid = |place: fn(f64, f64) -> Vec3| {
            let points: Vec<Vec3> = (0..400)
                .map(|k| place(f64::from(k % 20), f64::from(k / 20) + 0.01 * f64::from(k)))
                .collect();
            PointCloud::new(&points).unwrap()
        };
        let flat = Camera::facing(&grid(|x, y| [x, y, 0.0]));
        assert!(flat.toward[2] > 0.7 && flat.up[2] > 0.5, "{flat:?}");
        let upright = Camera::facing(&grid(|x, z| [x, 0.0, z]));
        assert!(upright.toward[1].abs() > 0.8 && upright.up[2] > 0.9, "{upright:?}");
        for look in [flat, upright] {
            assert!((math::determinant(&look.axes()) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn strays_are_out_of_sight_and_small_clouds_are_not() {
        let mut points: Vec<Vec3> =
            (0..500).map(|k| [f64::from(k % 10), f64::from(k % 7), f64::from(k % 3)]).collect();
        points[100] = [1e5, 0.0, 0.0];
        let large = DisplayCloud::new(&PointCloud::new(&points).unwrap(), 1000).unwrap();
        let small =
            DisplayCloud::new(&PointCloud::new(&[[0.0; 3], [1.0; 3]]).unwrap(), 10).unwrap();
        let far = Transform { translation: [50.0, 0.0, 0.0], ..Transform::IDENTITY };
        let frame = Viewport::new(&small, &large, &far);
        assert!((20.0..40.0).contains(&frame.radius), "{frame:?}");
    }

    #[test]
    fn of_few_points_all_are_in_sight() {
        for n in 2..50 {
            let points: Vec<Vec3> = (0..n).map(|k| [f64::from(k * k), f64::from(k), 0.0]).collect();
            let shown = DisplayCloud::new(&PointCloud::new(&points).unwrap(), 100).unwrap();
            let frame = Viewport::new(&shown, &shown, &Transform::IDENTITY);
            for place in shown.cloud.positions() {
                let local = math::sub(place, shown.middle);
                let away = math::norm(math::sub(local, frame.center));
                assert!(away <= frame.radius * (1.0 + 1e-9), "{n}: {away} {frame:?}");
            }
        }
    }
}
