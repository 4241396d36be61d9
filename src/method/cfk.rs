//! CFK: the full connection of keypoints.

use serde::{Deserialize, Serialize};

use super::{Cached, Cf, MethodRecord, Register, Registration};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::keypoint::Keypoints;
use crate::moments::{FullConnection, Moments};
use crate::par;

/// The paper's variant on keypoints (section III): as [`Cf`], but only the keypoints are described
/// and connected, each from all points around it. Cost falls from N² to n² pairs.
///
/// By default a seventh to a fifth of the points; on the paper's protocols the median error is then
/// up to an eighth above [`Cf`]'s ([`Sift`] has the figures, and those of fewer keypoints). The
/// result counts the keypoints of either cloud. Fewer than three are an error, fewer than
/// [`MIN_KEYPOINTS`](crate::verify::MIN_KEYPOINTS) a warning.
///
/// PCL describes the mean of a voxel where [`Sift`] finds an extremum; this crate describes the
/// cloud's point nearest to that mean.
///
/// [`Sift`]: crate::keypoint::Sift
///
/// ```
/// use cfreg::method::{Cfk, Register};
/// # use cfreg::cloud::shape::boulder;
/// # let (source, target) = (boulder().sample(2000, 1)?, boulder().sample(2000, 2)?);
/// let registration = Cfk::default().register(&source, &target)?;
/// println!("{:?} keypoints", registration.points.source.keypoints);
/// # Ok::<(), cfreg::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Cfk {
    /// The detector; default SIFT on the curvature, as in the paper.
    pub keypoints: Keypoints,
    /// All other settings, as in [`Cf`].
    #[serde(flatten)]
    pub cf: Cf,
}

impl Cfk {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Those of [`Cf::validate`] and [`Keypoints::validate`].
    pub fn validate(&self) -> Result<()> {
        self.keypoints.validate()?;
        self.cf.validate()
    }

    /// Registers with custom weights, see [`Cf::register_with`].
    ///
    /// # Errors
    /// As [`Register::register`], and those of `weigh`.
    pub fn register_with(
        &self,
        source: &PointCloud,
        target: &PointCloud,
        weigh: impl FnOnce(&FullConnection) -> Result<Moments> + Send,
    ) -> Result<Registration> {
        let named = Cfk { cf: self.cf.with_custom_weights(), ..self.clone() };
        let ends = [source.into(), target.into()];
        self.run(ends, named, |connection| Ok((weigh(connection)?, None)))
    }

    fn run(
        &self,
        ends: [Cached<'_>; 2],
        named: Cfk,
        weigh: impl FnOnce(&FullConnection) -> Result<(Moments, Option<f64>)> + Send,
    ) -> Result<Registration> {
        let cf = &self.cf;
        par::with_threads(cf.threads, || {
            self.validate()?;
            cf.run(ends, Some(&self.keypoints), MethodRecord::new("cfk", &named), weigh)
        })?
    }
}

impl Register for Cfk {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        self.register_cached(source.into(), target.into())
    }

    fn register_cached(&self, source: Cached<'_>, target: Cached<'_>) -> Result<Registration> {
        let cf = &self.cf;
        let named = Cfk { cf: cf.resolved(), ..self.clone() };
        self.run([source, target], named, |connection| cf.weighted_moments(connection))
    }
}
