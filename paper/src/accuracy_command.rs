//! `cfreg-paper accuracy`.

use std::path::PathBuf;

use cfreg::method::Method;
use cfreg::verify::PoseError;
use cfreg::{Error, Result, io};
use cfreg_paper::accuracy::{AccuracyReport, AccuracySettings, run};
use cfreg_paper::{Model, Motion};
use clap::Args;
use serde_json::Value;

use super::{print, progress};

#[derive(Args)]
pub(super) struct AccuracyCommand {
    /// Model to sample: a cloud of at least --points points
    model: PathBuf,
    /// Sample the faces or the range grid of a PLY file uniformly by area, as the paper does, not
    /// its points
    #[arg(long)]
    by_area: bool,
    /// Registration method, as for `cfreg register`
    #[arg(long, default_value = "cf")]
    method: String,
    /// A setting of the method, by its name in the `config` of `cfreg register --json`
    #[arg(long, value_name = "NAME=VALUE", allow_hyphen_values = true)]
    set: Vec<String>,
    /// Pairs to register
    #[arg(long, default_value_t = AccuracySettings::default().trials)]
    trials: usize,
    /// Points of each sample
    #[arg(long, default_value_t = AccuracySettings::default().points)]
    points: usize,
    /// small: rotation vectors in [-pi/8, pi/8)^3 about the centroid; large: in
    /// [-pi/2, pi/2)^3 about the origin
    #[arg(long, default_value_t = AccuracySettings::default().motion)]
    motion: Motion,
    /// Seed of motions and samples
    #[arg(long, default_value_t = AccuracySettings::default().seed)]
    seed: u64,
    /// Print one JSON object with every trial instead of text
    #[arg(long)]
    json: bool,
}

impl AccuracyCommand {
    /// Runs the trials; false where none has an answer.
    pub(super) fn run(&self) -> Result<bool> {
        let mut method: Method = self.method.parse()?;
        for text in &self.set {
            let Some((name, value)) = text.split_once('=') else {
                return Err(Error::config("set", text, "must be NAME=VALUE"));
            };
            let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
            method = method.with([(name.trim(), value)])?;
        }
        let model: Model = match self.by_area {
            true => io::read_mesh(&self.model)?.into(),
            false => io::read(&self.model)?.into(),
        };
        let AccuracyCommand { trials, points, motion, seed, .. } = *self;
        let bar = progress(trials as u64, "trials");
        let settings = AccuracySettings { trials, points, motion, seed };
        let report = run(&model, &method, settings, |done| bar.set_position(done as u64))?;
        bar.finish_and_clear();
        if self.json {
            let text = serde_json::to_string_pretty(&report).map_err(std::io::Error::other);
            print(&(text.map_err(|error| Error::io("standard output", error))? + "\n"))?;
        } else {
            print(&accuracy_text(&report))?;
        }
        Ok(report.failures() < trials)
    }
}

fn accuracy_text(report: &AccuracyReport) -> String {
    let line = |name: &str, measure: fn(&PoseError) -> f64| {
        let (mean, deviation) = report.statistics(measure);
        format!("{name:<22}{mean:.4} +- {deviation:.4}\n")
    };
    format!(
        "{} trials, {} points, {} rotations; {} without a pose, {} with warnings\n{}{}{}",
        report.settings.trials,
        report.settings.points,
        report.settings.motion,
        report.failures(),
        report.doubted,
        line("||I - R Rgt^T||_F", |e| e.rotation_frobenius),
        line("rotation error (deg)", |e| e.rotation_deg),
        line("translation error", |e| e.translation),
    )
}
