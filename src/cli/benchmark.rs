//! `cfreg benchmark`: methods over a list of pairs with known poses.

use std::path::{Path, PathBuf};

use clap::Args;

use super::{CommandOutcome, input, log, outputs, print, progress};
use crate::benchmark::{
    self, ExternalPoses, Pair, Settings, SuccessCriterion, list, reliability, report,
};
use crate::cloud::ViewpointSource;
use crate::error::Result;
use crate::par;

#[derive(Args)]
pub(super) struct BenchmarkCommand {
    /// Lists: CSV with the columns source, target, t00 to t33 and, if known, dataset, overlap and
    /// units (m, cm, mm); or gt.log of 3DMatch
    #[arg(required = true)]
    pairs: Vec<PathBuf>,
    /// Folder that the files of CSV lists are relative to [default: that of each list]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Method, with refinements after +: cf-multiscale+gicp; may be repeated
    #[arg(long, value_name = "METHOD", default_value = "consensus")]
    method: Vec<String>,
    /// Poses of other programs, to be evaluated too: CSV with the columns method, source, target (as
    /// in the list), t00 to t33 and, if known, seconds and accepted; a row of a pair that is not in
    /// the lists is refused, a pair without a row counts as failed
    #[arg(long, value_name = "POSES.csv")]
    poses: Vec<PathBuf>,
    /// Rows as CSV; an interrupted run continues from the rows that are there
    #[arg(long, value_name = "ROWS.csv")]
    output: Option<PathBuf>,
    /// Write STEM.svg and STEM.png: probabilities of verdicts, and the share of correct poses
    #[arg(long, value_name = "STEM")]
    figure: Option<PathBuf>,
    /// Write index.html to this folder: a table of the rows, the worst first, with links to pages of
    /// pairs that show the true pose; these pairs are registered again
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Number of rows, the worst first, with a page of their own
    #[arg(long, value_name = "N", default_value_t = 20, requires = "report")]
    pages: usize,
    /// Write every pose that consensus refines, with its evidence and whether it is correct, as CSV,
    /// instead of registering (python-ref/verdict/fit_verdict.py reads it)
    #[arg(long, value_name = "CANDIDATES.csv", conflicts_with_all = ["method", "poses", "output", "figure", "report"])]
    candidates: Option<PathBuf>,
    /// Register the clouds at their own positions, not moved at random
    #[arg(long)]
    as_they_stand: bool,
    /// Seed of the motions
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    #[arg(long, value_name = "WHERE", default_value_t, help = input::VIEWPOINTS_HELP)]
    viewpoints: ViewpointSource,
    /// Criterion of a correct pose: indoor (15 deg, 0.3 m), outdoor (5 deg, 0.6 m), outdoor-coarse (5
    /// deg, 2 m), relative (10 deg, a twentieth of the size) [default: by the size of the source]
    #[arg(long)]
    rule: Option<SuccessCriterion>,
    /// Number of points to which each cloud is downsampled at random, 0 for all
    #[arg(long, value_name = "N", default_value_t = 0)]
    sample: usize,
    /// Use only every N-th pair of the lists
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Number of threads, 0 for all cores; never changes the poses
    #[arg(long, value_name = "T", default_value_t = 0)]
    threads: usize,
}

impl BenchmarkCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let drawn = |kind| self.figure.as_ref().map(|stem| stem.with_extension(kind));
        let (svg, png) = (drawn("svg"), drawn("png"));
        let written = [
            ("output", &self.output),
            ("candidates", &self.candidates),
            ("figure", &svg),
            ("figure", &png),
        ];
        let written = written.map(|(option, path)| (option, path.as_deref()));
        let mut inputs: Vec<_> =
            self.pairs.iter().chain(&self.poses).map(PathBuf::as_path).collect();
        outputs::check(&inputs, &written)?;
        let pairs = self.read_pairs()?;
        inputs.extend(pairs.iter().flat_map(|pair| [pair.source.as_path(), &pair.target]));
        outputs::check(&inputs, &written)?;
        let poses = self.read_external_poses(&pairs)?;
        let pairs: Vec<_> = pairs.into_iter().step_by(self.every as usize).collect();
        let settings = self.settings();
        if let Some(output) = &self.candidates {
            let written = self.with_bar("pairs", |follow| {
                benchmark::candidates::write(&pairs, settings, output, follow)
            })?;
            print(&format!("{written} poses of {} pairs\n", pairs.len()))?;
            return Ok(CommandOutcome::Trusted);
        }
        let mut rows = self.with_bar("pairs", |follow| {
            benchmark::run(&pairs, &self.method, settings, self.output.as_deref(), follow)
        })?;
        for (poses, path) in poses.iter().zip(&self.poses) {
            log_missing(poses, path, &pairs);
            rows.extend(poses.evaluate(&pairs, settings)?);
        }
        print(&report::markdown(&rows))?;
        if let Some(stem) = &self.figure {
            reliability::figure(&rows)?.save(stem)?;
        }
        if let Some(folder) = &self.report {
            self.with_bar("pages", |follow| {
                crate::report::write_benchmark(&rows, &pairs, settings, folder, self.pages, follow)
            })?;
        }
        Ok(CommandOutcome::Trusted)
    }

    /// Runs `work` on the threads of the command, under a progress bar that it moves.
    fn with_bar<T: Send>(
        &self,
        what: &'static str,
        work: impl FnOnce(&(dyn Fn(usize, usize) + Sync)) -> Result<T> + Send,
    ) -> Result<T> {
        let bar = progress(1, what);
        let follow = |done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let done = par::with_threads(self.threads, || work(&follow))??;
        bar.finish_and_clear();
        Ok(done)
    }

    /// Reads the pairs of all lists.
    fn read_pairs(&self) -> Result<Vec<Pair>> {
        let mut pairs = Vec::new();
        for path in &self.pairs {
            let own = path.parent().unwrap_or(Path::new(""));
            pairs.extend(list::read(path, self.folder.as_deref().unwrap_or(own))?);
        }
        Ok(pairs)
    }

    fn settings(&self) -> Settings {
        Settings {
            moved: !self.as_they_stand,
            seed: self.seed,
            viewpoints: self.viewpoints,
            rule: self.rule,
            points: self.sample,
        }
    }

    /// Reads the poses of other programs for the pairs of the lists.
    fn read_external_poses(&self, listed: &[Pair]) -> Result<Vec<ExternalPoses>> {
        let folder = self.folder.as_deref().or_else(|| self.pairs[0].parent());
        let read =
            |path: &PathBuf| ExternalPoses::read(path, folder.unwrap_or(Path::new("")), listed);
        self.poses.iter().map(read).collect()
    }
}

/// Reports the pairs that poses of other programs, read from `path`, leave out.
fn log_missing(poses: &ExternalPoses, path: &Path, pairs: &[Pair]) {
    for (method, missing) in poses.missing(pairs) {
        log(&format!(
            "cfreg: {}: {missing} of {} pairs have no row by {method}: they count as failed\n",
            path.display(),
            pairs.len()
        ));
    }
}
