//! Near misses: surface of one cloud that the other cloud measured elsewhere.
//!
//! A point that lies inside the extent of the other surface, faces the same way, and is several
//! voxels off along its normal contradicts the pose: both clouds measured a surface there, and the
//! two surfaces cannot both be right. A point past the border of the other surface says nothing.

use crate::math::{self, Vec3};
use crate::surface::{INLIER_DISTANCE, Surface};

/// Smallest cosine of the angle between normals of surfaces that face the same way: 72 degrees.
/// Chosen by hand.
const MIN_FACING_COSINE: f64 = 0.3;
/// Largest offset along the normal of a near miss, in voxels. Chosen by hand.
const MAX_OFFSET: f64 = 15.0;
/// Smallest offset along the normal of a near miss, in voxels: the range of the bound that follows
/// the noise of the surfaces. Chosen by hand.
const MIN_OFFSET_RANGE: [f64; 2] = [2.0, 4.0];
/// Smallest offset along the normal of a near miss, in standard deviations of the offset of
/// surfaces that agree. Chosen by hand.
const MIN_OFFSET_STD: f64 = 4.0;
/// Distance of positions along a normal at which the other surface is looked up, in voxels: the
/// side of a cell.
const STEP: f64 = INLIER_DISTANCE;
/// Agreeing points, and near misses, that are added to those counted: few points say little, and a
/// pose without overlap must not be the one without conflict. Chosen by hand.
const PRIOR_COUNTS: [f64; 2] = [17.0, 3.0];

/// Points of two surfaces by what the other surface says to them. The first index is 0 for pairs of
/// normals of the same sign and 1 for those of opposite signs.
#[derive(Debug, Clone, Default)]
pub(super) struct ConflictCounts {
    /// Number of points on the other surface that face the same way.
    agreeing: [usize; 2],
    /// Sum of the squares of their offsets along the normal, in voxels².
    squared_offsets: [f64; 2],
    /// Offset along the normal, in voxels, of each other point from the nearest surface that faces
    /// the same way: of points before that surface, on the side to which its normal points, and of
    /// points behind it.
    offsets: [[Vec<f64>; 2]; 2],
}

impl ConflictCounts {
    /// Counts a point that is on the other surface; `offset` is along the normal, in voxels, and
    /// `cosine` that of the angle between both normals.
    pub(super) fn add_agreeing(&mut self, cosine: f64, offset: f64) {
        if cosine.abs() > MIN_FACING_COSINE {
            let sign = usize::from(cosine < 0.0);
            self.agreeing[sign] += 1;
            self.squared_offsets[sign] += offset * offset;
        }
    }

    /// Counts a point that is not on the surface `onto`: looks up what is before and behind it.
    pub(super) fn add_missing(&mut self, onto: &Surface, point: Vec3, normal: Vec3, voxel: f64) {
        let mut nearest = [[f64::INFINITY; 2]; 2];
        for direction in [1.0, -1.0] {
            let mut along = INLIER_DISTANCE + 0.5 * STEP;
            while along < MAX_OFFSET {
                let place = math::add(point, math::scaled(normal, direction * along * voxel));
                for &j in onto.points_in_cell(place) {
                    let j = j as usize;
                    let from = math::sub(point, onto.point(j));
                    let offset = math::dot(from, normal);
                    let tangential = math::sub(from, math::scaled(normal, offset));
                    let cosine = math::dot(normal, onto.normal(j));
                    let distance = offset.abs() / voxel;
                    if math::norm(tangential) < INLIER_DISTANCE * voxel
                        && (INLIER_DISTANCE..MAX_OFFSET).contains(&distance)
                        && cosine.abs() > MIN_FACING_COSINE
                    {
                        let side = usize::from(offset * cosine < 0.0);
                        let least = &mut nearest[usize::from(cosine < 0.0)][side];
                        *least = least.min(distance);
                    }
                }
                along += STEP;
            }
        }
        for (all, found) in self.offsets.iter_mut().flatten().zip(nearest.into_iter().flatten()) {
            if found.is_finite() {
                all.push(found);
            }
        }
    }

    /// Returns the counts of both directions together; `other` are those of the opposite direction.
    pub(super) fn merged(mut self, other: ConflictCounts) -> ConflictCounts {
        for sign in 0..2 {
            self.agreeing[sign] += other.agreeing[sign];
            self.squared_offsets[sign] += other.squared_offsets[sign];
            for side in 0..2 {
                // Sides are those of the first direction: normals of opposite signs swap them.
                self.offsets[sign][side].extend(&other.offsets[sign][side ^ sign]);
            }
        }
        self
    }

    /// Relative sign of the normals of both clouds: 0 if more points agree with normals of the same
    /// sign, else 1.
    fn sign(&self) -> usize {
        usize::from(self.agreeing[1] > self.agreeing[0])
    }

    /// Standard deviation of the offset of agreeing points along the normal, in voxels.
    pub(super) fn offset_std(&self) -> f64 {
        let sign = self.sign();
        (self.squared_offsets[sign] / self.agreeing[sign].max(1) as f64).sqrt()
    }

    /// Share of near misses among the points that agree or miss, in (0, 1), for a pose with an
    /// error of up to `pose_error` voxels.
    ///
    /// At a correct pose a surface may be behind another one that hides it from the sensor of the
    /// other cloud: then all misses are on one side. At a wrong pose there are as many on both
    /// sides: the smaller number counts twice.
    pub(super) fn share(&self, pose_error: f64) -> f64 {
        let sign = self.sign();
        let [low, high] = MIN_OFFSET_RANGE;
        let least = (MIN_OFFSET_STD * self.offset_std()).clamp(low, high) + pose_error;
        let count = |all: &Vec<f64>| all.iter().filter(|&&offset| offset >= least).count();
        let [before, behind] = self.offsets[sign].each_ref().map(count);
        let missing = 2.0 * before.min(behind) as f64;
        let [agreeing, missed] = PRIOR_COUNTS;
        (missing + missed) / (self.agreeing[sign] as f64 + missing + agreeing + missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{PointCloud, Transform};

    /// A patch of a plane of side 30 about the origin.
    fn patch(shift: f64) -> Surface {
        let at = |i: usize| [(i % 30) as f64 - 15.0, (i / 30) as f64 - 15.0, shift];
        let all: Vec<_> = (0..900).map(at).collect();
        Surface::of_cloud(&PointCloud::new(&all).unwrap(), 3.0)
    }

    /// Counts of one direction between two patches.
    fn counts(from: &Surface, onto: &Surface, pose: &Transform) -> ConflictCounts {
        let mut counts = ConflictCounts::default();
        for i in 0..from.len() {
            let (point, normal) = (pose.apply(from.point(i)), pose.rotate(from.normal(i)));
            let near = onto.nearest(point).filter(|near| near.squared_distance < 2.25);
            match near {
                Some(near) => {
                    let j = near.index as usize;
                    let off = math::dot(math::sub(point, onto.point(j)), normal);
                    counts.add_agreeing(math::dot(normal, onto.normal(j)), off);
                }
                None => counts.add_missing(onto, point, normal, 1.0),
            }
        }
        counts
    }

    fn conflict(from: &Surface, onto: &Surface, shift: Vec3) -> f64 {
        let pose = Transform { translation: shift, ..Transform::IDENTITY };
        let forward = counts(from, onto, &pose);
        forward.merged(counts(onto, from, &pose.inverse())).share(0.0)
    }

    /// The patch with normals along z of one sign.
    fn facing(sign: f32) -> Surface {
        let mut patch = patch(0.0);
        patch.normals.iter_mut().for_each(|normal| *normal = [0.0, 0.0, sign]);
        patch
    }

    #[test]
    fn a_surface_off_along_its_normal_is_in_conflict() {
        for (from, onto) in [(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)] {
            let (from, onto) = (facing(from), facing(onto));
            assert!(conflict(&from, &onto, [0.0; 3]) < 0.01);
            for offset in [3.0, -6.0, 12.0] {
                let found = conflict(&from, &onto, [0.0, 0.0, offset]);
                // Nothing agrees: the relative sign of the normals is unknown.
                assert!(found > 0.95 || from.normals[0] != onto.normals[0], "{offset}: {found}");
            }
            // Past the border nothing is known, and so far away it is another surface.
            assert!(conflict(&from, &onto, [20.0, 0.0, 0.0]) < 0.02);
            assert!((conflict(&from, &onto, [0.0, 0.0, 20.0]) - 0.15).abs() < 1e-12);
        }
    }

    #[test]
    fn a_hidden_surface_is_in_no_conflict() {
        // A model of two plates, and a view that sees the upper one alone.
        let plate = |z: f64| (0..900).map(move |i| [(i % 30) as f64, (i / 30) as f64, z]);
        let surface = |all: Vec<Vec3>| {
            let mut surface = Surface::of_cloud(&PointCloud::new(&all).unwrap(), 3.0);
            surface.normals.iter_mut().for_each(|normal| *normal = [0.0, 0.0, 1.0]);
            surface
        };
        let model = surface(plate(0.0).chain(plate(6.0)).collect());
        let view = surface(plate(6.0).collect());
        let pose = crate::surface::to_local_frames(&Transform::IDENTITY, &view, &model);
        let forward = counts(&view, &model, &pose);
        assert!(forward.merged(counts(&model, &view, &pose.inverse())).share(0.0) < 0.01);
    }
}
