//! Decomposition of a cloud into plain fields, for storage elsewhere.

use std::sync::Arc;

use super::PointCloud;
use super::attributes::{check_row_count, check_weights};
use crate::cloud::{Channels, Descriptors};
use crate::error::{Error, Result};
use crate::math::Vec3;

/// The fields of a [`PointCloud`]; each field is the result of the method of its name.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "said by the methods")]
pub struct Parts {
    pub points: Vec<[f32; 3]>,
    pub origin: Vec3,
    pub frame_origin: Vec3,
    pub normals: Option<Vec<[f32; 3]>>,
    pub weights: Option<Vec<f32>>,
    pub channels: Channels,
    pub descriptors: Option<Arc<Descriptors>>,
    pub viewpoint: Option<Vec3>,
    pub dropped: usize,
    pub no_returns: usize,
}

impl PointCloud {
    /// Builds the cloud from the result of [`parts`](Self::parts), bit for bit.
    ///
    /// # Errors
    /// [`Error::NonFinite`] for a non-finite value, [`Error::Shape`] when there is not one normal,
    /// weight, channel value or descriptor a point, [`Error::Config`] for a weight below 0.
    pub fn from_parts(parts: Parts) -> Result<Self> {
        parts.check()?;
        let Parts {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            descriptors,
            viewpoint,
            dropped,
            no_returns,
        } = parts;
        Ok(Self {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            descriptors,
            viewpoint,
            dropped,
            no_returns,
        })
    }

    /// Returns all fields of the cloud, for storage elsewhere.
    pub fn parts(&self) -> Parts {
        let Self {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            descriptors,
            viewpoint,
            dropped,
            no_returns,
        } = self.clone();
        Parts {
            points,
            origin,
            frame_origin,
            normals,
            weights,
            channels,
            descriptors,
            viewpoint,
            dropped,
            no_returns,
        }
    }
}

impl Parts {
    /// Refuses fields that no cloud can have.
    fn check(&self) -> Result<()> {
        let vectors = self.points.iter().chain(self.normals.iter().flatten());
        if let Some(index) = vectors.into_iter().position(|v| v.iter().any(|x| !x.is_finite())) {
            return Err(Error::NonFinite { what: "the parts of a cloud".into(), index });
        }
        let places = [Some(self.origin), Some(self.frame_origin), self.viewpoint];
        if places.iter().flatten().flatten().any(|x| !x.is_finite()) {
            return Err(Error::NonFinite { what: "the places of a cloud".into(), index: 0 });
        }
        self.channels.check(self.points.len())?;
        let rows = self.descriptors.as_ref();
        rows.map_or(Ok(()), |rows| rows.check_count(self.points.len()))?;
        check_row_count("normals", self.normals.as_ref().map(Vec::len), self.points.len())?;
        let Some(weights) = &self.weights else { return Ok(()) };
        check_row_count("weights", Some(weights.len()), self.points.len())?;
        check_weights(weights, "weights of the points of a cloud")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_make_the_same_cloud() {
        let points = [[5e5, 5.6e6, 0.1], [5e5 + 0.3, 5.6e6, 0.2], [f64::NAN; 3]];
        let cloud = PointCloud::with_normals(&points, &[[0.0, 0.3, 0.4]; 3]).unwrap();
        let cloud = cloud.with_viewpoint([5e5, 5.6e6, 9.0]).unwrap();
        assert_eq!(PointCloud::from_parts(cloud.parts()).unwrap(), cloud);
        let mut short = cloud.parts();
        short.normals.as_mut().unwrap().pop();
        assert!(matches!(PointCloud::from_parts(short), Err(Error::Shape { .. })));
        let mut nan = cloud.parts();
        nan.points[1][2] = f32::NAN;
        assert!(matches!(PointCloud::from_parts(nan), Err(Error::NonFinite { index: 1, .. })));
        let mut nowhere = cloud.parts();
        nowhere.viewpoint = Some([f64::INFINITY; 3]);
        assert!(PointCloud::from_parts(nowhere).is_err());
    }
}
