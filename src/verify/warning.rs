//! Warnings about a computed pose.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::evaluate::Evaluation;
use super::model::Thresholds;
use super::verdict::{Decision, Verdict};

/// Chance-corrected fitness below which a pose gets a warning.
///
/// Measured on 60 real pairs of seven kinds, moved at random and registered with and without dual
/// softmax (`cargo test --release --features cli --test it trust -- --nocapture`): of the poses off
/// by more than 20°, none of 90 reached 0.3 with clouds of 2,000 points (the most was 0.18), none
/// of 92 with 1,000 (0.26), and 3 of 104 with 500, where the inlier distance is coarse. The true
/// poses reach 0.58 in the median, poses found by one step 0.33: the threshold errs on the side of
/// caution.
pub const MIN_CHANCE_CORRECTED_FITNESS: f64 = 0.3;
/// Chance-corrected fitness below which a pose gets a warning if the method aligned the clouds
/// locally, as ICP, CPD and similar methods do: a wrong optimum of these methods fits better than a
/// wrong global estimate, and a correct optimum fits nearly as well as possible.
///
/// Measured on real pairs of seven kinds, started 3° to 180° off the truth, with the six methods:
/// of the poses that ended off by more than 20°, none of 1,070 reached 0.6 with clouds of 500
/// points (the most was 0.59, by Kernel Correlation), none of 574 with 1,000 (0.52), none of 244
/// with 2,000 (0.33). Correct poses reach 0.7 in the median, and a fifth of them, with little
/// overlap, stay below the threshold. A smaller run of this measurement is `cargo test --release
/// --features cli --test it trust::wrong_optima -- --nocapture`.
pub const MIN_CHANCE_CORRECTED_FITNESS_LOCAL: f64 = 0.6;
/// Fitness of wrong rotations above which a pose without a verdict gets a warning: the
/// chance-corrected fitness is not informative if the chance fitness is high.
///
/// Among 72 real pairs of eight kinds, whole and of 1,000 points, none has more than 0.19 (`chance`
/// of `cfreg register --json`); two samples of 200 points of `cfreg demo` have 0.45 to 0.66, of 500
/// points 0.28 to 0.48, and there wrong poses reach a chance-corrected fitness of 0.6 to 0.9.
pub const MAX_CHANCE_FITNESS: f64 = 0.4;
/// Fitness of wrong rotations above which an accepting verdict becomes ambiguous: a ball or a cube
/// fits itself under many rotations. Chosen by hand: two samples of 100 points of `cfreg demo`,
/// distinguished by their shape, reach 0.78; a ball laid out on the faces of a cube has 1.
pub const MAX_CHANCE_FITNESS_VERIFIED: f64 = 0.9;
/// Second relative singular value below which a rotation gets a warning: about one axis the weights
/// then hardly constrain the angle. Chosen by hand.
pub const MIN_SECOND_SINGULAR_VALUE: f64 = 1e-3;

/// Third relative singular value below which the connected points count as flat. Chosen by hand.
pub const MIN_THIRD_SINGULAR_VALUE: f64 = 1e-6;

/// Keypoints of a cloud below which a pose gets a warning: among fewer, a few wrong correspondences
/// change the pose. Chosen by hand.
pub const MIN_KEYPOINTS: usize = 10;

/// A ground to doubt an answer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "ground", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Warning {
    /// The fit of the clouds is hardly better than under a wrong rotation.
    #[serde(rename = "low-agreement")]
    LowFitness {
        /// [`Evaluation::chance_corrected_fitness`] of the pose.
        found: f64,
        /// [`MIN_CHANCE_CORRECTED_FITNESS`] or [`MIN_CHANCE_CORRECTED_FITNESS_LOCAL`].
        needed: f64,
    },
    /// The clouds fit nearly as well under wrong rotations: they are small, round or filled, and
    /// the fitness is not informative.
    #[serde(rename = "high-chance")]
    HighChanceFitness {
        /// [`Evaluation::chance_fitness`].
        found: f64,
        /// [`MAX_CHANCE_FITNESS`], or with a verdict [`MAX_CHANCE_FITNESS_VERIFIED`].
        most: f64,
    },
    /// A verdict was requested, and the clouds have too few points or too little shape for one.
    NotVerified,
    /// Added to [`LowFitness`](Self::LowFitness): a cloud has no known viewpoint, so that its
    /// normals point to the origin of its frame, an arbitrary position.
    NoViewpoint,
    /// The weights hardly constrain the rotation about one axis.
    WeakRotation {
        /// Second relative singular value.
        found: f64,
        /// [`MIN_SECOND_SINGULAR_VALUE`].
        needed: f64,
    },
    /// The connected points are in a plane, along which one cloud slides and rotates on the other:
    /// only their outline constrains them.
    Flat {
        /// Third relative singular value.
        found: f64,
        /// [`MIN_THIRD_SINGULAR_VALUE`].
        needed: f64,
    },
    /// The iterations ended at their limit, without convergence.
    NotConverged {
        /// Number of iterations.
        iterations: u32,
    },
    /// The surfaces hardly constrain the pose in one direction: planes, spheres and similar
    /// surfaces slide along themselves.
    #[serde(rename = "slides")]
    Degenerate {
        /// Smallest pivot of the paired surfaces' normal equations relative to the mean of their
        /// diagonal.
        found: f64,
        /// Smallest pivot that the method requires.
        needed: f64,
    },
    /// A keypoint detector found few points in one of the clouds.
    FewKeypoints {
        /// Keypoints with a descriptor in the cloud that has fewer.
        found: usize,
        /// [`MIN_KEYPOINTS`].
        needed: usize,
    },
    /// A refinement found no correspondences at its initial pose.
    NotRefined,
    /// So few correspondences are inliers that chance alone may explain them.
    FewInliers {
        /// Number of inliers.
        found: usize,
        /// Number of inliers that chance hardly produces.
        needed: usize,
    },
    /// The pose is probably wrong.
    Improbable {
        /// [`Verdict::probability`].
        found: f64,
        /// [`Thresholds::accept`](super::Thresholds::accept).
        needed: f64,
    },
    /// The pose is neither probable enough to accept nor improbable.
    Uncertain {
        /// [`Verdict::probability`].
        found: f64,
        /// [`Thresholds::accept`](super::Thresholds::accept).
        needed: f64,
    },
    /// An alternative pose may be correct instead: the clouds are symmetric, or repeat.
    Ambiguous {
        /// The probability of the alternative pose.
        other: f64,
    },
    /// The pose is unconstrained along some motions: the overlapping surfaces slide on each other.
    #[serde(rename = "undetermined")]
    Unobservable {
        /// Number of these motions, of 6.
        motions: usize,
    },
    /// At another scale more of the source would overlap the target.
    #[serde(rename = "other-scale")]
    ScaleMismatch {
        /// [`Verdict::other_scale`].
        scale: f64,
    },
    /// The mirror image of the source fits the target better.
    Mirrored,
    /// The search for the largest set of consistent correspondences ended at its limit: there may
    /// be a larger set.
    CliqueNotProved {
        /// Correspondences in the largest set that was found.
        found: usize,
    },
}

/// The fitness that a pose must have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitnessRule {
    /// Smallest chance-corrected fitness ([`Evaluation::chance_corrected_fitness`]).
    pub min_fitness: f64,
    /// Largest fitness of wrong rotations ([`Evaluation::chance_fitness`]).
    pub max_chance_fitness: f64,
}

impl FitnessRule {
    /// The rule for methods that need no initial pose.
    pub const GLOBAL: FitnessRule = FitnessRule {
        min_fitness: MIN_CHANCE_CORRECTED_FITNESS,
        max_chance_fitness: MAX_CHANCE_FITNESS,
    };
    /// The rule for methods that start from a pose.
    pub const LOCAL: FitnessRule =
        FitnessRule { min_fitness: MIN_CHANCE_CORRECTED_FITNESS_LOCAL, ..FitnessRule::GLOBAL };
    /// No requirement: for methods with a stricter verification.
    pub const NONE: FitnessRule =
        FitnessRule { min_fitness: f64::NEG_INFINITY, max_chance_fitness: f64::INFINITY };

    /// Returns the warnings about an evaluation.
    pub fn check(&self, evaluation: &Evaluation) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let (found, most) = (evaluation.chance_fitness, self.max_chance_fitness);
        if found > most {
            warnings.push(Warning::HighChanceFitness { found, most });
        }
        let (found, needed) = (evaluation.chance_corrected_fitness(), self.min_fitness);
        if found.is_nan() || found < needed {
            warnings.push(Warning::LowFitness { found, needed });
        }
        warnings
    }
}

/// Returns the warnings about the relative singular values of a solution.
pub fn check_singular_values([_, second, third]: [f64; 3]) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if second.is_nan() || second < MIN_SECOND_SINGULAR_VALUE {
        let needed = MIN_SECOND_SINGULAR_VALUE;
        warnings.push(Warning::WeakRotation { found: second, needed });
    }
    if third < MIN_THIRD_SINGULAR_VALUE {
        warnings.push(Warning::Flat { found: third, needed: MIN_THIRD_SINGULAR_VALUE });
    }
    warnings
}

impl Warning {
    /// Returns the warnings for a verdict; none if it accepts.
    pub fn from_verdict(verdict: &Verdict) -> Vec<Warning> {
        let found = verdict.probability;
        let Thresholds { accept, ambiguous_odds, .. } = verdict.thresholds;
        let mut warnings = match (verdict.decision, verdict.runner_up) {
            (Decision::Accept, _) => return Vec::new(),
            (Decision::Reject, _) => {
                vec![Warning::Improbable { found, needed: accept }]
            }
            (Decision::Uncertain, _) => vec![Warning::Uncertain { found, needed: accept }],
            (Decision::Ambiguous, Some(other)) if other.probability > ambiguous_odds * found => {
                vec![Warning::Ambiguous { other: other.probability }]
            }
            (Decision::Ambiguous, _) => Vec::new(),
        };
        let loose = verdict.covariance.as_ref().map_or(0, |known| known.unobservable.len());
        if loose > 0 {
            warnings.push(Warning::Unobservable { motions: loose });
        }
        warnings.extend(verdict.other_scale.map(|scale| Warning::ScaleMismatch { scale }));
        warnings.extend(verdict.mirrored.then_some(Warning::Mirrored));
        warnings
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Warning::LowFitness { found, needed } => write!(
                f,
                "overlap at this pose is barely better than chance ({found:.2}, need {needed:.2}): \
                 the pose is probably wrong, or the clouds overlap too little"
            ),
            Warning::HighChanceFitness { found, most } => write!(
                f,
                "wrong rotations fit nearly as well (their fitness is {found:.2}, at most \
                 {most:.2} is allowed): the clouds are small, round or filled"
            ),
            Warning::NotVerified => write!(
                f,
                "the pose could not be verified on the surfaces: the clouds have too few points \
                 or too little shape"
            ),
            Warning::NoViewpoint => write!(
                f,
                "no viewpoint is known, so normals point to the origin of the frame: if no sensor \
                 stood there, say where it did, or try orientation outward"
            ),
            Warning::WeakRotation { found, needed } => write!(
                f,
                "the weights do not determine the rotation about one axis: the second singular \
                 value is {found:.1e}, {needed:.1e} is needed"
            ),
            Warning::Flat { found, needed } => write!(
                f,
                "the connected points lie in a plane, in which the clouds slide and turn: the third \
                 singular value is {found:.1e}, {needed:.1e} is needed"
            ),
            Warning::Degenerate { found, needed } => write!(
                f,
                "the surfaces slide along each other in one direction: the smallest pivot is \
                 {found:.1e} of the mean, {needed:.1e} is needed"
            ),
            Warning::FewKeypoints { found, needed } => write!(
                f,
                "{found} keypoints in one of the clouds, {needed} are needed: take more points, \
                 lower the detector's thresholds, or register by cf"
            ),
            Warning::NotRefined => {
                write!(f, "no points are close enough at this pose to refine it")
            }
            Warning::FewInliers { found, needed } => write!(
                f,
                "{found} correspondences are inliers of this pose, chance alone can give {needed}: \
                 the clouds may have nothing in common"
            ),
            Warning::Improbable { found, needed } => write!(
                f,
                "the pose is probably wrong (probability {found:.3}, need {needed}): the clouds may \
                 overlap too little, or not at all"
            ),
            Warning::Uncertain { found, needed } => write!(
                f,
                "the pose is uncertain (probability {found:.3}, need {needed}): check it, or \
                 register clouds that overlap more"
            ),
            Warning::Ambiguous { other } => write!(
                f,
                "an alternative pose has probability {other:.3}: the clouds are symmetric, or show \
                 the same shape more than once"
            ),
            Warning::Unobservable { motions } => write!(
                f,
                "{motions} of 6 degrees of freedom are unconstrained (planar, cylindrical or \
                 spherical geometry)"
            ),
            Warning::ScaleMismatch { scale } => write!(
                f,
                "scaled by {scale:.3}, the source would overlap the target clearly better: convert \
                 both to one unit and register them again"
            ),
            Warning::Mirrored => write!(
                f,
                "the mirror image of the source fits the target better: an axis of one cloud is \
                 reversed, or the clouds show a left and a right part"
            ),
            Warning::CliqueNotProved { found } => write!(
                f,
                "the search for the largest set of consistent correspondences ended at its limit \
                 with {found}: there may be a larger set; allow more steps or lower noise_bound"
            ),
            Warning::NotConverged { iterations } => write!(
                f,
                "not converged after {iterations} iterations: allow more, or start nearer"
            ),
        }
    }
}
