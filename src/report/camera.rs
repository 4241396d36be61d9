//! From where two clouds are looked at.

use serde::Serialize;

use super::display::{DisplayCloud, robust_bounds};
use crate::cloud::{PointCloud, Transform};
use crate::math::eigen;
use crate::math::{self, Mat3, Vec3};

/// What is to be seen: a ball about the target's middle, in its frame.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Viewport {
    pub(super) center: Vec3,
    pub(super) radius: f64,
}

/// From where.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Camera {
    /// Unit vector to the eye.
    pub(super) toward: Vec3,
    /// Unit vector that is up in space; the page turns about it.
    pub(super) upright: Vec3,
    /// And on the picture: the part of it across `toward`.
    pub(super) up: Vec3,
}

/// How far flat things are looked at from beside, so that they do not look like a map: tangent.
const FLAT_TILT: f64 = 0.8;
/// How far other things are, to the right and from above, so that they have depth.
const SIDE_OFFSET: [f64; 2] = [0.3, 0.2];
/// Points of a cloud that are measured.
const MAX_SAMPLED_POINTS: usize = 2000;
/// Share of them that is to be seen; the rest may be strays.
const VISIBLE_SHARE: f64 = 0.99;

impl Viewport {
    /// Of both clouds, with the source where `pose` puts it.
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
        // Each cloud by itself, that the smaller does not count as strays of the larger.
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
            // Few points have no strays.
            away[(VISIBLE_SHARE * (away.len() - 1) as f64).round() as usize]
        });
        let radius = radius.fold(0.0, f64::max);
        Viewport { center, radius: if radius > 0.0 { radius } else { 1.0 } }
    }
}

impl Camera {
    /// From the side from which the target looks largest; of the two the one where its sensor
    /// stood, if that is known.
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
        // Across the two longest axes of the cloud.
        let (_, axes) = eigen::symmetric(&spread);
        let mut toward = axes[0];
        // Where nobody knows: from above, or from the front.
        let sensor = target.viewpoint().map_or([0.1, -0.2, 1.0], |at| math::sub(at, middle));
        if math::dot(toward, sensor) < 0.0 {
            toward = math::scaled(toward, -1.0);
        }
        let [x, y, z] = math::sub(high, low);
        // z is up where the cloud lies flat across it, as maps and sweeps do; else y, as objects
        // stand in most files.
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

    /// Rows: to the right, upwards, towards the eye.
    pub(super) fn axes(&self) -> Mat3 {
        [math::cross(self.up, self.toward), self.up, self.toward]
    }
}

/// The part of `vector` across the unit vector `along`, of length 1.
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
