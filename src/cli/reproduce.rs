//! `cfreg reproduce`: the paper's experiments.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use super::{Outcome, print, progress, say};
use crate::error::Result;
use crate::experiment::paper::{self, Options, Part, cell::Test, readings, tables};
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
    /// This part alone
    #[arg(long, value_name = "PART")]
    only: Option<Only>,
    /// Threads, 0 for all cores; never changes the result
    #[arg(long, value_name = "T", default_value_t = 0, allow_negative_numbers = true)]
    threads: usize,
}

/// Parts by the names that are typed.
#[derive(Clone, Copy, ValueEnum)]
enum Only {
    /// Noise (section IV-B)
    Sensitivity,
    /// Outliers (section IV-C, Table I)
    Robustness,
    /// Independent samples (section IV-D, Table II)
    Accuracy,
    /// The tests by each choice that the paper leaves
    Readings,
}

impl From<Only> for Part {
    fn from(only: Only) -> Part {
        match only {
            Only::Sensitivity => Part::Test(Test::Sensitivity),
            Only::Robustness => Part::Test(Test::Robustness),
            Only::Accuracy => Part::Test(Test::Accuracy),
            Only::Readings => Part::Readings,
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
            only: self.only.map(Part::from),
        };
        let bar = progress(1, "cells");
        let done = par::with_threads(self.threads, || {
            paper::run(&options, |done, all| {
                bar.set_length(all as u64);
                bar.set_position(done as u64);
            })
        })??;
        bar.finish_and_clear();
        for line in &done.left_out {
            say(&format!("cfreg: {line}\n"));
        }
        match options.only {
            Some(Part::Readings) => print(&readings::markdown(&done.results))?,
            _ => print(&tables::markdown(&done.results))?,
        }
        Ok(Outcome::Trusted)
    }
}
