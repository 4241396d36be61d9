//! From where two clouds are looked at.

use serde::Serialize;

use super::display::{Shown, central};
use crate::cloud::{PointCloud, Transform};
use crate::math::eigen;
use crate::math::{self, Mat3, Vec3};

/// A look at the target, about its middle and in its frame.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Look {
    /// What is looked at.
    pub(super) center: Vec3,
    /// How far what is to be seen reaches around it.
    pub(super) radius: f64,
    /// Unit vector from there to the eye.
    pub(super) toward: Vec3,
    /// Unit vector that is up, across `toward`.
    pub(super) up: Vec3,
}

/// How far flat things are looked at from beside, so that they do not look like a map: tangent.
const TILT: f64 = 0.8;
/// Points that the shape is measured by.
const MEASURED: usize = 2000;

impl Look {
    /// At both clouds as the pose has put them, from the side from which they look largest; of
    /// these two the one where the sensor stood, if that is known.
    pub(super) fn at(source: &Shown, target: &Shown, pose: &Transform) -> Look {
        let mut low = [f64::INFINITY; 3];
        let mut high = [f64::NEG_INFINITY; 3];
        let mut grow = |place: Vec3| {
            for axis in 0..3 {
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        };
        let local = |place: Vec3| math::sub(place, target.middle);
        let moved = |place: Vec3| local(pose.apply(place));
        corners(central(&target.cloud)).into_iter().for_each(|corner| grow(local(corner)));
        corners(central(&source.cloud)).into_iter().for_each(|corner| grow(moved(corner)));
        let center = math::scaled(math::add(low, high), 0.5);
        let radius = 0.5 * math::norm(math::sub(high, low));
        let radius = if radius > 0.0 { radius } else { 1.0 };
        let (toward, up) = directions(&target.cloud, center, target.middle);
        Look { center, radius, toward, up }
    }

    /// Rows: to the right, upwards, towards the eye.
    pub(super) fn axes(&self) -> Mat3 {
        [math::cross(self.up, self.toward), self.up, self.toward]
    }
}

fn corners((low, high): (Vec3, Vec3)) -> [Vec3; 8] {
    let ends = [low, high];
    std::array::from_fn(|k| [ends[k & 1][0], ends[k >> 1 & 1][1], ends[k >> 2 & 1][2]])
}

/// Towards the eye, and up.
fn directions(cloud: &PointCloud, center: Vec3, middle: Vec3) -> (Vec3, Vec3) {
    let step = cloud.len().div_ceil(MEASURED).max(1);
    let mut spread = [[0.0; 3]; 3];
    let (low, high) = central(cloud);
    let inside = |p: &Vec3| (0..3).all(|axis| (low[axis]..=high[axis]).contains(&p[axis]));
    for place in cloud.positions().step_by(step).filter(inside) {
        let off = math::sub(place, middle);
        let part = math::outer(off, off);
        (0..3).for_each(|i| (0..3).for_each(|j| spread[i][j] += part[i][j]));
    }
    let (_, axes) = eigen::symmetric(&spread);
    // Across the two longest axes of the cloud.
    let mut toward = axes[0];
    let sensor = cloud.viewpoint().unwrap_or_else(|| {
        // Nobody knows: from above, or from the front.
        math::add(math::add(middle, center), [0.1, 0.2, 1.0])
    });
    if math::dot(toward, math::sub(sensor, math::add(middle, center))) < 0.0 {
        toward = math::scaled(toward, -1.0);
    }
    // z is up where the cloud lies flat across it, as maps and sweeps do; else y, as objects
    // stand in most files.
    let upright = if toward[2].abs() > 0.8 && wide(low, high) {
        toward = math::normalized([0.0, -TILT, 1.0]);
        [0.0, 0.0, 1.0]
    } else if toward[1].abs() > 0.9 {
        [0.0, 0.0, 1.0]
    } else {
        [0.0, 1.0, 0.0]
    };
    let along = math::scaled(toward, math::dot(upright, toward));
    (toward, math::normalized(math::sub(upright, along)))
}

/// Whether a box is more than three times as wide as high.
fn wide(low: Vec3, high: Vec3) -> bool {
    let [x, y, z] = math::sub(high, low);
    x.min(y) > 3.0 * z
}
