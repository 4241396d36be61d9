//! The model that converts evidence into probabilities and decisions: its coefficients are data.

use std::path::Path;
use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use super::evidence::Evidence;
use crate::error::{Error, Result};
use crate::io::{self, truncate_message};

/// Informative range of [`Confidence::translation_std`], in voxels. Chosen by hand.
const TRANSLATION_STD_RANGE: [f64; 2] = [0.02, 10.0];
/// Informative range of [`Confidence::margin`]. Chosen by hand.
const MARGIN_RANGE: [f64; 2] = [-8.0, 8.0];
/// Log odds are clamped to ± this value: no probability is 0 or 1. Chosen by hand.
const MAX_LOG_ODDS: f64 = 30.0;

static BUILT_IN: LazyLock<VerdictModel> = LazyLock::new(|| {
    serde_json::from_str(include_str!("model.json")).expect("a unit test reads the built-in model")
});

/// Coefficients of two regressions on the [`Evidence`], and the thresholds of decisions.
///
/// Both have the terms
///
/// intercept + overlap · ln(o + 0.01) + surface_conflict · c
/// + residual_std · ln(r + 0.05) + surface_patches · ln(1 + p)
/// + descriptor_distinctiveness · ln(max(d + 0.1, 0.01)) + inlier_score · ln(1 + i),
///
/// and, where the viewpoints of both clouds are known, + sensors_known + free_space_violation · √f.
/// The first, `pose`, ranks the poses of a pair: the difference of two is the logarithm of how much
/// more probable one is than the other. The second, `answer`, gives the log odds of the best pose,
/// with + supporting_hypotheses · ln(1 + h) + translation_std · ln(s) + margin · m: hypotheses that
/// converged to the pose, standard deviation of its translation in voxels, and difference of its
/// ranking from that of the best other pose of the search, from -8 to 8.
///
/// The built-in model ([`VerdictModel::default`]) is the file `src/verify/model.json`, which
/// `python-ref/verdict` writes. A file of the same form replaces it
/// ([`Consensus::model`](crate::method::Consensus::model)). A coefficient that a file leaves out is
/// 0: the term is not used.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerdictModel {
    /// Name of the model; every verdict has it.
    pub version: String,
    /// How the coefficients were found; for readers.
    #[serde(default)]
    pub fitted: serde_json::Map<String, serde_json::Value>,
    /// Coefficients that rank poses.
    pub pose: EvidenceCoefficients,
    /// Coefficients of the probability of the best pose.
    pub answer: AnswerCoefficients,
    /// Decision thresholds.
    pub thresholds: Thresholds,
}

/// Coefficients of the terms of the evidence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvidenceCoefficients {
    /// Constant term.
    pub intercept: f64,
    /// Constant term of pairs whose viewpoints are both known.
    pub sensors_known: f64,
    /// Coefficient of ln(overlap + 0.01).
    pub overlap: f64,
    /// Coefficient of the conflict.
    pub surface_conflict: f64,
    /// Coefficient of ln(standard deviation + 0.05).
    pub residual_std: f64,
    /// Coefficient of ln(1 + patches).
    pub surface_patches: f64,
    /// Coefficient of ln(max(distinctiveness + 0.1, 0.01)).
    pub descriptor_distinctiveness: f64,
    /// Coefficient of ln(1 + inlier score).
    pub inlier_score: f64,
    /// Coefficient of the square root of the violation.
    pub free_space_violation: f64,
}

/// Coefficients of the probability of the best pose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct AnswerCoefficients {
    /// Coefficients of the terms of the evidence.
    #[serde(flatten)]
    pub evidence: EvidenceCoefficients,
    /// Coefficient of ln(1 + hypotheses that converged to the pose).
    pub supporting_hypotheses: f64,
    /// Coefficient of the logarithm of the standard deviation of the translation, in voxels.
    pub translation_std: f64,
    /// Coefficient of the margin.
    pub margin: f64,
}

impl EvidenceCoefficients {
    /// Returns the log odds of a pose by its evidence.
    fn log_odds(&self, evidence: &Evidence) -> f64 {
        let sum = self.intercept
            + self.overlap * (evidence.overlap + 0.01).ln()
            + self.surface_conflict * evidence.surface_conflict
            + self.residual_std * (evidence.residual_std + 0.05).ln()
            + self.surface_patches * evidence.surface_patches.ln_1p()
            + self.descriptor_distinctiveness
                * (evidence.descriptor_distinctiveness + 0.1).max(0.01).ln()
            + self.inlier_score * evidence.inlier_score.ln_1p();
        let seen = |share: f64| self.sensors_known + self.free_space_violation * share.sqrt();
        sum + evidence.free_space_violation.map_or(0.0, seen)
    }

    fn values(&self) -> [f64; 9] {
        [
            self.intercept,
            self.sensors_known,
            self.overlap,
            self.surface_conflict,
            self.residual_std,
            self.surface_patches,
            self.descriptor_distinctiveness,
            self.inlier_score,
            self.free_space_violation,
        ]
    }
}

/// Decision thresholds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thresholds {
    /// Lowest probability of an accepted pose.
    pub accept: f64,
    /// Probability below which a pose is rejected, at most `accept`; between the two it is
    /// uncertain.
    pub reject: f64,
    /// A pose is ambiguous if an alternative has at least this share of its probability.
    pub ambiguous_odds: f64,
}

impl Default for Thresholds {
    /// Those of the built-in model.
    fn default() -> Self {
        VerdictModel::built_in().thresholds
    }
}

/// Evidence for the answer of a search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Confidence {
    pub(crate) evidence: Evidence,
    /// Number of refined hypotheses that converged to the pose.
    pub(crate) supporting_hypotheses: usize,
    /// Standard deviation of its translation, in voxels; `None` if it cannot be estimated.
    pub(crate) translation_std: Option<f64>,
    /// Log odds of the pose minus those of the best other pose of the search; `None` without others.
    pub(crate) margin: Option<f64>,
}

impl Confidence {
    /// Returns the standard deviation of the translation, clamped to its informative range.
    pub(crate) fn bounded_translation_std(&self) -> f64 {
        let [min, max] = TRANSLATION_STD_RANGE;
        self.translation_std.map_or(max, |std| std.clamp(min, max))
    }

    /// Returns the margin, clamped to its informative range.
    pub(crate) fn bounded_margin(&self) -> f64 {
        let [min, max] = MARGIN_RANGE;
        self.margin.map_or(max, |margin| margin.clamp(min, max))
    }
}

impl Default for VerdictModel {
    /// Returns the built-in model.
    fn default() -> Self {
        BUILT_IN.clone()
    }
}

impl VerdictModel {
    /// Returns the built-in model.
    pub fn built_in() -> &'static VerdictModel {
        &BUILT_IN
    }

    /// Reads a model from a JSON file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Parse`] for JSON that is not a model; those of
    /// [`validate`](Self::validate).
    pub fn read(path: impl AsRef<Path>) -> Result<VerdictModel> {
        let path = path.as_ref();
        let text = io::limited_file::read_text(
            path,
            io::limited_file::MAX_DOCUMENT_BYTES,
            "a verdict model",
        )?;
        let model: VerdictModel = serde_json::from_str(&text).map_err(|error| {
            let what = truncate_message(&format!("is not a verdict model: {error}"));
            Error::parse(path, None, what)
        })?;
        model.validate()?;
        Ok(model)
    }

    /// Checks that all coefficients are finite and that 0 ≤ reject ≤ accept ≤ 1.
    ///
    /// # Errors
    /// [`Error::Config`] with the name of the first number that is out of range.
    pub fn validate(&self) -> Result<()> {
        let Thresholds { accept, reject, ambiguous_odds } = self.thresholds;
        if !(0.0..=1.0).contains(&accept) {
            return Err(Error::config("accept", accept, "must be in [0, 1]"));
        }
        if !(0.0..=accept).contains(&reject) {
            let rule = format!("must be in [0, {accept}], at most the threshold accept");
            return Err(Error::config("reject", reject, rule));
        }
        if !(0.0..=1.0).contains(&ambiguous_odds) {
            return Err(Error::config("ambiguous_odds", ambiguous_odds, "must be in [0, 1]"));
        }
        let answer = &self.answer;
        let others = [answer.supporting_hypotheses, answer.translation_std, answer.margin];
        let all = [
            ("pose", &self.pose.values()[..]),
            ("answer", &answer.evidence.values()),
            ("answer", &others),
        ];
        for (field, coefficients) in all {
            if let Some(bad) = coefficients.iter().find(|x| !x.is_finite()) {
                return Err(Error::config(field, *bad, "must be finite"));
            }
        }
        Ok(())
    }

    /// Ranks the poses of a pair by their evidence: returns the log odds of a pose beside others.
    pub(crate) fn pose_log_odds(&self, evidence: &Evidence) -> f64 {
        self.pose.log_odds(evidence)
    }

    /// Ranks poses as [`pose_log_odds`](Self::pose_log_odds), with `weight` times the coefficient of the
    /// descriptors.
    pub(crate) fn pose_log_odds_by_channels(&self, evidence: &Evidence, weight: f64) -> f64 {
        let mut pose = self.pose;
        pose.descriptor_distinctiveness *= weight;
        pose.log_odds(evidence)
    }

    /// Returns the probability that the best pose is correct, in (0, 1).
    ///
    /// Every pair, even an unrelated one, has a pose that ranks first; then few other hypotheses
    /// converge to it and it is poorly constrained.
    pub(crate) fn probability(&self, confidence: &Confidence) -> f64 {
        let hypotheses = (confidence.supporting_hypotheses as f64).ln_1p();
        let translation_std = confidence.bounded_translation_std().ln();
        let c = &self.answer;
        let log_odds = c.evidence.log_odds(&confidence.evidence)
            + c.supporting_hypotheses * hypotheses
            + c.translation_std * translation_std
            + c.margin * confidence.bounded_margin();
        1.0 / (1.0 + (-log_odds.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS)).exp())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verify::evidence::tests::EVIDENCE;

    #[test]
    fn supporting_hypotheses_and_a_small_deviation_make_an_answer_more_probable() {
        let probability = |supporting_hypotheses, std| {
            let confidence = Confidence {
                evidence: EVIDENCE,
                supporting_hypotheses,
                translation_std: Some(std),
                margin: Some(0.0),
            };
            VerdictModel::built_in().probability(&confidence)
        };
        assert!(probability(11, 0.3) > 0.7 && probability(1, 8.0) < 0.3);
        assert!(probability(2, 0.3) > probability(1, 0.3));
        assert!(probability(2, 0.1) > probability(2, 0.3));
    }

    #[test]
    fn the_built_in_model_is_valid_and_comes_back_from_its_text() {
        let model = VerdictModel::default();
        model.validate().unwrap();
        assert!(model.fitted.contains_key("command") && !model.version.is_empty());
        let text = serde_json::to_string(&model).unwrap();
        assert_eq!(serde_json::from_str::<VerdictModel>(&text).unwrap(), model);
    }

    #[test]
    fn numbers_out_of_range_name_the_field() {
        let field = |change: fn(&mut VerdictModel)| {
            let mut model = VerdictModel::default();
            change(&mut model);
            match model.validate() {
                Err(Error::Config { field, .. }) => field,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(field(|model| model.thresholds.accept = 1.5), "accept");
        assert_eq!(field(|model| model.thresholds.reject = 0.9), "reject");
        assert_eq!(field(|model| model.thresholds.ambiguous_odds = -0.1), "ambiguous_odds");
        assert_eq!(field(|model| model.answer.evidence.overlap = f64::NAN), "answer");
        assert_eq!(field(|model| model.pose.overlap = f64::INFINITY), "pose");
    }

    #[test]
    fn a_file_that_is_no_model_is_refused_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.json");
        let good = include_str!("model.json");
        std::fs::write(&path, good).unwrap();
        assert_eq!(VerdictModel::read(&path).unwrap(), VerdictModel::default());
        for bad in ["", "{}", &good.replace("\"overlap\"", "\"overlaps\""), &good[..200]] {
            std::fs::write(&path, bad).unwrap();
            let said = VerdictModel::read(&path).unwrap_err().to_string();
            assert!(said.contains("model.json") && said.contains("verdict model"), "{said}");
        }
    }
}
