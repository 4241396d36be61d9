//! The clouds as a page shows them: thinned, as small numbers, with what each point has to tell.

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
    /// Points that are shown, of how many, and how many of those drawn at random are not shown
    /// since they are strays, far out.
    pub(super) shown: usize,
    pub(super) of: usize,
    pub(super) strays: usize,
    /// Lowest corner of the box about the cloud's middle that positions are shares of, and its
    /// sides: three u16 a point, 65535 for the whole side.
    pub(super) low: Vec3,
    pub(super) size: Vec3,
    pub(super) positions: String,
    /// Unit normals of either sign, three i8 a point, 0 where there is none.
    pub(super) normals: String,
    /// Distance to the other cloud under the pose, a u8 a point: 0 to [`MAX_BYTE`] for 0 to the
    /// residuals' `most`, 255 beyond.
    pub(super) residuals: String,
    /// Weight that the nearest compared point received, a u8 a point, 255 where none is near;
    /// empty where nothing is known of weights.
    pub(super) weights: String,
    /// Median distance to the next shown point.
    pub(super) spacing: f64,
    /// What positions are relative to, in the cloud's own frame.
    #[serde(skip)]
    pub(super) middle: Vec3,
    /// The points drawn at random, strays too, and the places of those that are shown.
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

/// The largest of the small numbers that stand for values.
const MAX_BYTE: f64 = 250.0;
/// And what stands for none.
const NO_VALUE: u8 = 255;
/// Nearest points that make a normal.
const NORMAL_NEIGHBORS: usize = 12;
/// Share of the coordinates that is looked at for the middle of a cloud: strays do not move it.
const TRIMMED_SHARE: f64 = 0.02;
/// How far from the central box points are shown, in its longest side: with strays farther out,
/// 16 bits would not tell the others apart. Chosen by hand: of the box, 7000 steps are left.
const MAX_BOX_DISTANCE: f64 = 4.0;

impl DisplayCloud {
    /// At most `most` points of `cloud`, drawn at random.
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

    /// Measures how far each point is from `others`, all of the other cloud, once `pose` has
    /// brought it there; distances are told in units of `unit` of that frame, up to `most`.
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

    /// Gives each point the weight of the nearest of `points`, which received `received`, if that
    /// is within `reach`; told as a share of `most`, by its square root, so that small ones show.
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

/// Normals, and the median distance to the next point.
fn normals_and_spacing(cloud: &PointCloud) -> Result<(Vec<[f32; 3]>, f64)> {
    let spacing = crate::search::resolution(cloud.points())?;
    if cloud.len() < 3 {
        return Ok((vec![[0.0; 3]; cloud.len()], spacing));
    }
    let nearest = Neighborhood::Nearest(NORMAL_NEIGHBORS);
    let neighbors = Neighbors::find(cloud.points(), nearest)?;
    Ok((normals::estimate(cloud, &neighbors, Orientation::Outward)?.vectors, spacing))
}

/// The points that are not far from the central box.
fn points_near_box(cloud: &PointCloud, low: Vec3, high: Vec3) -> Vec<usize> {
    let longest = math::sub(high, low).into_iter().fold(0.0, f64::max);
    let margin = MAX_BOX_DISTANCE * longest;
    let near = |place: Vec3| {
        (0..3).all(|axis| (low[axis] - margin..=high[axis] + margin).contains(&place[axis]))
    };
    // Where nearly all lie in one place there is no length to go by.
    (0..cloud.len()).filter(|&i| longest == 0.0 || near(cloud.position(i))).collect()
}

/// The box about the points that strays do not blow up.
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
        // All lists tell of the same points; the distances tell of the strays, too.
        let lengths = [(&shown.positions, 6), (&shown.normals, 3), (&shown.residuals, 1)];
        for (text, each) in lengths.into_iter().chain([(&shown.weights, 1)]) {
            assert_eq!(STANDARD.decode(text).unwrap().len(), 2998 * each);
        }
        assert_eq!(shown.distances.len(), 3000);
        assert_eq!(shown.distances.iter().filter(|distance| distance.is_infinite()).count(), 2);
        // A heap of one place and some others: there is no length to go by.
        let mut heap = vec![[1.0; 3]; 1000];
        heap[3] = [2.0; 3];
        let heap = DisplayCloud::new(&PointCloud::new(&heap).unwrap(), 5000).unwrap();
        assert_eq!((heap.shown, heap.strays), (1000, 0));
    }
}
