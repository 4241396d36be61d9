//! The clouds as a page shows them: downsampled, quantised, with values for each point.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use crate::cloud::{PointCloud, Transform};
use crate::error::Result;
use crate::filter;
use crate::math::{self, Vec3};
use crate::normals::{self, Orientation};
use crate::par;
use crate::search::{Neighborhood, Neighbors, SearchTree};

/// A cloud to be drawn. Numbers are base64 of little-endian arrays.
#[derive(Debug, Clone, Serialize)]
pub(super) struct DisplayCloud {
    /// Numbers of points that are shown, of all points, and of sampled points that are not shown
    /// because they are distant outliers.
    pub(super) shown: usize,
    pub(super) of: usize,
    pub(super) strays: usize,
    /// Lowest corner and sides of the box that positions are relative to, about the cloud's middle:
    /// three u16 a point, 65535 for the whole side.
    pub(super) low: Vec3,
    pub(super) size: Vec3,
    pub(super) positions: String,
    /// Unit normals of either sign, three i8 a point, 0 if there is none.
    pub(super) normals: String,
    /// Distance to the other cloud at the pose, a u8 a point: 0 to [`MAX_BYTE`] for 0 to the
    /// residuals' `most`, 255 beyond.
    pub(super) residuals: String,
    /// Total weight of the nearest compared point, a u8 a point, 255 if none is near; empty without
    /// weights.
    pub(super) weights: String,
    /// Median distance to the nearest shown point.
    pub(super) spacing: f64,
    /// Origin of the positions, in the cloud's own frame.
    #[serde(skip)]
    pub(super) middle: Vec3,
    /// The sampled points, including outliers, and the indices of those that are shown.
    #[serde(skip)]
    pub(super) cloud: PointCloud,
    #[serde(skip)]
    shown_indices: Vec<usize>,
    /// Normals of either sign, or zero.
    #[serde(skip)]
    pub(super) normal_vectors: Vec<[f32; 3]>,
    /// Distances in the target's unit, infinite beyond.
    #[serde(skip)]
    pub(super) distances: Vec<f32>,
}

/// Largest quantised value. Chosen by hand.
const MAX_BYTE: f64 = 250.0;
/// Quantised value for "none".
const NO_VALUE: u8 = 255;
/// Nearest points for a normal. Chosen by hand.
const NORMAL_NEIGHBORS: usize = 12;
/// Share of the coordinates ignored at each end for the middle of a cloud: outliers do not move it.
/// Chosen by hand.
const TRIMMED_SHARE: f64 = 0.02;
/// Largest distance of shown points from the central box, in its longest side: with more distant
/// outliers, 16 bits would not resolve the other points. Chosen by hand: 7000 steps of the box are
/// left.
const MAX_BOX_DISTANCE: f64 = 4.0;

impl DisplayCloud {
    /// Downsamples `cloud` at random to at most `most` points.
    pub(super) fn new(cloud: &PointCloud, most: usize) -> Result<DisplayCloud> {
        let thin = filter::sample(cloud, most, 0);
        let (low, high) = robust_bounds(&thin);
        let middle = math::scaled(math::add(low, high), 0.5);
        let within = points_near_box(&thin, low, high);
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for &i in &within {
            let place = thin.position(i);
            low = [0, 1, 2].map(|axis| low[axis].min(place[axis]));
            high = [0, 1, 2].map(|axis| high[axis].max(place[axis]));
        }
        let size = math::sub(high, low).map(|side| if side > 0.0 { side } else { 1.0 });
        let share = |place: Vec3, axis: usize| (place[axis] - low[axis]) / size[axis];
        let mut positions = Vec::with_capacity(6 * within.len());
        for &i in &within {
            for axis in 0..3 {
                let number = (share(thin.position(i), axis) * 65535.0).round() as u16;
                positions.extend(number.to_le_bytes());
            }
        }
        let (vectors, spacing) = normals_and_spacing(&thin)?;
        let small = |x: &f32| (x * 127.0).round() as i8 as u8;
        let normals: Vec<u8> = within.iter().flat_map(|&i| &vectors[i]).map(small).collect();
        Ok(DisplayCloud {
            shown: within.len(),
            of: cloud.len(),
            strays: thin.len() - within.len(),
            low: math::sub(low, middle),
            size,
            positions: STANDARD.encode(positions),
            normals: STANDARD.encode(normals),
            residuals: String::new(),
            weights: String::new(),
            spacing,
            middle,
            cloud: thin,
            shown_indices: within,
            normal_vectors: vectors,
            distances: Vec::new(),
        })
    }

    /// Measures the distance of each point, transformed by `pose`, to all points `others` of the
    /// other cloud; distances are in units of `unit` of that frame, up to `most`.
    pub(super) fn set_residuals(
        &mut self,
        others: &PointCloud,
        pose: &Transform,
        unit: f64,
        most: f64,
    ) -> Result<()> {
        let moved = |p| math::sub(pose.apply(p), others.origin()).map(|x| x as f32);
        let moved: Vec<[f32; 3]> = self.cloud.positions().map(moved).collect();
        let tree = SearchTree::new(others.points())?;
        let away = |i: usize| f64::from(tree.nearest(&moved[i]).squared_distance).sqrt() * unit;
        let seen = |distance: f64| if distance <= most { distance as f32 } else { f32::INFINITY };
        self.distances = par::map(moved.len(), || (), |_, i| seen(away(i)));
        let small = |&i: &usize| {
            let distance = self.distances[i];
            if distance.is_finite() { share_to_byte(f64::from(distance) / most) } else { NO_VALUE }
        };
        self.residuals = STANDARD.encode(self.shown_indices.iter().map(small).collect::<Vec<u8>>());
        Ok(())
    }

    /// Assigns to each point the weight in `received` of the nearest of `points`, if that is within
    /// `reach`. The stored value is the square root of its share of `most`, so that small weights
    /// are visible.
    pub(super) fn set_weights(
        &mut self,
        points: &[Vec3],
        received: &[f64],
        reach: f64,
        most: f64,
    ) -> Result<()> {
        let origin = self.cloud.origin();
        let local: Vec<[f32; 3]> =
            points.iter().map(|&p| math::sub(p, origin).map(|x| x as f32)).collect();
        let tree = SearchTree::new(&local)?;
        let own = self.cloud.points();
        let bytes = par::map(
            self.shown_indices.len(),
            || (),
            |_, i| {
                let nearest = tree.nearest(&own[self.shown_indices[i]]);
                let near = f64::from(nearest.squared_distance).sqrt() <= reach;
                let share = received[nearest.index as usize] / most;
                if near && share >= 0.0 { share_to_byte(share.min(1.0).sqrt()) } else { NO_VALUE }
            },
        );
        self.weights = STANDARD.encode(bytes);
        Ok(())
    }
}

fn share_to_byte(share: f64) -> u8 {
    (share * MAX_BYTE).round() as u8
}

/// Estimates normals, and the median distance to the nearest point.
fn normals_and_spacing(cloud: &PointCloud) -> Result<(Vec<[f32; 3]>, f64)> {
    let spacing = crate::search::resolution(cloud.points())?;
    if cloud.len() < 3 {
        return Ok((vec![[0.0; 3]; cloud.len()], spacing));
    }
    let nearest = Neighborhood::Nearest(NORMAL_NEIGHBORS);
    let neighbors = Neighbors::find(cloud.points(), nearest)?;
    Ok((normals::estimate(cloud, &neighbors, Orientation::Outward)?.vectors, spacing))
}

/// Returns the points that are not far from the central box.
fn points_near_box(cloud: &PointCloud, low: Vec3, high: Vec3) -> Vec<usize> {
    let longest = math::sub(high, low).into_iter().fold(0.0, f64::max);
    let margin = MAX_BOX_DISTANCE * longest;
    let near = |place: Vec3| {
        (0..3).all(|axis| (low[axis] - margin..=high[axis] + margin).contains(&place[axis]))
    };
    // If nearly all points coincide there is no length scale.
    (0..cloud.len()).filter(|&i| longest == 0.0 || near(cloud.position(i))).collect()
}

/// Returns a bounding box that is robust to outliers.
pub(super) fn robust_bounds(cloud: &PointCloud) -> (Vec3, Vec3) {
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    for axis in 0..3 {
        let mut along: Vec<f64> = cloud.positions().map(|p| p[axis]).collect();
        if along.is_empty() {
            continue;
        }
        along.sort_by(f64::total_cmp);
        let at = |share: f64| along[(share * (along.len() - 1) as f64).round() as usize];
        (low[axis], high[axis]) = (at(TRIMMED_SHARE), at(1.0 - TRIMMED_SHARE));
    }
    (low, high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::shape::boulder;

    #[test]
    fn small_numbers_are_the_points() {
        let cloud = boulder().sample(3000, 1).unwrap();
        let shown = DisplayCloud::new(&cloud, 1000).unwrap();
        assert_eq!((shown.shown, shown.of), (1000, 3000));
        let bytes = STANDARD.decode(&shown.positions).unwrap();
        for (k, place) in shown.cloud.positions().enumerate() {
            for axis in 0..3 {
                let at = 6 * k + 2 * axis;
                let number = f64::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
                let back = shown.low[axis] + shown.size[axis] * number / 65535.0;
                let back = back + shown.middle[axis];
                assert!((back - place[axis]).abs() < 1e-4, "{back} {}", place[axis]);
            }
        }
        assert_eq!(STANDARD.decode(&shown.normals).unwrap().len(), 3000);
    }

    #[test]
    fn residuals_and_weights_are_shares() {
        let line = |shift: f64| {
            let points: Vec<Vec3> = (0..50).map(|k| [f64::from(k), shift, 0.0]).collect();
            PointCloud::new(&points).unwrap()
        };
        let mut shown = DisplayCloud::new(&line(0.5), 100).unwrap();
        shown.set_residuals(&line(0.0), &Transform::IDENTITY, 1.0, 1.0).unwrap();
        assert_eq!(STANDARD.decode(&shown.residuals).unwrap(), vec![125; 50]);
        shown.set_residuals(&line(0.0), &Transform::IDENTITY, 1.0, 0.4).unwrap();
        assert_eq!(STANDARD.decode(&shown.residuals).unwrap(), vec![NO_VALUE; 50]);
        assert!(shown.distances.iter().all(|distance| distance.is_infinite()));
        let two = [[0.0, 0.5, 0.0], [1.0, 0.5, 0.0]];
        shown.set_weights(&two, &[4.0, 1.0], 0.1, 4.0).unwrap();
        let bytes = STANDARD.decode(&shown.weights).unwrap();
        assert_eq!(bytes[..3], [250, 125, NO_VALUE]);
    }

    #[test]
    fn few_points_are_shown_too() {
        for n in 1..4 {
            let points: Vec<Vec3> = (0..n).map(|k| [f64::from(k); 3]).collect();
            let shown = DisplayCloud::new(&PointCloud::new(&points).unwrap(), 10).unwrap();
            assert_eq!(shown.shown, n as usize);
        }
    }

    #[test]
    fn strays_are_counted_and_cost_no_digits() {
        let boulder = boulder().sample(3000, 1).unwrap();
        let mut points: Vec<Vec3> = boulder.positions().collect();
        points[7] = [1e5, 0.0, 0.0];
        points[1234] = [-1e5, 0.0, 3.0];
        let cloud = PointCloud::new(&points).unwrap();
        let mut shown = DisplayCloud::new(&cloud, 5000).unwrap();
        shown.set_residuals(&boulder, &Transform::IDENTITY, 1.0, 1.0).unwrap();
        shown.set_weights(&points, &vec![1.0; points.len()], 1.0, 1.0).unwrap();
        assert_eq!((shown.shown, shown.strays, shown.of), (2998, 2, 3000));
        assert!(shown.size.iter().all(|&side| side < 4.0), "{:?}", shown.size);
        // All lists have the same points; the distances also include outliers.
        let lengths = [(&shown.positions, 6), (&shown.normals, 3), (&shown.residuals, 1)];
        for (text, each) in lengths.into_iter().chain([(&shown.weights, 1)]) {
            assert_eq!(STANDARD.decode(text).unwrap().len(), 2998 * each);
        }
        assert_eq!(shown.distances.len(), 3000);
        assert_eq!(shown.distances.iter().filter(|distance| distance.is_infinite()).count(), 2);
        // Coincident points and some others: there is no length scale.
        let mut heap = vec![[1.0; 3]; 1000];
        heap[3] = [2.0; 3];
        let heap = DisplayCloud::new(&PointCloud::new(&heap).unwrap(), 5000).unwrap();
        assert_eq!((heap.shown, heap.strays), (1000, 0));
    }
}
