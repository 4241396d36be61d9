//! Experiment cells: a contender, a shape, a motion, and an interpretation of the paper.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::super::protocol::{NormalViewpoint, Protocol};
use super::variation::Variation;
use crate::Motion;
use cfreg::method::{Cf, CfSpectral, Cfk, Cpd, Dare, Icp, Method, Teaser};
use cfreg::weight::Normalization;

/// A method with the settings of section IV-A.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contender {
    /// [`Icp::paper`].
    Icp,
    /// CPD without scale.
    Cpd,
    /// DARE without colour and features.
    Dare,
    /// TEASER with noise bound 0.05, which the paper does not mention: the value of TEASER++'s
    /// example, whose other settings the paper names.
    Teaser,
    /// CF with k = 150, β = 100.
    Cf,
    /// CF at SIFT keypoints.
    Cfk,
    /// Not in the paper: CF with dual softmax, still one step.
    CfBoth,
    /// Not in the paper: [`Cf::multiscale`], the best of the study of weights, still one step.
    CfMultiscale,
    /// Not in the paper: [`CfSpectral`], second-order weights, still one step.
    CfSpectral,
}

impl Contender {
    /// The contenders of the paper, in the order of its tables, then ours.
    pub const ALL: [Contender; 9] = [
        Contender::Icp,
        Contender::Cpd,
        Contender::Dare,
        Contender::Teaser,
        Contender::Cf,
        Contender::Cfk,
        Contender::CfBoth,
        Contender::CfMultiscale,
        Contender::CfSpectral,
    ];

    /// Returns the method with its settings.
    pub fn method(self) -> Method {
        match self {
            Contender::Icp => Method::Icp(Icp::paper()),
            Contender::Cpd => Method::Cpd(Cpd::default()),
            Contender::Dare => Method::Dare(Dare::default()),
            Contender::Teaser => {
                Method::Teaser(Teaser { noise_bound: Some(0.05), ..Teaser::default() })
            }
            Contender::Cf => Method::Cf(Cf::default()),
            Contender::Cfk => Method::Cfk(Cfk::default()),
            Contender::CfBoth => {
                Method::Cf(Cf { normalization: Normalization::Both, ..Cf::default() })
            }
            Contender::CfMultiscale => Method::Cf(Cf::multiscale()),
            Contender::CfSpectral => Method::CfSpectral(CfSpectral::default()),
        }
    }
}

impl fmt::Display for Contender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Contender::Icp => "ICP",
            Contender::Cpd => "CPD",
            Contender::Dare => "DARE",
            Contender::Teaser => "TEASER",
            Contender::Cf => "CF",
            Contender::Cfk => "CFK",
            Contender::CfBoth => "CF both",
            Contender::CfMultiscale => "CF multiscale",
            Contender::CfSpectral => "CF spectral",
        })
    }
}

/// A model of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// bun000.
    Bunny,
    /// dragonStandRight_0.
    Dragon,
    /// ArmadilloStand_180, which other files may replace.
    Armadillo,
}

impl Shape {
    /// All shapes, in the order of Table II.
    pub const ALL: [Shape; 3] = [Shape::Bunny, Shape::Dragon, Shape::Armadillo];
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Shape::Bunny => "bunny",
            Shape::Dragon => "dragon",
            Shape::Armadillo => "Armadillo",
        })
    }
}

/// A test of section IV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Test {
    /// Section IV-B, the figure of average shift over noise.
    Sensitivity,
    /// Section IV-C, Table I.
    Robustness,
    /// Section IV-D, Table II.
    Accuracy,
}

/// Interpretation of the paper where its text leaves a choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Interpretation {
    /// Literal: the scan's surface sampled by area, normals towards the origin of the frame,
    /// outliers from a ball of radius 0.2.
    Written,
    /// As its figures suggest: a ball of diameter 0.2, and a frame whose origin moves along with
    /// the target (its "centered" clouds have their origin at the centroid).
    Fitting,
    /// As `Fitting`, the scan's own points instead of its surface.
    Points,
}

impl Interpretation {
    /// All interpretations, the literal one first.
    pub const ALL: [Interpretation; 3] =
        [Interpretation::Written, Interpretation::Fitting, Interpretation::Points];

    /// Where normals look.
    pub fn viewpoint(self) -> NormalViewpoint {
        match self {
            Interpretation::Written => NormalViewpoint::Origin,
            Interpretation::Fitting | Interpretation::Points => NormalViewpoint::Along,
        }
    }

    /// Returns the radius of the ball of outliers, metres.
    pub fn radius(self) -> f64 {
        match self {
            Interpretation::Written => 0.2,
            Interpretation::Fitting | Interpretation::Points => 0.1,
        }
    }
}

impl fmt::Display for Interpretation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Interpretation::Written => "written",
            Interpretation::Fitting => "fitting",
            Interpretation::Points => "points",
        })
    }
}

/// A set of trials of one contender.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ExperimentCell {
    /// The test.
    pub test: Test,
    /// Its interpretation.
    pub reading: Interpretation,
    /// The model.
    pub shape: Shape,
    /// The kind of motion.
    pub motion: Motion,
    /// The contender.
    pub contender: Contender,
    /// Standard deviation of the noise in tenths of a millimetre; 0 except for sensitivity.
    pub noise: u32,
    /// Number of trials.
    pub trials: usize,
    /// The variation, for the table of interpretations; `None` in the paper's own tables.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variation: Option<Variation>,
}

impl ExperimentCell {
    /// The contender's method, as varied.
    pub fn method(&self) -> Method {
        let method = self.contender.method();
        match self.variation {
            Some(variation) => variation.method(method),
            None => method,
        }
    }

    /// Where normals look.
    pub fn viewpoint(&self) -> NormalViewpoint {
        let viewpoint = self.reading.viewpoint();
        self.variation.map_or(viewpoint, |variation| variation.viewpoint(viewpoint))
    }

    /// Returns which model is sampled: the shape, the interpretation, and the viewing direction in
    /// degrees if it is varied.
    pub(super) fn model(&self) -> (Shape, Interpretation, Option<u32>) {
        let side = match self.variation {
            Some(Variation::Side(degrees)) => Some(degrees),
            _ => None,
        };
        (self.shape, self.reading, side)
    }

    /// Returns the protocol of its trials.
    pub fn protocol(&self) -> Protocol {
        let protocol = match self.test {
            Test::Sensitivity => Protocol::Sensitivity { sigma: 1e-4 * f64::from(self.noise) },
            Test::Robustness => {
                Protocol::Robustness { outliers: 100, radius: self.reading.radius() }
            }
            Test::Accuracy => Protocol::Accuracy,
        };
        self.variation.map_or(protocol, |variation| variation.protocol(protocol))
    }

    /// Returns a name for files.
    pub fn name(&self) -> String {
        let mut words =
            vec![self.trials_name(), self.contender.to_string().replace(' ', "-").to_lowercase()];
        words.extend(self.variation.map(|variation| variation.to_string()));
        words.join("_")
    }

    /// Returns a name for the pairs, which all contenders share.
    pub fn trials_name(&self) -> String {
        let test = match self.test {
            Test::Sensitivity => format!("sensitivity-{:03}", self.noise),
            Test::Robustness => "robustness".into(),
            Test::Accuracy => "accuracy".into(),
        };
        let words =
            [test, self.reading.to_string(), self.shape.to_string(), self.motion.to_string()];
        words.join("_").to_lowercase()
    }
}

/// All cells of the paper's tables and curves: `trials` in the tables and `noisy` a level of
/// noise, of which there are `levels` up to 0.02.
pub fn cells(trials: usize, noisy: usize, levels: u32) -> Vec<ExperimentCell> {
    let mut cells = Vec::new();
    let mut add = |test, reading, shape, noise, trials| {
        for motion in Motion::ALL {
            for contender in Contender::ALL {
                let variation = None;
                cells.push(ExperimentCell {
                    test,
                    reading,
                    shape,
                    motion,
                    contender,
                    noise,
                    trials,
                    variation,
                });
            }
        }
    };
    for reading in Interpretation::ALL {
        add(Test::Robustness, reading, Shape::Bunny, 0, trials);
        Shape::ALL.iter().for_each(|&shape| add(Test::Accuracy, reading, shape, 0, trials));
    }
    for level in 1..=levels {
        add(Test::Sensitivity, Interpretation::Fitting, Shape::Bunny, 200 * level / levels, noisy);
    }
    cells
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_has_a_name_of_its_own() {
        let cells = cells(100, 30, 10);
        let mut names: Vec<String> = cells.iter().map(ExperimentCell::name).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), cells.len());
        assert!(names.contains(&"accuracy_written_bunny_small_cf-both".to_string()), "{names:?}");
    }
}
