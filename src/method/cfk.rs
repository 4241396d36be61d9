//! CFK: the full connection of keypoints.

use serde::{Deserialize, Serialize};

use super::{Cf, Method, Register, Registration};
use crate::cloud::PointCloud;
use crate::error::Result;
use crate::keypoint::Keypoints;
use crate::par;

/// The paper's variant on keypoints (section III): as [`Cf`], but only the keypoints are
/// described and connected, each from all points around it. Cost falls from N² to n² pairs.
///
/// Less accurate than [`Cf`]: two samples of one surface share few keypoints. A cloud with
/// fewer than [`MIN_KEYPOINTS`](crate::quality::MIN_KEYPOINTS) is doubted.
///
/// ```
/// use cfreg::method::{Cfk, Register};
/// # use cfreg::experiment::shape::boulder;
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
    /// Everything else, as in [`Cf`].
    #[serde(flatten)]
    pub connection: Cf,
}

impl Register for Cfk {
    fn register(&self, source: &PointCloud, target: &PointCloud) -> Result<Registration> {
        let cf = &self.connection;
        par::with_threads(cf.threads, || {
            self.keypoints.validate()?;
            let named = Cfk { connection: cf.resolved(), ..self.clone() };
            cf.run(source, target, Some(&self.keypoints), Method::Cfk(named))
        })?
    }
}
