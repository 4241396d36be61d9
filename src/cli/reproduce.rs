//! `cfreg reproduce`: the paper's experiments.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::{Outcome, print, progress};
use crate::error::Result;
use crate::experiment::paper::{self, Options, cell::Test, tables};
use crate::par;

#[derive(Args)]
pub(super) struct Reproduce {
    /// Folder for the results; a run that was cut short goes on from what is there
    #[arg(long, value_name = "DIR", default_value = "paper/results")]
    output: PathBuf,
    /// Folder of the scans [default: $CFREG_DATA, else data/scans]
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Few trials, in a minute
    #[arg(long)]
    smoke: bool,
    /// This test alone
    #[arg(long, value_name = "TEST")]
    only: Option<Only>,
    /// Register nothing: write the pairs of Tables I and II to this folder, as arrays that
    /// numpy.load reads, for other programs to register
    #[arg(long, value_name = "DIR")]
    pairs: Option<PathBuf>,
    /// Threads, 0 for all cores; never changes the result
    #[arg(long, value_name = "T", default_value_t = 0, allow_negative_numbers = true)]
    threads: usize,
}

/// Tests by the names that are typed.
#[derive(Clone, Copy, ValueEnum)]
enum Only {
    /// Noise (section IV-B)
    Sensitivity,
    /// Outliers (section IV-C, Table I)
    Robustness,
    /// Independent samples (section IV-D, Table II)
    Accuracy,
}

impl From<Only> for Test {
    fn from(only: Only) -> Test {
        match only {
            Only::Sensitivity => Test::Sensitivity,
            Only::Robustness => Test::Robustness,
            Only::Accuracy => Test::Accuracy,
        }
    }
}

impl Reproduce {
    pub(super) fn run(&self) -> Result<Outcome> {
        let named = || std::env::var_os("CFREG_DATA").map(PathBuf::from);
        let fetched = || Path::new("data/scans").to_path_buf();
        let options = Options {
            data: self.data.clone().or_else(named).unwrap_or_else(fetched),
            output: self.output.clone(),
            smoke: self.smoke,
            only: self.only.map(Test::from),
        };
        if let Some(folder) = &self.pairs {
            paper::pairs::write(&options, folder)?;
            return Ok(Outcome::Trusted);
        }
        let bar = progress(1, "cells");
        let results = par::with_threads(self.threads, || {
            paper::run(&options, |done, all| {
                bar.set_length(all as u64);
                bar.set_position(done as u64);
            })
        })??;
        bar.finish_and_clear();
        print(&tables::markdown(&results))?;
        Ok(Outcome::Trusted)
    }
}
