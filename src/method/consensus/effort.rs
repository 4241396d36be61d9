//! The second stage of a search, for pairs whose best pose is not probable enough: correspondences
//! by descriptors of other sizes.
//!
//! Descriptors of few points survive borders and small overlaps, those of many points survive noise;
//! each finds pairs that the others miss. Their poses are scored on the same surfaces and by the same
//! correspondences as those of the first stage, so that all of them compare.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::scan::FPFH;
use super::trial::{
    EARLY_EXIT_PROBABILITY, REFINED_HYPOTHESES, ViewpointTrial, match_descriptors, sort_by_odds,
};
use super::{Consensus, ConsensusSearch};
use crate::cloud::Descriptors;
use crate::descriptor::{Descriptor, PreparedCloud};
use crate::error::{Error, Result};
use crate::method::registration::Timings;
use crate::par;
use crate::search::{Neighborhood, Neighbors};
use crate::surface::Surface;

/// Time that a search may take where its first stage finds no pose that is accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Effort {
    /// The first stage alone: descriptors of 100 points.
    Quick,
    /// Descriptors of 40, 60 and 200 points, until a pose is certain.
    #[default]
    Normal,
    /// Descriptors of 30, 50, 70, 150 and 250 points, all of them.
    Thorough,
}

impl Effort {
    /// All of them, by increasing time.
    pub const ALL: [Effort; 3] = [Effort::Quick, Effort::Normal, Effort::Thorough];

    /// Numbers of nearest points of the descriptors of the second stage. Chosen among subsets of 30 to
    /// 250 points by the right answers of pairs that share 10 to 30 % (`pairs.csv`, `pairs_more.csv`;
    /// `cfreg benchmark --viewpoints origin`): of 169 the first stage finds 115, those of `Normal`
    /// 128, those of `Thorough` 132.
    fn neighbors(self) -> &'static [usize] {
        match self {
            Effort::Quick => &[],
            Effort::Normal => &[40, 60, 200],
            Effort::Thorough => &[30, 50, 70, 150, 250],
        }
    }
}

impl fmt::Display for Effort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Effort::Quick => "quick",
            Effort::Normal => "normal",
            Effort::Thorough => "thorough",
        })
    }
}

impl FromStr for Effort {
    type Err = Error;

    fn from_str(text: &str) -> Result<Effort> {
        let found = Effort::ALL.into_iter().find(|effort| effort.to_string() == text);
        found.ok_or_else(|| Error::config("effort", text, "must be quick, normal or thorough"))
    }
}

impl<'a> ConsensusSearch<'a> {
    /// Runs the second stage, if the configuration has one and the best pose is not accepted.
    pub(super) fn widen(mut self, times: &mut Timings) -> Result<Self> {
        let widens = self.given.is_none() && self.config.given_descriptors.is_none();
        if !widens || self.config.effort == Effort::Quick || self.is_probable() {
            return Ok(self);
        }
        for trial in &mut self.trials {
            self.config.widen_trial(trial, times)?;
        }
        let ConsensusSearch { config, scans, known_viewpoints, trials, .. } = self;
        let mut widened =
            ConsensusSearch::new(config, None, scans, known_viewpoints, trials, times)?;
        widened.is_widened = true;
        Ok(widened)
    }

    /// Whether the best pose is probable enough to be accepted.
    fn is_probable(&self) -> bool {
        let best = &self.best;
        let covariance = self.covariance(&best.pose);
        let confidence =
            self.confidence(&best.pose, best.evidence, &self.alternatives, covariance.as_ref());
        let model = self.config.verdict_model();
        model.probability(&confidence) >= model.thresholds.accept
    }

    /// Describes the second stage, in words.
    pub(super) fn effort_reason(&self) -> Option<String> {
        let sizes: Vec<String> =
            self.config.effort.neighbors().iter().map(usize::to_string).collect();
        self.is_widened.then(|| {
            format!(
                "the first stage of the search found no probable pose: descriptors of {} points \
                 proposed further poses (effort={})",
                sizes.join(", "),
                self.config.effort
            )
        })
    }
}

impl Consensus {
    /// Adds to `trial` the poses that descriptors of other sizes propose.
    fn widen_trial(&self, trial: &mut ViewpointTrial, times: &mut Timings) -> Result<()> {
        let length = trial.correspondences.voxel_size;
        for &neighbors in self.effort.neighbors() {
            let surfaces = trial.surface_refs();
            let tables = times.time("descriptors", || {
                par::join_pair(surfaces, |surface| describe(surface, neighbors))
            })?;
            let matches =
                times.time("matches", || match_descriptors(surfaces, tables.each_ref(), length))?;
            let hypotheses =
                times.time("hypotheses", || matches.generate_hypotheses(self.seeds, &self.prior));
            let found = times.time("verify", || {
                let own = &trial.correspondences;
                self.score_hypotheses(surfaces, own, hypotheses, REFINED_HYPOTHESES)
            });
            trial.candidates.extend(found);
            sort_by_odds(&mut trial.candidates);
            let best = trial.candidates.first().map(|best| best.evidence);
            if self.effort != Effort::Thorough
                && best.is_some_and(|best| self.usual_probability(best) >= EARLY_EXIT_PROBABILITY)
            {
                break;
            }
        }
        Ok(())
    }
}

/// Returns FPFH of `neighbors` points of a surface.
fn describe(surface: &Surface, neighbors: usize) -> Result<Descriptors> {
    let near = Neighbors::find(&surface.points, Neighborhood::Nearest(neighbors))?;
    FPFH.describe(&PreparedCloud::new(&surface.points, &surface.normals, &near)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back() {
        for effort in Effort::ALL {
            assert_eq!(effort.to_string().parse::<Effort>().unwrap(), effort);
            assert_eq!(serde_json::to_value(effort).unwrap(), effort.to_string());
        }
        let refused = "hard".parse::<Effort>().unwrap_err().to_string();
        assert!(refused.contains("quick, normal or thorough"), "{refused}");
    }
}
