//! `cfreg evaluate`.

use std::path::PathBuf;

use clap::Args;

use super::{Outcome, print, print_json, thinning};
use crate::error::Result;
use crate::filter::Thinning;
use crate::io;
use crate::quality::{self, Judgement};

#[derive(Args)]
pub(super) struct Evaluate {
    /// Cloud that is moved
    source: PathBuf,
    /// Cloud that stays
    target: PathBuf,
    /// Pose to judge: 4 lines of 4 numbers, or the JSON of `cfreg register --json`
    #[arg(long, value_name = "T.txt")]
    transform: PathBuf,
    /// True pose, if known
    #[arg(long, value_name = "GT.txt")]
    truth: Option<PathBuf>,
    /// Largest distance that counts as an inlier [default: 2 times the coarser cloud's
    /// resolution]
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    max_distance: Option<f64>,
    #[command(flatten)]
    thinning: Thinning,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

impl Evaluate {
    pub(super) fn run(&self) -> Result<Outcome> {
        let transform = io::read_transform(&self.transform)?;
        let truth = self.truth.as_ref().map(io::read_transform).transpose()?;
        let source = thinning::read(&self.source, &self.thinning, 0)?;
        let target = thinning::read(&self.target, &self.thinning, 1)?;
        let judgement =
            quality::judge(&source, &target, &transform, self.max_distance, truth.as_ref())?;
        if self.json {
            print_json(&judgement)?;
        } else {
            print(&text(&judgement))?;
        }
        Ok(Outcome::Trusted)
    }
}

fn text(judgement: &Judgement) -> String {
    let e = &judgement.evaluation;
    let mut lines = vec![
        format!(
            "fitness               {:.6} of the source points within {:.6}",
            e.fitness, e.max_distance
        ),
        format!("target fitness        {:.6} of the target points", e.target_fitness),
        format!("inlier RMSE           {:.6}", e.inlier_rmse),
        format!("chance                {:.6} (fitness of wrong rotations)", e.chance),
        format!("agreement             {:.6} (fitness beyond chance)", e.agreement()),
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
