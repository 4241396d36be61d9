//! Success criteria of a pose.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::cloud::{PointCloud, Transform};
use crate::error::{Error, Result};
use crate::verify::{PoseError, pose_error};

/// Largest errors of a correct pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SuccessCriterion {
    /// 15 degrees and 0.3 m, as on 3DMatch.
    Indoor,
    /// 5 degrees and 0.6 m, as on KITTI.
    Outdoor,
    /// 5 degrees and 2 m, as on KITTI in the older papers and for loop closures.
    OutdoorCoarse,
    /// 10 degrees and a twentieth of the source's diagonal, for objects of any size.
    Relative,
}

impl SuccessCriterion {
    /// All criteria.
    pub const ALL: [SuccessCriterion; 4] = [
        SuccessCriterion::Indoor,
        SuccessCriterion::Outdoor,
        SuccessCriterion::OutdoorCoarse,
        SuccessCriterion::Relative,
    ];

    /// Returns the criterion for a cloud of this size: objects below a metre, rooms below 25, else
    /// streets.
    pub fn for_size(metres: f64) -> SuccessCriterion {
        if metres < 1.0 {
            SuccessCriterion::Relative
        } else if metres < 25.0 {
            SuccessCriterion::Indoor
        } else {
            SuccessCriterion::Outdoor
        }
    }

    /// Computes the error of poses of `source`, as in published lists of pairs: the translation
    /// error is ‖t − t_gt‖ in the clouds' own frames. For [`SuccessCriterion::Relative`] it is the
    /// distance of the source's centroids, since the origin of an object's frame is arbitrary.
    pub fn error(self, found: &Transform, truth: &Transform, source: &PointCloud) -> PoseError {
        let about = if self == SuccessCriterion::Relative { source.centroid() } else { [0.0; 3] };
        pose_error(found, truth, about)
    }

    /// Returns whether `error` is small enough; `unit` is the clouds' unit in metres.
    pub fn is_met(self, error: PoseError, source: &PointCloud, unit: f64) -> bool {
        let (degrees, length) = match self {
            SuccessCriterion::Indoor => (15.0, 0.3 / unit),
            SuccessCriterion::Outdoor => (5.0, 0.6 / unit),
            SuccessCriterion::OutdoorCoarse => (5.0, 2.0 / unit),
            SuccessCriterion::Relative => (10.0, 0.05 * source.diagonal()),
        };
        error.rotation_deg <= degrees && error.translation <= length
    }

    fn name(self) -> &'static str {
        match self {
            SuccessCriterion::Indoor => "indoor",
            SuccessCriterion::Outdoor => "outdoor",
            SuccessCriterion::OutdoorCoarse => "outdoor-coarse",
            SuccessCriterion::Relative => "relative",
        }
    }
}

impl fmt::Display for SuccessCriterion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for SuccessCriterion {
    type Err = Error;
    fn from_str(text: &str) -> Result<Self> {
        SuccessCriterion::ALL.into_iter().find(|rule| rule.name() == text).ok_or_else(|| {
            let names = SuccessCriterion::ALL.map(SuccessCriterion::name).join(", ");
            Error::config("rule", text, format!("must be one of {names}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math;

    #[test]
    fn errors_count_in_metres_or_by_the_size_of_an_object() {
        let cloud = PointCloud::new(&[[10.0, 0.0, 0.0], [10.0, 3.0, 4.0]]).unwrap();
        let turn = Transform::from_rotation_vector([0.0, 0.0, 4f64.to_radians()]);
        let error = SuccessCriterion::Indoor.error(&turn, &Transform::IDENTITY, &cloud);
        assert!((error.rotation_deg - 4.0).abs() < 1e-9 && error.translation == 0.0);
        assert!(SuccessCriterion::Indoor.is_met(error, &cloud, 1.0));
        // About the centroid, ten from the origin: 0.7 are more than a twentieth of 5.
        let error = SuccessCriterion::Relative.error(&turn, &Transform::IDENTITY, &cloud);
        assert!(error.translation > 0.7 && !SuccessCriterion::Relative.is_met(error, &cloud, 1.0));
        let shift = Transform::rigid(math::IDENTITY, [0.0, 0.0, 50.0]);
        let error = SuccessCriterion::Outdoor.error(&shift, &Transform::IDENTITY, &cloud);
        assert!(
            SuccessCriterion::Outdoor.is_met(error, &cloud, 0.01)
                && !SuccessCriterion::Outdoor.is_met(error, &cloud, 1.0)
        );
        assert_eq!(SuccessCriterion::for_size(0.3), SuccessCriterion::Relative);
        assert_eq!(
            (SuccessCriterion::for_size(6.0), SuccessCriterion::for_size(150.0)),
            (SuccessCriterion::Indoor, SuccessCriterion::Outdoor)
        );
    }

    #[test]
    fn names_come_back() {
        for rule in SuccessCriterion::ALL {
            assert_eq!(rule.to_string().parse::<SuccessCriterion>().unwrap(), rule);
        }
        assert!(
            "loose".parse::<SuccessCriterion>().unwrap_err().to_string().contains("outdoor-coarse")
        );
    }
}
