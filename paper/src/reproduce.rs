//! `cfreg-paper reproduce`: the paper's experiments.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use indicatif::ProgressBar;

use super::{log, print, progress};
use cfreg::error::Result;
use cfreg::par;
use cfreg_paper::experiments::{
    self, ExperimentOptions, ExperimentPart, cell::Test, interpretations, models, tables,
};
use cfreg_paper::scaling::{self, Meter};
use cfreg_paper::study;

#[derive(Args)]
pub(super) struct ReproduceCommand {
    /// Folder for the results; a run that was cut short goes on from what is there [default:
    /// paper/results, with --smoke paper/smoke]
    #[arg(long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Folder of the scans [default: $CFREG_DATA, else data/scans]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Few trials, in a minute
    #[arg(long)]
    smoke: bool,
    /// Run this part only
    #[arg(long, value_name = "PART")]
    only: Option<ReproducePart>,
    /// Register nothing: write the pairs of Tables I and II to this folder, as arrays that
    /// numpy.load reads, for other programs to register
    #[arg(long, value_name = "DIR")]
    pairs: Option<PathBuf>,
    /// Threads, 0 for all cores; never changes the result
    #[arg(long, value_name = "T", default_value_t = 0, allow_negative_numbers = true)]
    threads: usize,
}

/// Parts by their names on the command line.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ReproducePart {
    /// Noise (section IV-B)
    Sensitivity,
    /// Outliers (section IV-C, Table I)
    Robustness,
    /// Independent samples (section IV-D, Table II)
    Accuracy,
    /// The tests under each interpretation that the paper leaves open
    Readings,
    /// The study of weight schemes
    Weights,
    /// Time and memory over the number of points
    Scaling,
}

impl ReproducePart {
    /// The part of the paper; `None` for what is none.
    fn paper_part(self) -> Option<ExperimentPart> {
        match self {
            ReproducePart::Sensitivity => Some(ExperimentPart::Test(Test::Sensitivity)),
            ReproducePart::Robustness => Some(ExperimentPart::Test(Test::Robustness)),
            ReproducePart::Accuracy => Some(ExperimentPart::Test(Test::Accuracy)),
            ReproducePart::Readings => Some(ExperimentPart::Interpretations),
            ReproducePart::Weights | ReproducePart::Scaling => None,
        }
    }
}

impl ReproduceCommand {
    pub(super) fn run(&self, meter: Meter) -> Result<()> {
        let named = || std::env::var_os("CFREG_DATA").map(PathBuf::from);
        let fetched = || Path::new("data/scans").to_path_buf();
        let data = self.data.clone().or_else(named).unwrap_or_else(fetched);
        let part = self.only.and_then(ReproducePart::paper_part);
        if let Some(folder) = &self.pairs {
            log_lines(&experiments::pairs::write(&self.options(data, part), folder)?);
            return Ok(());
        }
        let wanted = |part| self.only.is_none_or(|only| only == part);
        if self.only.is_none() || part.is_some() {
            self.paper(&self.options(data.clone(), part))?;
        }
        if wanted(ReproducePart::Weights) {
            self.weights(&data)?;
        }
        if wanted(ReproducePart::Scaling) {
            match self.scaling(data, meter) {
                // The available models have been run.
                Err(error) if self.only.is_none() && models::is_missing(&error) => {
                    log_lines(&[format!("scaling left out: {error}")]);
                }
                done => done?,
            }
        }
        Ok(())
    }

    fn options(&self, data: PathBuf, only: Option<ExperimentPart>) -> ExperimentOptions {
        ExperimentOptions { data, output: self.output(), smoke: self.smoke, only }
    }

    /// A smoke run must not replace results that took half an hour.
    fn output(&self) -> PathBuf {
        let usual = if self.smoke { "paper/smoke" } else { "paper/results" };
        self.output.clone().unwrap_or_else(|| usual.into())
    }

    fn paper(&self, options: &ExperimentOptions) -> Result<()> {
        let bar = progress(1, "cells");
        let done = par::with_threads(self.threads, || {
            experiments::run(options, progress_callback(&bar))
        })??;
        bar.finish_and_clear();
        log_lines(&done.left_out);
        match options.only {
            Some(ExperimentPart::Interpretations) => {
                print(&interpretations::markdown(&done.results))
            }
            _ => print(&tables::markdown(&done.results)),
        }
    }

    fn weights(&self, data: &Path) -> Result<()> {
        let output = self.output().join("weights");
        let options = study::StudyOptions { output, smoke: self.smoke, own: Vec::new() };
        let (scenes, left_out) = study::Scenes::load(data)?;
        log_lines(&left_out);
        let bar = progress(1, "conditions");
        let study = par::with_threads(self.threads, || {
            study::run(&options, &scenes, progress_callback(&bar))
        })??;
        bar.finish_and_clear();
        study.write_page(&options.output)?;
        print(&study.markdown())
    }

    fn scaling(&self, data: PathBuf, meter: Meter) -> Result<()> {
        let options = scaling::ScalingOptions::new(data, self.output(), self.smoke);
        let bar = progress(1, "sizes");
        let runs = scaling::run(&options, Some(meter), progress_callback(&bar))?;
        bar.finish_and_clear();
        scaling::draw(&runs, &options.output)?;
        print(&scaling::markdown(&runs))
    }
}

/// Moves `bar` to how many parts of how many are done.
fn progress_callback(bar: &ProgressBar) -> impl FnMut(usize, usize) {
    |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    }
}

/// Says what was left out.
fn log_lines(lines: &[String]) {
    for line in lines {
        log(&format!("cfreg: {line}\n"));
    }
}
