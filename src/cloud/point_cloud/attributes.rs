//! Attributes of the points of a cloud beside their positions: normals, weights, channels,
//! descriptors.

use std::borrow::Cow;
use std::sync::Arc;

use super::PointCloud;
use crate::cloud::{Channels, Descriptors};
use crate::error::{Error, Result};
use crate::math::{self, Vec3};

/// Attributes of points beside their positions: one row for each input point, also for points that
/// will be dropped.
#[derive(Debug, Clone, Copy, Default)]
pub struct Attributes<'a> {
    /// Normals as in [`PointCloud::with_normals`].
    pub normals: Option<&'a [Vec3]>,
    /// Weights as in [`PointCloud::with_weights`].
    pub weights: Option<&'a [f64]>,
    /// Channels as in [`PointCloud::with_channels`].
    pub channels: Option<&'a Channels>,
    /// Descriptors as in [`PointCloud::with_descriptors`].
    pub descriptors: Option<&'a Descriptors>,
}

impl PointCloud {
    /// Creates a cloud with the attributes of its points, in the same order. A dropped point takes
    /// its normal, its weight, its channels and its descriptor along.
    ///
    /// # Errors
    /// [`Error::Shape`] when there is not one row a point, and the errors of [`new`](Self::new) and
    /// [`with_weights`](Self::with_weights).
    pub fn with_attributes(points: &[[f64; 3]], attributes: Attributes<'_>) -> Result<Self> {
        let Attributes { normals, weights, channels, descriptors } = attributes;
        check_row_count("normals", normals.map(<[Vec3]>::len), points.len())?;
        check_row_count("weights", weights.map(<[f64]>::len), points.len())?;
        channels.map_or(Ok(()), |channels| channels.check(points.len()))?;
        descriptors.map_or(Ok(()), |rows| rows.check_count(points.len()))?;
        let mut cloud = Self::new(points)?;
        let finite = |&i: &usize| points[i].iter().all(|x| x.is_finite());
        let kept: Vec<usize> = (0..points.len()).filter(finite).collect();
        cloud.normals =
            normals.map(|normals| kept.iter().map(|&i| normalize_normal(normals[i])).collect());
        if let Some(channels) = channels {
            cloud.channels = channels.map(|values| kept.iter().map(|&i| values[i]).collect());
        }
        cloud.descriptors = descriptors.map(|rows| rows.select(&kept).into());
        match weights {
            Some(weights) => cloud.with_weights(kept.iter().map(|&i| weights[i]).collect()),
            None => Ok(cloud),
        }
    }

    /// Adds the attributes that a reader found, one row for each remaining point, and the number of
    /// points that the reader dropped.
    ///
    /// # Errors
    /// The errors of [`with_channels`](Self::with_channels).
    pub(crate) fn with_read(
        self,
        normals: Option<Vec<[f32; 3]>>,
        channels: Channels,
        dropped: usize,
    ) -> Result<Self> {
        check_row_count("normals", normals.as_ref().map(Vec::len), self.len())?;
        PointCloud { normals, dropped, ..self }.with_channels(channels)
    }

    /// Sets the weight of each point: a weight of 2 is equivalent to having the point twice, 0 to
    /// not connecting it. Every method uses the weights as its description says; only their ratios
    /// within a cloud matter. There is one weight for each remaining point: dropped points have
    /// none ([`with_attributes`](Self::with_attributes) takes all).
    ///
    /// # Errors
    /// [`Error::Shape`] when there is not one weight a point, [`Error::NonFinite`] for a weight
    /// that is not finite in f32, [`Error::Config`] for a weight below 0, or when all are 0.
    ///
    /// ```
    /// let cloud = cfreg::PointCloud::new(&[[0.0; 3], [1.0, 0.0, 0.0]])?;
    /// assert_eq!(cloud.with_weights(vec![0.5, 2.0])?.weights(), Some(&[0.5, 2.0][..]));
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn with_weights(mut self, weights: Vec<f64>) -> Result<Self> {
        check_row_count("weights", Some(weights.len()), self.len())?;
        let weights: Vec<f32> = weights.into_iter().map(|weight| weight as f32).collect();
        check_weights(&weights, "weights of the points of a cloud")?;
        if !weights.is_empty() && weights.iter().all(|&weight| weight == 0.0) {
            return Err(Error::config("weights", 0, "one at least must be above 0"));
        }
        self.weights = Some(weights);
        Ok(self)
    }

    /// Replaces the channels of the cloud, one value for each remaining point.
    ///
    /// # Errors
    /// [`Error::Shape`] when a channel does not have one value a point.
    pub fn with_channels(self, channels: Channels) -> Result<Self> {
        channels.check(self.len())?;
        Ok(PointCloud { channels, ..self })
    }

    /// Joins this cloud and another of the same frame: the points of both, with normals, weights,
    /// channels, and descriptors of one width, where both have them. Colours of two depths are
    /// numbers. There is no viewpoint.
    ///
    /// # Errors
    /// [`Error::Extent`] when both together span too much for [`new`](Self::new).
    pub fn joined(&self, other: &PointCloud) -> Result<PointCloud> {
        fn both<T: Clone>(own: Option<&[T]>, other: Option<&[T]>) -> Option<Vec<T>> {
            own.zip(other).map(|(own, other)| [own, other].concat())
        }
        let points: Vec<Vec3> = self.positions().chain(other.positions()).collect();
        let normals = both(self.normals(), other.normals());
        let weights = both(self.weights(), other.weights());
        let mut channels = Channels::default();
        for (name, values) in self.channels.iter() {
            let Some(values) = both(Some(values), other.channels.get(name)) else { continue };
            let depths = [self, other].map(|cloud| cloud.channels.color_depth(name));
            channels = match depths {
                [Some(own), Some(other)] if own == other => {
                    channels.with_color(name, values, own)?
                }
                _ => channels.with(name, values)?,
            };
        }
        let dropped = self.dropped + other.dropped;
        let joined = Self::new(&points)?.with_read(normals, channels, dropped)?;
        let joined = match weights {
            Some(weights) => joined.with_weights(weights.into_iter().map(f64::from).collect())?,
            None => joined,
        };
        let rows = self.descriptors.as_deref().zip(other.descriptors.as_deref());
        let joined = match rows.filter(|(own, other)| own.dim() == other.dim()) {
            Some((own, other)) => {
                let values = [own.as_slice(), other.as_slice()].concat();
                joined.with_descriptors(Descriptors::new(own.dim(), values)?)?
            }
            None => joined,
        };
        Ok(joined.with_no_returns(self.no_returns + other.no_returns))
    }

    /// Attaches a descriptor to each remaining point, of any origin: learned features, say. Filters
    /// keep the rows of the points that they keep, and average rows where they average points.
    /// Methods compare points by them where their setting
    /// [`given_descriptors`](crate::method::FeatureConfig::given_descriptors) says so.
    ///
    /// # Errors
    /// [`Error::Shape`] when there is not one row a point, [`Error::Config`] for rows of more than
    /// 512 values, for a value beyond ±1e15, and for a row of zeros.
    ///
    /// ```
    /// use cfreg::{Descriptors, PointCloud};
    /// let cloud = PointCloud::new(&[[0.0; 3], [1.0, 0.0, 0.0]])?;
    /// let cloud = cloud.with_descriptors(Descriptors::new(2, vec![1.0, 0.0, 0.5, 2.0])?)?;
    /// assert_eq!(cloud.select(&[1]).descriptors().unwrap().row(0), [0.5, 2.0]);
    /// # Ok::<(), cfreg::Error>(())
    /// ```
    pub fn with_descriptors(self, descriptors: Descriptors) -> Result<Self> {
        descriptors.check_carried(self.len())?;
        Ok(PointCloud { descriptors: Some(descriptors.into()), ..self })
    }

    /// Returns the weights of the points, finite and 0 or more, if the cloud has any; else all
    /// points have the same weight.
    pub fn weights(&self) -> Option<&[f32]> {
        self.weights.as_deref()
    }

    /// Returns the weights divided by their mean, so that only their ratios matter; `None` without
    /// weights, and where all remaining weights are 0.
    pub(crate) fn relative_weights(&self) -> Option<Vec<f32>> {
        let weights = self.weights()?;
        let sum: f64 = weights.iter().map(|&weight| f64::from(weight)).sum();
        let share = weights.len() as f64 / sum;
        let relative = |&weight: &f32| (f64::from(weight) * share) as f32;
        Some(match sum > 0.0 {
            true => weights.iter().map(relative).collect(),
            false => weights.to_vec(),
        })
    }

    /// Returns the cloud without its points of weight 0.
    pub(crate) fn with_positive_weights(&self) -> Cow<'_, PointCloud> {
        match self.weights() {
            Some(weights) if weights.contains(&0.0) => {
                let above: Vec<usize> = (0..self.len()).filter(|&i| weights[i] > 0.0).collect();
                Cow::Owned(self.select(&above))
            }
            _ => Cow::Borrowed(self),
        }
    }

    /// Removes the weights.
    pub(crate) fn unweighted(&self) -> PointCloud {
        PointCloud { weights: None, ..self.clone() }
    }

    /// Returns the descriptors that the cloud carries, one row a point.
    pub fn descriptors(&self) -> Option<&Arc<Descriptors>> {
        self.descriptors.as_ref()
    }

    /// Returns the named scalars of the points; empty where there are none.
    pub fn channels(&self) -> &Channels {
        &self.channels
    }
}

/// Refuses another number of `what` than one a point, where there are any.
pub(super) fn check_row_count(what: &str, found: Option<usize>, points: usize) -> Result<()> {
    match found {
        Some(found) if found != points => {
            let what = format!("{what} for the points of a cloud");
            Err(Error::Shape { what, expected: points, found })
        }
        _ => Ok(()),
    }
}

/// Refuses invalid weights; `what` is the name that errors use for them.
pub(crate) fn check_weights(weights: &[f32], what: &str) -> Result<()> {
    if let Some(index) = weights.iter().position(|weight| !weight.is_finite()) {
        return Err(Error::NonFinite { what: what.into(), index });
    }
    match weights.iter().find(|&&weight| weight < 0.0) {
        Some(weight) => Err(Error::config("weights", weight, "must be 0 or more")),
        None => Ok(()),
    }
}

/// Scales `normal` to unit length in f32; zero when it has no direction.
pub(crate) fn normalize_normal(normal: Vec3) -> [f32; 3] {
    let unit = math::normalized(normal).map(|x| x as f32);
    if unit.iter().all(|x| x.is_finite()) { unit } else { [0.0; 3] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Transform;

    #[test]
    fn what_points_have_stays_with_them() {
        let points = [[0.0; 3], [f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        let channels = Channels::default().with("red", vec![0.1, 0.2, 0.3, 0.4]).unwrap();
        let weights = [1.0, -5.0, 0.0, 4.0];
        let has =
            Attributes { weights: Some(&weights), channels: Some(&channels), ..Default::default() };
        let cloud = PointCloud::with_attributes(&points, has).unwrap();
        assert_eq!(cloud.weights(), Some(&[1.0, 0.0, 4.0][..]));
        assert_eq!(cloud.channels().get("red"), Some(&[0.1, 0.3, 0.4][..]));
        let turned = cloud.transformed(&Transform::from_rotation_vector([1.0, 0.0, 2.0])).unwrap();
        let back = turned.select(&[2, 0]);
        assert_eq!(back.weights(), Some(&[4.0, 1.0][..]));
        assert_eq!(back.channels().get("red"), Some(&[0.4, 0.1][..]));
        assert_eq!(PointCloud::from_parts(cloud.parts()).unwrap(), cloud);
        assert_eq!(cloud.with_positive_weights().len(), 2);
        assert_eq!(back.relative_weights().unwrap(), [1.6, 0.4]);
    }

    #[test]
    fn joined_clouds_have_what_both_have() {
        let channels = Channels::default().with("glow", vec![1.0]).unwrap();
        let near = PointCloud::new(&[[1.0, 2.0, 3.0]]).unwrap().with_channels(channels).unwrap();
        let both = near.joined(&near).unwrap();
        assert_eq!((both.len(), both.channels().get("glow")), (2, Some(&[1.0, 1.0][..])));
        assert_eq!(both.position(1), [1.0, 2.0, 3.0]);
        let bare = PointCloud::new(&[[5e5, 0.0, 0.0]]).unwrap();
        let far = near.joined(&bare).unwrap();
        assert!(far.channels().is_empty() && far.position(1) == [5e5, 0.0, 0.0]);
    }

    #[test]
    fn what_is_no_weight_is_refused() {
        let cloud = PointCloud::new(&[[0.0; 3], [1.0, 0.0, 0.0]]).unwrap();
        let refused = |weights: [f64; 2]| cloud.clone().with_weights(weights.to_vec()).unwrap_err();
        assert!(matches!(refused([1.0, f64::NAN]), Error::NonFinite { index: 1, .. }));
        assert!(matches!(refused([1e39, 1.0]), Error::NonFinite { index: 0, .. }));
        assert_eq!(refused([1.0, -2.0]).to_string(), "weights = -2: must be 0 or more");
        assert!(matches!(refused([0.0, 0.0]), Error::Config { field: "weights", .. }));
        assert!(matches!(cloud.clone().with_weights(vec![1.0]), Err(Error::Shape { .. })));
        let mut parts = cloud.parts();
        parts.weights = Some(vec![1.0, -1.0]);
        assert!(PointCloud::from_parts(parts).is_err());
    }
}
