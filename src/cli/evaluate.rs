//! `cfreg evaluate`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::options::{PriorOptions, VERDICT_MODEL};
use super::{CommandOutcome, input, print, print_json};
use crate::cloud::ViewpointSource;
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::io;
use crate::verify::{self, EvaluationReport, Verdict, VerdictModel};

#[derive(Args)]
pub(super) struct EvaluateCommand {
    /// Cloud that is moved
    source: PathBuf,
    /// Cloud that stays
    target: PathBuf,
    /// Pose to evaluate: 4 lines of 4 numbers, or the JSON of `cfreg register --json`
    #[arg(long, value_name = "T.txt")]
    transform: PathBuf,
    /// True pose, if known
    #[arg(long, value_name = "GT.txt")]
    truth: Option<PathBuf>,
    /// Largest distance of an inlier [default: 2 times the resolution of the coarser cloud]
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    max_distance: Option<f64>,
    #[command(flatten)]
    thinning: Downsampling,
    /// Also verify the pose by a search of the method consensus: the probability that it is correct to
    /// within one voxel (of the size --voxel), and a more probable pose, if there is one; the exit
    /// code is 0 only for accept
    #[arg(long)]
    verdict: bool,
    #[arg(long, value_name = "FILE", requires = "verdict", help = VERDICT_MODEL)]
    verdict_model: Option<PathBuf>,
    #[command(flatten)]
    prior_options: PriorOptions,
    #[arg(long, value_name = "WHERE", default_value_t, help = input::VIEWPOINTS_HELP)]
    viewpoints: ViewpointSource,
    /// Keep rows that mark measurements without a return: 20 or more at exactly one position, mostly
    /// (0, 0, 0)
    #[arg(long)]
    keep_no_returns: bool,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

/// The object that `--json` prints.
#[derive(Serialize)]
struct EvaluateOutput {
    #[serde(flatten)]
    judgement: EvaluationReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<Verdict>,
}

impl EvaluateCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let mut judge = self.prior_options.verifier(self.thinning.voxel)?;
        if let Some(path) = &self.verdict_model {
            judge = judge.model(VerdictModel::read(path)?);
        }
        if let Some(name) = self.prior_options.given_option().filter(|_| !self.verdict) {
            let rule = "requires --verdict";
            return Err(Error::config(name, "given", rule));
        }
        let transform = io::read_transform(&self.transform)?;
        let truth = self.truth.as_ref().map(io::read_transform).transpose()?;
        let files = [self.source.as_path(), &self.target];
        let [source, target] =
            input::read_pair(files, &self.thinning, self.viewpoints, self.keep_no_returns)?;
        let judgement = verify::evaluate_with_truth(
            &source,
            &target,
            &transform,
            self.max_distance,
            truth.as_ref(),
        )?;
        let verdict = || {
            // The search downsamples the clouds itself.
            let raw = Downsampling { voxel: None, ..self.thinning };
            let raw = self
                .thinning
                .voxel
                .map(|_| input::read_pair(files, &raw, self.viewpoints, self.keep_no_returns));
            let [source, target] = &raw.transpose()?.unwrap_or([source, target]);
            judge.verify(source, target, &transform)
        };
        let verdict = self.verdict.then(verdict).transpose()?;
        let decision = verdict.as_ref().map(|verdict| verdict.decision);
        let usable = verify::is_usable(&transform, true, decision);
        if self.json {
            print_json(&EvaluateOutput { judgement, verdict })?;
        } else {
            let verdict = verdict.map_or_else(String::new, |it| format!("{it}\n"));
            print(&(evaluation_text(&judgement) + &verdict))?;
        }
        Ok(if usable { CommandOutcome::Trusted } else { CommandOutcome::Doubted })
    }
}

fn evaluation_text(judgement: &EvaluationReport) -> String {
    let e = &judgement.evaluation;
    let mut lines = vec![
        format!(
            "fitness               {:.6} of the source points within {:.6}",
            e.fitness, e.max_distance
        ),
        format!("target fitness        {:.6} of the target points", e.target_fitness),
        format!("inlier RMSE           {:.6}", e.inlier_rmse),
        format!("chance                {:.6} (fitness of wrong rotations)", e.chance_fitness),
        format!(
            "agreement             {:.6} (fitness beyond chance)",
            e.chance_corrected_fitness()
        ),
    ];
    if let Some(truth) = &judgement.truth {
        lines.push(format!("rotation error        {:.6} deg", truth.rotation_deg));
        lines.push(format!("||I - R Rgt^T||_F     {:.6}", truth.rotation_frobenius));
        lines.push(format!(
            "translation error     {:.6} at the source's centroid",
            truth.translation
        ));
    }
    lines.join("\n") + "\n"
}
