//! `cfreg-paper reproduce`: the paper's experiments.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use indicatif::ProgressBar;

use super::{print, progress, say};
use cfreg::error::Result;
use cfreg::par;
use cfreg_paper::experiments::{self, Options, Part, cell::Test, interpretations, models, tables};
use cfreg_paper::scaling::{self, Meter};
use cfreg_paper::study;

#[derive(Args)]
pub(super) struct Reproduce {
    /// Folder for the results; an interrupted run resumes from the results there [default:
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
    only: Option<Only>,
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
enum Only {
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

impl Only {
    /// Returns the part of the paper; `None` for other parts.
    fn part(self) -> Option<Part> {
        match self {
            Only::Sensitivity => Some(Part::Test(Test::Sensitivity)),
            Only::Robustness => Some(Part::Test(Test::Robustness)),
            Only::Accuracy => Some(Part::Test(Test::Accuracy)),
            Only::Readings => Some(Part::Readings),
            Only::Weights | Only::Scaling => None,
        }
    }
}

impl Reproduce {
    pub(super) fn run(&self, meter: Meter) -> Result<()> {
        let named = || std::env::var_os("CFREG_DATA").map(PathBuf::from);
        let fetched = || Path::new("data/scans").to_path_buf();
        let data = self.data.clone().or_else(named).unwrap_or_else(fetched);
        let part = self.only.and_then(Only::part);
        if let Some(folder) = &self.pairs {
            complain(&experiments::pairs::write(&self.options(data, part), folder)?);
            return Ok(());
        }
        let wanted = |part| self.only.is_none_or(|only| only == part);
        if self.only.is_none() || part.is_some() {
            self.paper(&self.options(data.clone(), part))?;
        }
        if wanted(Only::Weights) {
            self.weights(&data)?;
        }
        if wanted(Only::Scaling) {
            match self.scaling(data, meter) {
                // The available models have been run.
                Err(error) if self.only.is_none() && models::is_missing(&error) => {
                    complain(&[format!("scaling left out: {error}")]);
                }
                done => done?,
            }
        }
        Ok(())
    }

    fn options(&self, data: PathBuf, only: Option<Part>) -> Options {
        Options { data, output: self.output(), smoke: self.smoke, only }
    }

    /// A smoke run must not replace results that took half an hour.
    fn output(&self) -> PathBuf {
        let usual = if self.smoke { "paper/smoke" } else { "paper/results" };
        self.output.clone().unwrap_or_else(|| usual.into())
    }

    fn paper(&self, options: &Options) -> Result<()> {
        let bar = progress(1, "cells");
        let done = par::with_threads(self.threads, || experiments::run(options, follow(&bar)))??;
        bar.finish_and_clear();
        complain(&done.left_out);
        match options.only {
            Some(Part::Readings) => print(&interpretations::markdown(&done.results)),
            _ => print(&tables::markdown(&done.results)),
        }
    }

    fn weights(&self, data: &Path) -> Result<()> {
        let output = self.output().join("weights");
        let options = study::Options { output, smoke: self.smoke, own: Vec::new() };
        let (scenes, left_out) = study::Scenes::load(data)?;
        complain(&left_out);
        let bar = progress(1, "conditions");
        let study =
            par::with_threads(self.threads, || study::run(&options, &scenes, follow(&bar)))??;
        bar.finish_and_clear();
        study.write_page(&options.output)?;
        print(&study.markdown())
    }

    fn scaling(&self, data: PathBuf, meter: Meter) -> Result<()> {
        let options = scaling::Options::new(data, self.output(), self.smoke);
        let bar = progress(1, "sizes");
        let runs = scaling::run(&options, Some(meter), follow(&bar))?;
        bar.finish_and_clear();
        scaling::draw(&runs, &options.output)?;
        print(&scaling::markdown(&runs))
    }
}

/// Sets `bar` to the number of finished parts out of all parts.
fn follow(bar: &ProgressBar) -> impl FnMut(usize, usize) {
    |done, all| {
        bar.set_length(all as u64);
        bar.set_position(done as u64);
    }
}

/// Reports the parts that were left out.
fn complain(lines: &[String]) {
    for line in lines {
        say(&format!("cfreg: {line}\n"));
    }
}
