//! Weights of a method as reports show them.

use crate::math::Vec3;

/// The points that a method compared, and how strongly it connected them.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct WeightGraph {
    /// Whether all points of both clouds were connected; else only correspondences.
    pub full: bool,
    /// For correspondences, the largest distance between the ends of an inlier under the pose, in
    /// the target's unit.
    pub inlier_distance: Option<f64>,
    /// Positions of the compared points of source and target, each in its cloud's own frame.
    pub points: [Vec<Vec3>; 2],
    /// Sum of the weights of each point, 0 or more.
    pub weight_sums: [Vec<f64>; 2],
    /// For a full connection the heaviest link of every source point; for correspondences all of
    /// them, with their inlier weight under the pose, from 0 to 1, or with their weight in the solve
    /// ([`CfSpectral`](super::CfSpectral)). Heaviest first.
    pub links: Vec<WeightedLink>,
    /// Part of W; for correspondences, similarities of the descriptors from which they were found.
    pub block: WeightBlock,
}

/// A connection.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct WeightedLink {
    /// Number of the source point.
    pub source: u32,
    /// Number of the target point.
    pub target: u32,
    /// Weight of the link, 0 or more.
    pub weight: f64,
}

/// Weights between some points of the source and the points of the target that are nearest under
/// the pose: pairs that correspond under the pose are on the diagonal.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct WeightBlock {
    /// Numbers of the source points.
    pub rows: Vec<u32>,
    /// For each row the nearest target point under the pose.
    pub columns: Vec<u32>,
    /// Distance between the two, in the target's unit.
    pub distances: Vec<f64>,
    /// The descriptor of each row projected on the principal axis of the descriptors: similar
    /// points have similar values.
    pub principal_feature: Vec<f64>,
    /// Weights, row by row. For second-order weights ([`CfSpectral`](super::CfSpectral)) those of the connections whose
    /// ends are nearest to the point of the row and to that of the column, added.
    pub weights: Vec<f32>,
    /// For second-order weights those of the first order, of the same connections; else empty.
    pub first_order: Vec<f32>,
}
