//! Normals, keypoints and descriptors of a cloud.

use super::{DescriptorScale, FeatureConfig};
use crate::cloud::{Descriptors, PointCloud};
use crate::descriptor::{Descriptor, Fpfh, PreparedCloud};
use crate::error::{Error, Result};
use crate::keypoint::Keypoints;
use crate::method::registration::Timings;
use crate::normals::{self, Normals, Orientation, OrientedBy};
use crate::search::{Neighborhood, Neighbors};

impl FeatureConfig {
    /// Computes normals, keypoints and descriptors: FPFH at all scales, or the `given` rows if they
    /// replace it.
    pub(super) fn describe(
        &self,
        cloud: &PointCloud,
        name: &str,
        detector: Option<&Keypoints>,
        given: Option<&Descriptors>,
        times: &mut Timings,
    ) -> Result<DescribedPoints> {
        let points = cloud.points();
        let find = |neighborhood| Neighbors::find(points, neighborhood);
        let neighbors = times.time("neighbors", || find(self.neighborhood))?;
        let normals = self.estimate_normals(cloud, &neighbors, self.first_scale(), times)?;
        if normals.undefined_count() == points.len() {
            return Err(self.no_normals_error(name));
        }
        let rows = match detector {
            None => (0..points.len()).collect(),
            Some(detector) => {
                times.time("keypoints", || find_keypoints(detector, cloud, &neighbors, &normals))?
            }
        };
        let (keypoints, oriented_by) = (detector.map(|_| rows.len()), Some(normals.oriented_by));
        if let Some(given) = given.filter(|_| self.replaces_fpfh()) {
            let rows: Vec<usize> =
                rows.into_iter().filter(|&row| normals.is_defined(row)).collect();
            let descriptors = given.select(&rows);
            let normals = Some(normals.vectors);
            return Ok(DescribedPoints { rows, descriptors, normals, keypoints, oriented_by });
        }
        let fpfh = Fpfh { histogram: self.histogram };
        let described_by = |normals: &Normals, neighbors: &Neighbors| {
            fpfh.describe(&PreparedCloud::new(points, &normals.vectors, neighbors)?.at(&rows)?)
        };
        let mut tables = vec![times.time("descriptors", || described_by(&normals, &neighbors))?];
        let mut defined: Vec<bool> = rows.iter().map(|&row| normals.is_defined(row)).collect();
        for &scale in &self.more_scales {
            let neighbors = times.time("neighbors", || find(scale.neighborhood))?;
            let own = match scale.normal_neighborhood {
                Some(_) => Some(self.estimate_normals(cloud, &neighbors, scale, times)?),
                None => None,
            };
            let normals = own.as_ref().unwrap_or(&normals);
            defined.iter_mut().zip(&rows).for_each(|(is, &row)| *is &= normals.is_defined(row));
            tables.push(times.time("descriptors", || described_by(normals, &neighbors))?);
        }
        let there = |table: &Descriptors, at| table.row(at).iter().any(|&bin| bin != 0.0);
        let defined = |&at: &usize| defined[at] && tables.iter().all(|table| there(table, at));
        let described: Vec<usize> = (0..rows.len()).filter(defined).collect();
        Ok(DescribedPoints {
            descriptors: Descriptors::concatenate(&tables)?.select(&described),
            rows: described.iter().map(|&at| rows[at]).collect(),
            normals: Some(normals.vectors),
            keypoints,
            oriented_by,
        })
    }

    /// Returns the first scale at which points are described.
    fn first_scale(&self) -> DescriptorScale {
        DescriptorScale {
            neighborhood: self.neighborhood,
            normal_neighborhood: self.normal_neighborhood,
        }
    }

    /// Estimates the normals of a scale, whose descriptors have the neighbourhoods `neighbors`: one
    /// search is enough if both neighbourhoods are equal, and stored normals need none.
    fn estimate_normals(
        &self,
        cloud: &PointCloud,
        neighbors: &Neighbors,
        scale: DescriptorScale,
        times: &mut Timings,
    ) -> Result<Normals> {
        let stored = self.orientation == Orientation::Stored;
        let own = scale
            .normal_neighborhood
            .filter(|&normal| normal != scale.neighborhood && !stored)
            .map(|normal| times.time("neighbors", || Neighbors::find(cloud.points(), normal)))
            .transpose()?;
        let around = own.as_ref().unwrap_or(neighbors);
        times.time("normals", || normals::estimate(cloud, around, self.orientation))
    }

    /// Returns the error for a cloud without a defined normal.
    fn no_normals_error(&self, name: &str) -> Error {
        match self.normal_neighborhood.unwrap_or(self.neighborhood) {
            Neighborhood::Radius(radius) | Neighborhood::Hybrid { radius, .. } => {
                let rule = format!("holds no plane around any point of {name}: use a larger one");
                Error::config("radius", radius, rule)
            }
            Neighborhood::Nearest(_) => Error::Degenerate { rank: 0, singular_values: [0.0; 3] },
        }
    }

    /// Describes every point of `cloud` by `descriptor`, from the normals and neighbourhoods of
    /// these settings, and attaches the rows ([`PointCloud::with_descriptors`]).
    ///
    /// # Errors
    /// Those of the descriptor, of [`normals::estimate`] and of
    /// [`PointCloud::with_descriptors`], which refuses a row of zeros: leave that point out of the
    /// cloud ([`PointCloud::select`]).
    pub fn attach(&self, cloud: &PointCloud, descriptor: &dyn Descriptor) -> Result<PointCloud> {
        self.validate()?;
        let times = &mut Timings::default();
        let neighbors = Neighbors::find(cloud.points(), self.neighborhood)?;
        let normals = self.estimate_normals(cloud, &neighbors, self.first_scale(), times)?;
        let prepared = PreparedCloud::new(cloud.points(), &normals.vectors, &neighbors)?;
        cloud.clone().with_descriptors(descriptor.describe(&prepared)?)
    }
}

/// Points with descriptors.
pub(super) struct DescribedPoints {
    /// Their numbers in the cloud.
    pub(super) rows: Vec<usize>,
    pub(super) descriptors: Descriptors,
    /// Unit normals of all points of the cloud; `None` if none were needed.
    pub(super) normals: Option<Vec<[f32; 3]>>,
    /// Number of keypoints, if a detector found them.
    pub(super) keypoints: Option<usize>,
    /// `None` if no normals were needed.
    pub(super) oriented_by: Option<OrientedBy>,
}

impl DescribedPoints {
    /// All points, with the rows that the cloud carries.
    pub(super) fn given(given: &Descriptors) -> Self {
        DescribedPoints {
            rows: (0..given.len()).collect(),
            descriptors: given.clone(),
            normals: None,
            keypoints: None,
            oriented_by: None,
        }
    }
}

/// Finds the keypoints of a cloud by the curvature of its surface.
fn find_keypoints(
    detector: &Keypoints,
    cloud: &PointCloud,
    neighbors: &Neighbors,
    normals: &Normals,
) -> Result<Vec<usize>> {
    // Stored normals come without curvature.
    let estimated = match normals.curvature.is_empty() {
        true => Some(normals::estimate(cloud, neighbors, Orientation::Viewpoint)?),
        false => None,
    };
    detector.detect(cloud.points(), &estimated.as_ref().unwrap_or(normals).curvature)
}
