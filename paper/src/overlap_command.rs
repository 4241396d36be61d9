//! `cfreg-paper overlap`.

use std::path::PathBuf;

use cfreg::{Result, par};
use cfreg_paper::overlap::{self, CONTENDERS, OverlapOptions};
use clap::Args;

use super::{print, progress};

#[derive(Args)]
pub(super) struct OverlapCommand {
    /// Lists of pairs with known poses and overlap, as for `cfreg benchmark`
    #[arg(required = true)]
    lists: Vec<PathBuf>,
    /// Folder for the results; a method that was run is not run again
    #[arg(long, value_name = "DIR", default_value = "paper/results/overlap")]
    output: PathBuf,
    /// Methods, of cf, cf-both, cf-multiscale, cf-spectral, teaser and consensus [default: all];
    /// cf-spectral:connections=500 has one number other than the default
    #[arg(long, value_name = "METHOD,..", value_delimiter = ',')]
    methods: Vec<String>,
    /// Every N-th pair of the lists alone
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Threads, 0 for all cores; never changes the poses
    #[arg(long, value_name = "T", default_value_t = 0)]
    threads: usize,
}

impl OverlapCommand {
    pub(super) fn run(&self) -> Result<()> {
        let mut methods = self.methods.clone();
        if methods.is_empty() {
            methods = CONTENDERS.map(String::from).to_vec();
        }
        // Before the first of them runs.
        methods.iter().try_for_each(|name| overlap::contender(name).map(|_| ()))?;
        let options = OverlapOptions {
            lists: self.lists.clone(),
            output: self.output.clone(),
            every: self.every as usize,
            methods,
        };
        let bar = progress(1, "pairs");
        let follow = |done, all| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let runs = par::with_threads(self.threads, || overlap::run(&options, follow))??;
        bar.finish_and_clear();
        print(&overlap::markdown(&runs, &options.methods))
    }
}
