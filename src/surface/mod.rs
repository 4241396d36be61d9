//! The surface of a scan: points with normals and descriptors, and the sensor's depth image; pairs
//! of two surfaces under a pose; refinement of a pose on two surfaces.
//!
//! Positions are local, about an origin, in f32.

mod normal_equations;
mod pairs;
mod refine;
mod similarity;

pub use pairs::SurfacePair;

use std::sync::Arc;

use crate::cloud::{Descriptors, Transform};
use crate::error::Result;
use crate::math::{self, Vec3};
use crate::moments::FeatureView;
use crate::normals::OrientedBy;
use crate::search::{CellGrid, Neighbor, OccupancyGrid, SearchTree};
use crate::visibility::DepthImage;

pub(crate) use normal_equations::{NormalEquations, twist_row};
pub(crate) use pairs::surface_pairs;
pub(crate) use refine::{RefineOptions, Refined, refine};
pub(crate) use similarity::refine_with_scale;

/// Distance within which surfaces overlap, in voxels. Chosen by hand.
pub(crate) const INLIER_DISTANCE: f64 = 1.5;
/// Smallest cosine of the angle between normals of surfaces that face the same way: 45 degrees.
/// Chosen by hand.
pub(crate) const MIN_NORMAL_COSINE: f64 = 0.7;
/// Largest distance of the search for a surface, in voxels. Chosen by hand.
pub(crate) const SEARCH_RADIUS: f64 = 2.0 * INLIER_DISTANCE;

/// Points of a surface with their normals and descriptors. Positions are about `origin`.
#[derive(Clone)]
pub(crate) struct Surface {
    pub(crate) points: Vec<[f32; 3]>,
    pub(crate) origin: Vec3,
    /// Unit vectors.
    pub(crate) normals: Vec<[f32; 3]>,
    pub(crate) descriptors: Descriptors,
    /// Descriptors by which correspondences are found, if they are not `descriptors`: those that
    /// the cloud carries, alone or joined with others.
    pub(crate) matching: Option<Arc<Descriptors>>,
    /// Values of channels at the points, channel by channel, until they are appended to the
    /// descriptors.
    pub(crate) channels: Vec<Vec<f32>>,
    /// Weights of the points; `None`, all equal, if the cloud has no weights.
    pub(crate) weights: Option<Vec<f32>>,
    pub(crate) index: Arc<SurfaceIndex>,
    /// The sensor's depth image, if the viewpoint is known.
    pub(crate) depth_image: Option<Arc<DepthImage>>,
    pub(crate) oriented_by: OrientedBy,
}

/// Finds the nearest point of a surface.
pub(crate) struct SurfaceIndex {
    tree: SearchTree,
    occupancy: OccupancyGrid,
    cells: CellGrid,
}

impl SurfaceIndex {
    /// Builds an index of `points`, for queries up to `radius`.
    ///
    /// # Errors
    /// Those of [`SearchTree::new`].
    pub(crate) fn new(points: &[[f32; 3]], radius: f64) -> Result<Self> {
        Ok(SurfaceIndex {
            tree: SearchTree::new(points)?,
            occupancy: OccupancyGrid::new(points, radius),
            cells: CellGrid::new(points, radius / SEARCH_RADIUS * INLIER_DISTANCE),
        })
    }

    /// Bytes of an index of `count` points: the tree has a copy of the points, with their numbers.
    pub(crate) fn bytes(&self, count: usize) -> usize {
        count * 4 * 4 + self.occupancy.bytes() + self.cells.bytes()
    }
}

impl Surface {
    pub(crate) fn len(&self) -> usize {
        self.points.len()
    }

    pub(crate) fn point(&self, i: usize) -> Vec3 {
        self.points[i].map(f64::from)
    }

    /// Finds the point nearest to `place`; mostly `None` if that point is farther away than the
    /// radius of the index.
    pub(crate) fn nearest(&self, place: Vec3) -> Option<Neighbor> {
        let place = place.map(|x| x as f32);
        self.index.occupancy.may_contain(&place).then(|| self.index.tree.nearest(&place))
    }

    /// Finds the point nearest to `place`; `None` if it is not nearer than `max_distance`, at most the
    /// radius of the index.
    pub(crate) fn nearest_within(&self, place: Vec3, max_distance: f64) -> Option<Neighbor> {
        let square = max_distance * max_distance;
        self.nearest(place).filter(|near| f64::from(near.squared_distance) < square)
    }

    /// Returns the numbers of the points in the cube of side [`INLIER_DISTANCE`] voxels that
    /// contains `place`.
    pub(crate) fn points_in_cell(&self, place: Vec3) -> &[u32] {
        self.index.cells.points_near(place)
    }

    pub(crate) fn normal(&self, i: usize) -> Vec3 {
        self.normals[i].map(f64::from)
    }

    /// Weight of point `i`, 1 in the mean.
    pub(crate) fn weight(&self, i: usize) -> f64 {
        self.weights.as_ref().map_or(1.0, |weights| f64::from(weights[i]))
    }

    /// Builds the surface of a cloud without descriptors, for tests.
    #[cfg(test)]
    pub(crate) fn of_cloud(cloud: &crate::cloud::PointCloud, radius: f64) -> Surface {
        use crate::normals::{Orientation, estimate};
        use crate::search::{Neighborhood, Neighbors};
        let near = Neighbors::find(cloud.points(), Neighborhood::Nearest(20)).unwrap();
        let normals = estimate(cloud, &near, Orientation::Outward).unwrap().vectors;
        Surface {
            points: cloud.points().to_vec(),
            origin: cloud.origin(),
            normals,
            descriptors: Descriptors::new(1, vec![0.0; cloud.len()]).unwrap(),
            matching: None,
            channels: Vec::new(),
            weights: None,
            index: SurfaceIndex::new(cloud.points(), radius).unwrap().into(),
            depth_image: None,
            oriented_by: OrientedBy::Centroid,
        }
    }

    /// The descriptors by which correspondences are found.
    pub(crate) fn matching_descriptors(&self) -> &Descriptors {
        self.matching.as_deref().unwrap_or(&self.descriptors)
    }

    /// One side of a full connection by these descriptors of the points.
    pub(crate) fn feature_view<'a>(&'a self, descriptors: &'a Descriptors) -> FeatureView<'a> {
        FeatureView { points: &self.points, origin: self.origin, descriptors }
    }
}

/// Converts a pose between local frames into one between the clouds' own frames.
pub(crate) fn to_cloud_frames(pose: &Transform, from: &Surface, onto: &Surface) -> Transform {
    let there = math::add(pose.translation, onto.origin);
    Transform { translation: math::sub(there, pose.rotate(from.origin)), ..*pose }
}

/// Converts a pose between the clouds' own frames into one between local frames.
pub(crate) fn to_local_frames(pose: &Transform, from: &Surface, onto: &Surface) -> Transform {
    Transform { translation: math::sub(pose.apply(from.origin), onto.origin), ..*pose }
}
