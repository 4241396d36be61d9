//! The change by one interpretation that the paper leaves open: a setting, or how a trial is drawn.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::models;
use crate::protocol::{NormalViewpoint, Protocol, Trial};
use cfreg::cloud::PointCloud;
use cfreg::error::Result;
use cfreg::keypoint::{Keypoints, Sift};
use cfreg::method::{Icp, Method};

/// One change to a [`Cell`](super::cell::ExperimentCell).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variation {
    /// None: the contender as in the tables, for comparison.
    Plain,
    /// TEASER's noise bound in metres; `None`: from the cloud's resolution.
    NoiseBound(Option<f64>),
    /// β of CF and CFK.
    Beta(f64),
    /// CFK's detector.
    Keypoints(Sift),
    /// ICP without the fitness epsilon, which stops it early.
    AtRest,
    /// Where normals look.
    Viewpoint(NormalViewpoint),
    /// Radius of the ball of outliers, metres.
    Radius(f64),
    /// Viewing direction of the Armadillo, degrees; normals are oriented towards it, too.
    Side(u32),
    /// Number of decimals, in metres, that coordinates are rounded to.
    Decimals(u32),
    /// CPD's tolerance.
    Tolerance(f64),
}

impl Variation {
    /// Returns `method` with this setting.
    pub fn method(self, mut method: Method) -> Method {
        match (self, &mut method) {
            (Variation::NoiseBound(bound), Method::Teaser(teaser)) => teaser.noise_bound = bound,
            (Variation::Beta(beta), Method::Cf(cf)) => cf.beta = Some(beta.into()),
            (Variation::Beta(beta), Method::Cfk(cfk)) => cfk.cf.beta = Some(beta.into()),
            (Variation::Keypoints(sift), Method::Cfk(cfk)) => {
                cfk.keypoints = Keypoints::Sift(sift);
            }
            (Variation::Tolerance(tolerance), Method::Cpd(cpd)) => cpd.tolerance = tolerance,
            (Variation::AtRest, Method::Icp(icp)) => {
                let Icp { relative_error_tolerance, error_tolerance, .. } = icp;
                (*relative_error_tolerance, *error_tolerance) = (0.0, 0.0);
            }
            _ => {}
        }
        method
    }

    /// Returns `protocol` with this setting.
    pub fn protocol(self, protocol: Protocol) -> Protocol {
        match (self, protocol) {
            (Variation::Radius(radius), Protocol::Robustness { outliers, .. }) => {
                Protocol::Robustness { outliers, radius }
            }
            _ => protocol,
        }
    }

    /// Where normals look, `otherwise` unless this says so.
    pub fn viewpoint(self, otherwise: NormalViewpoint) -> NormalViewpoint {
        match self {
            Variation::Viewpoint(viewpoint) => viewpoint,
            Variation::Side(degrees) => NormalViewpoint::At(models::sensor(degrees)),
            _ => otherwise,
        }
    }

    /// Returns `trial` with this setting.
    ///
    /// # Errors
    /// The errors of [`PointCloud::new`].
    pub fn trial(self, mut trial: Trial) -> Result<Trial> {
        if let Variation::Decimals(decimals) = self {
            for cloud in [&mut trial.source, &mut trial.target] {
                *cloud = round_coordinates(cloud, decimals)?;
            }
        }
        Ok(trial)
    }
}

fn round_coordinates(cloud: &PointCloud, decimals: u32) -> Result<PointCloud> {
    let unit = 10f64.powi(decimals as i32);
    let points: Vec<_> = cloud.positions().map(|p| p.map(|x| (x * unit).round() / unit)).collect();
    let rounded = PointCloud::new(&points)?;
    match cloud.viewpoint() {
        Some(viewpoint) => rounded.with_viewpoint(viewpoint),
        None => Ok(rounded),
    }
}

/// Formats a word for the names of files.
impl fmt::Display for Variation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Variation::Plain => f.write_str("plain"),
            Variation::NoiseBound(None) => f.write_str("bound-by-resolution"),
            Variation::NoiseBound(Some(bound)) => write!(f, "bound-{bound}"),
            Variation::Beta(beta) => write!(f, "beta-{beta}"),
            Variation::Keypoints(sift) => {
                write!(f, "sift-{}-{}-{}", sift.min_scale, sift.octaves, sift.scales)
            }
            Variation::AtRest => f.write_str("at-rest"),
            Variation::Viewpoint(NormalViewpoint::Origin) => f.write_str("viewpoint-stays"),
            Variation::Viewpoint(NormalViewpoint::Along) => f.write_str("viewpoint-along"),
            Variation::Viewpoint(NormalViewpoint::Centroid) => f.write_str("viewpoint-centroid"),
            Variation::Viewpoint(NormalViewpoint::At(_)) => f.write_str("viewpoint-sensor"),
            Variation::Radius(radius) => write!(f, "radius-{radius}"),
            Variation::Side(degrees) => write!(f, "side-{degrees:03}"),
            Variation::Decimals(decimals) => write!(f, "decimals-{decimals}"),
            Variation::Tolerance(tolerance) => write!(f, "tolerance-{tolerance:e}"),
        }
    }
}
