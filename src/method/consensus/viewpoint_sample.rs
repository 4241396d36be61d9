//! A sample of a downsampled cloud, on which viewpoints are evaluated.

use crate::cloud::PointCloud;
use crate::error::Result;
use crate::filter;
use crate::math::{self, Vec3};
use crate::normals::{self, Orientation};
use crate::search::{Neighborhood, Neighbors};
use crate::visibility::OrientedSample;

/// Most points of the sample. Chosen by hand.
const MAX_VIEWPOINT_POINTS: usize = 1500;

/// Largest visibility cost ([`OrientedSample::visibility_cost`]) of the origin of a frame that may be
/// the viewpoint: 28 depth frames have 0.07 to 0.19 there; of random positions around them 15 % have
/// less. These cost the time of a trial: a pose ends the search only with high confidence.
const MAX_ORIGIN_COST: f64 = 0.2;

/// Some points of a downsampled cloud, on which viewpoints are evaluated. Positions are about its
/// origin.
pub(in crate::method) struct ViewpointSample {
    points: Vec<[f32; 3]>,
    /// Normals of either sign.
    normals: Vec<[f32; 3]>,
    /// From each point to the mean of its neighbours.
    pub(in crate::method) neighborhood_offsets: Vec<Vec3>,
    spacing: f64,
}

impl ViewpointSample {
    /// Samples a cloud that is downsampled to `length`.
    pub(in crate::method) fn new(thin: &PointCloud, length: f64) -> Result<Self> {
        let side = filter::voxel_size_for(thin, MAX_VIEWPOINT_POINTS)?;
        let few = match side > length {
            true => filter::voxel_grid(thin, side)?,
            false => thin.clone(),
        };
        let find = |k| Neighbors::find(few.points(), Neighborhood::Nearest(k));
        let normals = normals::estimate(&few, &find(15)?, Orientation::Outward)?.vectors;
        let around = find(30)?;
        let shift = math::sub(few.origin(), thin.origin());
        let place = |i: usize| math::add(few.points()[i].map(f64::from), shift);
        let places: Vec<Vec3> = (0..few.len()).map(place).collect();
        let toward = (0..few.len()).map(|i| {
            let near = around.indices(i);
            let sum = near.iter().fold([0.0; 3], |sum, &j| math::add(sum, places[j as usize]));
            math::sub(math::scaled(sum, 1.0 / near.len() as f64), places[i])
        });
        Ok(ViewpointSample {
            neighborhood_offsets: toward.collect(),
            points: places.iter().map(|p| p.map(|x| x as f32)).collect(),
            normals,
            spacing: side.max(length),
        })
    }

    pub(in crate::method) fn bytes(&self) -> usize {
        self.points.len() * (2 * 3 * 4 + 3 * 8)
    }

    /// Returns whether the sensor may have stood at `place`, the origin of the cloud's frame.
    pub(in crate::method) fn may_be_viewpoint(&self, place: Vec3) -> bool {
        self.oriented_sample().visibility_cost(place) < MAX_ORIGIN_COST
    }

    pub(in crate::method) fn oriented_sample(&self) -> OrientedSample<'_> {
        OrientedSample { points: &self.points, normals: &self.normals, spacing: self.spacing }
    }
}
