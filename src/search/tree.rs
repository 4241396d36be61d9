//! A tree for queries at any position: the only file that uses kiddo.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::{Neighbor, Neighborhood};
use crate::error::{Error, Result};

/// A k-d tree over points.
pub struct SearchTree {
    tree: ImmutableKdTree<f32, 3>,
    len: usize,
}

impl SearchTree {
    /// Builds the tree.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] without points, [`Error::NonFinite`] for a NaN or infinite
    /// coordinate, [`Error::Config`] for more points than 32-bit indices can count.
    pub fn new(points: &[[f32; 3]]) -> Result<Self> {
        // The tree accepts NaN silently and then gives wrong results.
        check(points)?;
        let tree = ImmutableKdTree::new_from_slice(points)
            .map_err(|error| Error::config("points", points.len(), error.to_string()))?;
        Ok(SearchTree { tree, len: points.len() })
    }

    /// Finds the nearest point.
    pub fn nearest(&self, query: &[f32; 3]) -> Neighbor {
        let found = self.tree.query(query).nearest_one::<SquaredEuclidean<f32>>().execute();
        Neighbor { index: found.item, squared_distance: found.distance }
    }

    /// Finds the k nearest points, nearest first; all points when there are fewer.
    pub fn k_nearest(&self, query: &[f32; 3], k: usize) -> Vec<Neighbor> {
        let Some(k) = NonZero::new(k.min(self.len)) else { return Vec::new() };
        let found = self.tree.query(query).nearest_n::<SquaredEuclidean<f32>>(k).execute();
        sort_by_distance(found.iter().map(|f| (f.item, f.distance)))
    }

    /// Finds all points at most `radius` away, nearest first.
    pub fn within(&self, query: &[f32; 3], radius: f64) -> Vec<Neighbor> {
        let squared = (radius * radius) as f32;
        let found = self.tree.query(query).within::<SquaredEuclidean<f32>>(squared).execute();
        sort_by_distance(found.iter().map(|f| (f.item, f.distance)))
    }

    pub(super) fn neighborhood(
        &self,
        query: &[f32; 3],
        neighborhood: Neighborhood,
    ) -> Vec<Neighbor> {
        match neighborhood {
            Neighborhood::Nearest(k) => self.k_nearest(query, k),
            Neighborhood::Radius(radius) => self.within(query, radius),
            Neighborhood::Hybrid { radius, max } => {
                let squared = (radius * radius) as f32;
                let mut found = self.k_nearest(query, max);
                found.retain(|neighbor| neighbor.squared_distance <= squared);
                found
            }
        }
    }
}

pub(super) fn sort_by_distance(found: impl Iterator<Item = (u32, f32)>) -> Vec<Neighbor> {
    let mut neighbors: Vec<Neighbor> =
        found.map(|(index, squared_distance)| Neighbor { index, squared_distance }).collect();
    neighbors.sort_unstable_by(|a, b| {
        a.squared_distance.total_cmp(&b.squared_distance).then(a.index.cmp(&b.index))
    });
    neighbors
}

/// Refuses clouds that cannot be searched.
pub(super) fn check(points: &[[f32; 3]]) -> Result<()> {
    if points.is_empty() {
        let what = "the cloud to be searched".into();
        return Err(Error::TooFewPoints { what, found: 0, needed: 1 });
    }
    if u32::try_from(points.len()).is_err() {
        let rule = "are more than 32-bit indices can count";
        return Err(Error::config("points", points.len(), rule));
    }
    match points.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        Some(index) => Err(Error::NonFinite { what: "points to be searched".into(), index }),
        None => Ok(()),
    }
}
