//! Pairs of points of two surfaces that overlap under a pose.

use super::{MIN_NORMAL_COSINE, Surface};
use crate::cloud::Transform;
use crate::math::{self, Vec3};

/// A source point and its nearest target point under the pose.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct SurfacePair {
    /// Weight of the pair, above 0.
    pub weight: f64,
    /// The moved source point.
    pub point: Vec3,
    /// The moved source point minus its target point.
    pub residual: Vec3,
    /// Unit normals of the moved source point and of its target point; of either sign.
    pub normals: [Vec3; 2],
}

impl SurfacePair {
    /// Unit mean of both normals, with the sign of the target's: along it the distance of two
    /// curved surfaces is free of their curvature (Rusinkiewicz 2019).
    pub fn mean_normal(&self) -> Vec3 {
        let [own, other] = self.normals;
        let sign = if math::dot(own, other) < 0.0 { -1.0 } else { 1.0 };
        math::normalized(math::add(math::scaled(own, sign), other))
    }
}

/// Returns pairs of every `stride`-th point of the source with the nearest point of the target
/// under `pose`, local frame to local frame, at most `max_distance` apart: the point numbers in
/// both, and the pair.
///
/// The weight of a pair is the cosine between its normals × (1 − d²/max_distance²)² × the weights
/// of its points.
pub(crate) fn surface_pairs<'a>(
    [source, target]: [&'a Surface; 2],
    pose: &'a Transform,
    max_distance: f64,
    stride: usize,
) -> impl Iterator<Item = (usize, usize, SurfacePair)> + 'a {
    (0..source.len()).step_by(stride).filter_map(move |i| {
        let point = pose.apply(source.point(i));
        let near = target.nearest(point)?;
        let far = f64::from(near.squared_distance) / (max_distance * max_distance);
        let j = near.index as usize;
        let normals = [pose.rotate(source.normal(i)), target.normal(j)];
        let cosine = math::dot(normals[0], normals[1]).abs();
        if far >= 1.0 || cosine < MIN_NORMAL_COSINE {
            return None;
        }
        let weight = cosine * (1.0 - far) * (1.0 - far) * source.weight(i) * target.weight(j);
        if weight <= 0.0 {
            return None;
        }
        let residual = math::sub(point, target.point(j));
        Some((i, j, SurfacePair { weight, point, residual, normals }))
    })
}
