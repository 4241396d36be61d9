//! Connections by position: squared distances under the current pose.
//!
//! The embedding of ICP, Kernel Correlation, CPD and DARE. The moments are those of the unmoved
//! points, so they give a pose of the *unmoved* source: no increments are composed and no error
//! accumulates.

use std::sync::Arc;

use super::cache::{Cached, HeapSize};
use crate::cloud::{Descriptors, PointCloud, Transform};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};
use crate::moments::{FeatureView, FullConnection};
use crate::par;
use crate::search::{Neighbor, SearchTree};

/// The two clouds of an iterative method, the target prepared once.
pub(super) struct PositionProblem<'a> {
    source: &'a PointCloud,
    target: &'a PointCloud,
    target_index: Arc<TargetIndex>,
    /// Weights of the points relative to their mean, for clouds that have weights.
    weights: [Option<Vec<f32>>; 2],
}

/// Values computed from the target alone.
struct TargetIndex {
    /// The target's points in units of its radius, the embedding of the dense connections.
    embedded: Descriptors,
    tree: SearchTree,
    rms_radius: f64,
}

/// Key of the [`TargetIndex`].
#[derive(PartialEq)]
struct TargetIndexKey;

impl HeapSize for TargetIndex {
    fn bytes(&self) -> usize {
        // The tree has a copy of the points, and their numbers.
        self.embedded.len() * (3 * 4 + 4 * 4)
    }
}

impl<'a> PositionProblem<'a> {
    /// # Errors
    /// Those of [`rms_radius`] and [`SearchTree::new`].
    pub(super) fn new(source: Cached<'a>, target: Cached<'a>) -> Result<Self> {
        let unit = rms_radius(source.cloud, target.cloud)?;
        let onto = target.get_or_compute(TargetIndexKey, || {
            let points = target.cloud.points();
            Ok(TargetIndex {
                embedded: embed_positions(points, unit)?,
                tree: SearchTree::new(points)?,
                rms_radius: unit,
            })
        })?;
        let (source, target) = (source.cloud, target.cloud);
        let weights = [source, target].map(PointCloud::relative_weights);
        Ok(PositionProblem { source, target, target_index: onto, weights })
    }

    /// Returns the input target.
    pub(super) fn target(&self) -> &'a PointCloud {
        self.target
    }

    /// Returns the root mean square distance of the target points to their centroid: the unit of
    /// bandwidths of [`full_connection`](Self::full_connection).
    pub(super) fn rms_radius(&self) -> f64 {
        self.target_index.rms_radius
    }

    /// Returns the source's points under `pose`, relative to the target's origin.
    ///
    /// # Errors
    /// [`Error::Extent`] when they leave the range of f32 distances.
    pub(super) fn transform_source(&self, pose: &Transform) -> Result<Vec<[f32; 3]>> {
        let origin = self.target.origin();
        let move_one = |p: Vec3| math::sub(pose.apply(p), origin).map(|x| x as f32);
        let moved: Vec<[f32; 3]> = self.source.positions().map(move_one).collect();
        if moved.as_flattened().iter().any(|x| x.is_nan() || x.abs() > 1e18) {
            return Err(Error::Extent { extent: f64::INFINITY });
        }
        Ok(moved)
    }

    /// Returns the weight of a pair of points: 1 if neither cloud has weights.
    pub(super) fn pair_weight(&self, source: usize, target: usize) -> f64 {
        let [a, b] = &self.weights;
        let of = |weights: &Option<Vec<f32>>, i: usize| {
            weights.as_ref().map_or(1.0, |weights| f64::from(weights[i]))
        };
        of(a, source) * of(b, target)
    }

    /// Returns the weights of the source's points relative to their mean, if it has any.
    pub(super) fn source_weights(&self) -> Option<&[f32]> {
        self.weights[0].as_deref()
    }

    /// Returns the weights of the target's points relative to their mean, if it has any.
    pub(super) fn target_weights(&self) -> Option<&[f32]> {
        self.weights[1].as_deref()
    }

    /// Returns the full connection by position at `pose`, with the weights of the points: squared
    /// distances are in squared [`rms_radius`](Self::rms_radius) units.
    ///
    /// # Errors
    /// Those of [`transform_source`](Self::transform_source).
    pub(super) fn full_connection(&self, pose: &Transform) -> Result<FullConnection> {
        let moved = embed_positions(&self.transform_source(pose)?, self.rms_radius())?;
        let side = |cloud: &'a PointCloud, descriptors| FeatureView {
            points: cloud.points(),
            origin: cloud.origin(),
            descriptors,
        };
        let connection = FullConnection::new(
            side(self.source, &moved),
            side(self.target, &self.target_index.embedded),
        )?;
        let [a, b] = &self.weights;
        connection.with_point_weights(a.as_deref(), b.as_deref())
    }

    /// Finds the nearest target point of every moved source point; distances in the target's unit.
    pub(super) fn nearest_targets(&self, moved: &[[f32; 3]]) -> Vec<Neighbor> {
        par::map(moved.len(), || (), |_, i| self.target_index.tree.nearest(&moved[i]))
    }
}

/// Returns the root mean square distance of the target points to their centroid: the unit of all
/// methods by position.
///
/// # Errors
/// [`Error::TooFewPoints`] for fewer than three points in either cloud, [`Error::Degenerate`] when
/// all target points are at one position.
pub(super) fn rms_radius(source: &PointCloud, target: &PointCloud) -> Result<f64> {
    for (cloud, what) in [(source, "the source"), (target, "the target")] {
        if cloud.len() < 3 {
            let found = cloud.len();
            return Err(Error::TooFewPoints { what: what.into(), found, needed: 3 });
        }
    }
    let center = target.centroid();
    let square = |p| math::dot(math::sub(p, center), math::sub(p, center));
    let unit = (target.positions().map(square).sum::<f64>() / target.len() as f64).sqrt();
    if unit <= 0.0 {
        return Err(Error::Degenerate { rank: 0, singular_values: [0.0; 3] });
    }
    Ok(unit)
}

fn embed_positions(points: &[[f32; 3]], unit: f64) -> Result<Descriptors> {
    let value = |&x: &f32| (f64::from(x) / unit) as f32;
    Descriptors::new(3, points.as_flattened().iter().map(value).collect())
}
