//! A cloud with its descriptors: computed once, used for any number of pairs.

mod describe;

use serde::{Deserialize, Serialize};

use std::sync::Arc;

use self::describe::DescribedPoints;
use super::cache::{Cached, HeapSize};
use super::channels::{
    Channel, DescriptorsWithChannels, channel_values, concatenate_scaled_channels,
};
use super::given_descriptors::GivenDescriptors;
use super::registration::{CloudCounts, Timings};
use crate::cloud::{Descriptors, PointCloud};
use crate::descriptor::HistogramScale;
use crate::error::{Error, Result};
use crate::keypoint::Keypoints;
use crate::moments::{FeatureView, FullConnection};
use crate::normals::{Orientation, OrientedBy};
use crate::search::Neighborhood;

/// Settings of the descriptors of a cloud: normals, then FPFH.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FeatureConfig {
    /// Neighbourhood of descriptors. Default the paper's 150 nearest points (section IV-A). Fewer
    /// make descriptors more local: better under partial overlap, worse under noise. A radius suits
    /// clouds of known unit and uneven density.
    pub neighborhood: Neighborhood,
    /// More scales, whose descriptors are concatenated ([`Descriptors::concatenate`]), so that
    /// similar points are similar at every scale. Default none, as in the paper.
    pub more_scales: Vec<DescriptorScale>,
    /// Neighbourhood of normals; default that of the descriptors, as in the paper. A smaller
    /// neighbourhood keeps edges.
    pub normal_neighborhood: Option<Neighborhood>,
    /// Orientation of normals. Default towards the viewpoint; [`Orientation::Outward`] for whole
    /// objects that were seen from all sides.
    pub orientation: Orientation,
    /// Scale of FPFH: PCL's (default, the paper's) or Open3D's.
    pub histogram: HistogramScale,
    /// Channels of the clouds ([`PointCloud::channels`]) by which points are compared too, such as
    /// intensity and colours; default none. Channels resolve ambiguous shapes.
    pub channels: Vec<Channel>,
    /// Use of the descriptors that both clouds carry, such as learned ones
    /// ([`PointCloud::with_descriptors`]); default none: they are not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub given_descriptors: Option<GivenDescriptors>,
}

/// An additional scale at which points are described.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DescriptorScale {
    /// Neighbourhood of its descriptors.
    pub neighborhood: Neighborhood,
    /// Neighbourhood of its normals; default: the normals of the first scale.
    #[serde(default)]
    pub normal_neighborhood: Option<Neighborhood>,
}

impl Default for FeatureConfig {
    fn default() -> Self {
        FeatureConfig {
            neighborhood: Neighborhood::Nearest(150),
            more_scales: Vec::new(),
            normal_neighborhood: None,
            orientation: Orientation::default(),
            histogram: HistogramScale::default(),
            channels: Vec::new(),
            given_descriptors: None,
        }
    }
}

/// The points of a cloud that have a descriptor, and their descriptors.
#[derive(Debug, Clone)]
pub struct FeatureCloud {
    points: Vec<[f32; 3]>,
    origin: [f64; 3],
    /// Unit normals of the points, those of the first scale; `None` if no normals were needed.
    normals: Option<Vec<[f32; 3]>>,
    pub(super) descriptors: Descriptors,
    /// Weights of the points relative to the mean over the cloud; `None` if the cloud has no
    /// weights.
    weights: Option<Vec<f32>>,
    /// Values of [`FeatureConfig::channels`] at the points, until they are concatenated.
    pub(super) channels: Vec<Vec<f32>>,
    /// Descriptors that the cloud carries at the points, to stand beside, until they are
    /// concatenated.
    beside: Option<Descriptors>,
    counts: CloudCounts,
}

impl FeatureConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Those of [`Neighborhood::validate`].
    pub fn validate(&self) -> Result<()> {
        let of = |name: &'static str, neighborhood: Option<Neighborhood>| {
            let checked = neighborhood.map_or(Ok(()), |neighborhood| neighborhood.validate());
            checked.map_err(|error| match error {
                Error::Config { value, rule, .. } => Error::Config { field: name, value, rule },
                other => other,
            })
        };
        self.channels.iter().try_for_each(Channel::validate)?;
        self.neighborhood.validate()?;
        of("normal_neighbors", self.normal_neighborhood)?;
        self.more_scales.iter().try_for_each(|scale| {
            of("more_neighbors", Some(scale.neighborhood))?;
            of("more_neighbors", scale.normal_neighborhood)
        })
    }

    /// Computes the descriptors of `cloud`; `name` is its name in errors. Adds stage times to
    /// `times`.
    ///
    /// # Errors
    /// [`Error::TooFewPoints`] for fewer than three points, [`Error::Degenerate`] when no point has
    /// a defined normal (all on a line or at one position), [`Error::Config`] when the cloud lacks
    /// one of [`channels`](Self::channels) or carries no descriptors for
    /// [`given_descriptors`](Self::given_descriptors), and those of
    /// [`normals::estimate`](crate::normals::estimate).
    pub fn extract(
        &self,
        cloud: &PointCloud,
        name: &str,
        times: &mut Timings,
    ) -> Result<FeatureCloud> {
        self.extract_at_keypoints(cloud, name, None, times)
    }

    /// Computes the descriptors at the points that `detector` finds, each from all points around
    /// it.
    ///
    /// # Errors
    /// Those of [`extract`](Self::extract) and [`Keypoints::detect`]; [`Error::TooFewPoints`] for
    /// fewer than three keypoints with a descriptor.
    pub fn extract_at_keypoints(
        &self,
        cloud: &PointCloud,
        name: &str,
        detector: Option<&Keypoints>,
        times: &mut Timings,
    ) -> Result<FeatureCloud> {
        self.extract_points(cloud, name, detector, false, times)
    }

    /// Computes descriptors as [`extract`](Self::extract), at points with a defined normal, even if
    /// the descriptors that the cloud carries need none.
    pub(super) fn extract_with_normals(
        &self,
        cloud: &PointCloud,
        name: &str,
        times: &mut Timings,
    ) -> Result<FeatureCloud> {
        self.extract_points(cloud, name, None, true, times)
    }

    fn extract_points(
        &self,
        cloud: &PointCloud,
        name: &str,
        detector: Option<&Keypoints>,
        needs_normals: bool,
        times: &mut Timings,
    ) -> Result<FeatureCloud> {
        self.validate()?;
        let points = cloud.points();
        if points.len() < 3 {
            let found = points.len();
            return Err(Error::TooFewPoints { what: name.into(), found, needed: 3 });
        }
        let channels = channel_values(&self.channels, cloud, name)?;
        let given = self.given_descriptors.map(|given| given.rows(cloud, name)).transpose()?;
        let described = match (&given, self.replaces_fpfh() && !needs_normals, detector) {
            (Some(given), true, None) => DescribedPoints::given(given),
            _ => self.describe(cloud, name, detector, given.as_deref(), times)?,
        };
        let DescribedPoints { rows, descriptors, normals, keypoints, oriented_by } = described;
        if let Some(detector) = detector.filter(|_| rows.len() < 3) {
            let what = format!(
                "{name}, by the keypoint detector {} (lower its thresholds, choose another, or \
                 use cf)",
                detector.name()
            );
            return Err(Error::TooFewPoints { what, found: rows.len(), needed: 3 });
        }
        let neighbors = match self.neighborhood {
            Neighborhood::Nearest(k) => Some(k.min(points.len())),
            Neighborhood::Radius(_) | Neighborhood::Hybrid { .. } => None,
        };
        let at_points = |values: &[f32]| rows.iter().map(|&row| values[row]).collect();
        Ok(FeatureCloud {
            weights: cloud.relative_weights().map(|weights| at_points(&weights)),
            channels: channels.into_iter().map(at_points).collect(),
            beside: given.filter(|_| !self.replaces_fpfh()).map(|given| given.select(&rows)),
            points: rows.iter().map(|&row| points[row]).collect(),
            normals: normals.map(|normals| rows.iter().map(|&row| normals[row]).collect()),
            origin: cloud.origin(),
            descriptors,
            counts: CloudCounts {
                dropped: cloud.dropped(),
                no_returns: cloud.no_returns(),
                used: points.len(),
                keypoints,
                described: rows.len(),
                neighbors: neighbors.filter(|_| oriented_by.is_some()),
                oriented_by,
            },
        })
    }

    /// Whether the descriptors that the clouds carry take the place of FPFH.
    pub(super) fn replaces_fpfh(&self) -> bool {
        self.given_descriptors.is_some_and(|given| !given.is_beside())
    }
}

/// Key of a described cloud.
#[derive(PartialEq)]
struct FeatureKey(FeatureConfig, Option<Keypoints>);

impl HeapSize for FeatureCloud {
    fn bytes(&self) -> usize {
        let single = self.channels.len() + usize::from(self.weights.is_some());
        let beside = self.beside.as_ref().map_or(0, Descriptors::dim);
        let own = if self.normals.is_some() { 6 } else { 3 };
        self.points.len() * 4 * (own + self.descriptors.dim() + beside + single)
    }
}

impl FeatureConfig {
    /// Computes the features of both clouds of a pair, with their channels appended.
    ///
    /// # Errors
    /// Those of [`extract_at_keypoints`](Self::extract_at_keypoints) and
    /// [`concatenate_channels`](Self::concatenate_channels).
    pub(super) fn extract_pair(
        &self,
        [source, target]: [Cached<'_>; 2],
        detector: Option<&Keypoints>,
        times: &mut Timings,
    ) -> Result<[Arc<FeatureCloud>; 2]> {
        if let Some(given) = self.given_descriptors {
            given.check_pair(source.cloud, target.cloud)?;
        }
        let mut prepare = |side: Cached<'_>, name| {
            side.get_or_compute(FeatureKey(self.clone(), detector.copied()), || {
                self.extract_at_keypoints(side.cloud, name, detector, times)
            })
        };
        let sides = [prepare(source, "the source")?, prepare(target, "the target")?];
        self.with_channels(sides)
    }

    /// Appends the channels of both clouds of a pair to their descriptors, and the descriptors that
    /// they carry, if those stand beside.
    ///
    /// # Errors
    /// Those of [`concatenate_channels`](Self::concatenate_channels).
    pub(super) fn with_channels(
        &self,
        sides: [Arc<FeatureCloud>; 2],
    ) -> Result<[Arc<FeatureCloud>; 2]> {
        if self.channels.is_empty() && sides[0].beside.is_none() {
            return Ok(sides);
        }
        // The scale of a channel depends on both clouds: what is cached is unchanged.
        Ok(self.concatenate_channels(sides.map(|side| FeatureCloud::clone(&side)))?.map(Arc::new))
    }
}

impl FeatureCloud {
    /// Returns one side of a full connection.
    pub fn view(&self) -> FeatureView<'_> {
        FeatureView { points: &self.points, origin: self.origin, descriptors: &self.descriptors }
    }

    /// Returns the weights of the points relative to the mean over the whole cloud; `None` if the
    /// cloud has no weights.
    pub fn weights(&self) -> Option<&[f32]> {
        self.weights.as_deref()
    }

    /// Returns the full connection of two clouds, with the weights of their points.
    ///
    /// # Errors
    /// Those of [`FullConnection::new`].
    pub fn connection(&self, target: &FeatureCloud) -> Result<FullConnection> {
        FullConnection::new(self.view(), target.view())?
            .with_point_weights(self.weights(), target.weights())
    }

    /// Returns the unit normals of the points, those of the first scale; `None` if the descriptors
    /// that the cloud carries replace FPFH, and no normals were estimated.
    pub fn normals(&self) -> Option<&[[f32; 3]]> {
        self.normals.as_deref()
    }

    /// Replaces the counts up to the points that were used by those of `whole`, of which this is
    /// the downsampled cloud, and the source of the orientation, if given.
    pub(super) fn with_used_points(
        mut self,
        whole: &PointCloud,
        oriented_by: Option<OrientedBy>,
    ) -> Self {
        self.counts.oriented_by = oriented_by.or(self.counts.oriented_by);
        self.counts.used = whole.len();
        self.counts.dropped = whole.dropped();
        self.counts.no_returns = whole.no_returns();
        self
    }

    /// Returns how many of the cloud's points each stage kept.
    pub fn counts(&self) -> CloudCounts {
        self.counts
    }
}

impl FeatureConfig {
    /// Puts the channels of both clouds beside their descriptors, and the descriptors that the
    /// clouds carry where those stand beside FPFH; without either nothing changes.
    ///
    /// With S the root mean square distance of all descriptors of both clouds from their common
    /// mean, at least the root of the histogram's own β
    /// ([`HistogramScale::default_beta`](crate::descriptor::HistogramScale::default_beta)), lest
    /// shapes without features silence the channels: each channel is divided by its standard
    /// deviation over both clouds and multiplied by its share times S. With a share of 1 two
    /// points differ in the mean by the channel as much as by FPFH, whatever its unit;
    /// d² = d²_FPFH + Σ (share S Δ/σ)². A channel that is the same everywhere says nothing.
    /// Descriptors that the clouds carry are scaled likewise, with a share of 1; where they replace
    /// FPFH, S is theirs, without a minimum.
    ///
    /// # Errors
    /// [`Error::Shape`] for sides that were not described by these settings, and those of
    /// [`Descriptors::new`].
    pub fn concatenate_channels(&self, mut sides: [FeatureCloud; 2]) -> Result<[FeatureCloud; 2]> {
        if self.channels.is_empty() && sides.iter().all(|side| side.beside.is_none()) {
            return Ok(sides);
        }
        for side in &sides {
            let (expected, found) = (self.channels.len(), side.channels.len());
            if expected != found {
                let what = "channels of a described cloud".into();
                return Err(Error::Shape { what, expected, found });
            }
        }
        let compared = sides.each_ref().map(|side| DescriptorsWithChannels {
            descriptors: &side.descriptors,
            beside: side.beside.as_ref(),
            channels: &side.channels,
        });
        let min_spread = match self.replaces_fpfh() {
            true => 0.0,
            false => self.histogram.default_beta().sqrt(),
        };
        let joined = concatenate_scaled_channels(&self.channels, min_spread, compared)?;
        for (side, descriptors) in sides.iter_mut().zip(joined) {
            side.descriptors = descriptors;
            side.channels.clear();
            side.beside = None;
        }
        Ok(sides)
    }
}
