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
    /// Lists: CSV with the columns source, target, t00 to t33 and, if known, dataset, overlap
    /// and units (m, cm, mm); or gt.log of 3DMatch
    #[arg(required = true)]
    pairs: Vec<PathBuf>,
    /// Folder that the files of CSV lists are relative to [default: that of each list]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Method, refinements after +: cf-multiscale+gicp; may be given more than once
    #[arg(long, value_name = "METHOD", default_value = "consensus")]
    method: Vec<String>,
    /// Poses that other programs found, to be judged beside: CSV with the columns method, source,
    /// target (as in the list), t00 to t33 and, if known, seconds and accepted; a row of no
    /// pair that is listed is refused, a pair without a row counts as failed
    #[arg(long, value_name = "POSES.csv")]
    poses: Vec<PathBuf>,
    /// Rows as CSV; a run that was cut short goes on from what is there
    #[arg(long, value_name = "ROWS.csv")]
    output: Option<PathBuf>,
    /// Writes STEM.svg and STEM.png: the probabilities that verdicts told, and the share that was
    /// right
    #[arg(long, value_name = "STEM")]
    figure: Option<PathBuf>,
    /// Writes index.html into this folder: a table of the rows, the worst first, that opens pages
    /// of pairs with the true pose beside; these are registered once more
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
    /// Rows, the worst first, that have a page of their own
    #[arg(long, value_name = "N", default_value_t = 20, requires = "report")]
    pages: usize,
    /// Instead of registering: every pose that consensus settles, with its evidence and whether it
    /// is right, as CSV (python-ref/verdict/fit_verdict.py reads it)
    #[arg(long, value_name = "CANDIDATES.csv", conflicts_with_all = ["method", "poses", "output", "figure", "report"])]
    candidates: Option<PathBuf>,
    /// Register the clouds where they stand, not moved at random
    #[arg(long)]
    as_they_stand: bool,
    /// Seed of the motions
    #[arg(long, value_name = "S", default_value_t = 0)]
    seed: u64,
    #[arg(long, value_name = "WHERE", default_value_t, help = input::VIEWPOINTS_HELP)]
    viewpoints: ViewpointSource,
    /// When a pose is right: indoor (15 deg, 0.3 m), outdoor (5 deg, 0.6 m), outdoor-coarse (5
    /// deg, 2 m), relative (10 deg, a twentieth of the size) [default: by the size of the source]
    #[arg(long)]
    rule: Option<SuccessCriterion>,
    /// Points that each cloud is thinned to at random, 0 for all
    #[arg(long, value_name = "N", default_value_t = 0)]
    sample: usize,
    /// Every N-th pair of the lists alone
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Threads, 0 for all cores; never changes the poses
    #[arg(long, value_name = "T", default_value_t = 0)]
    threads: usize,
}

impl BenchmarkCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let lists: Vec<_> = self.pairs.iter().map(PathBuf::as_path).collect();
        let drawn = |kind| self.figure.as_ref().map(|stem| stem.with_extension(kind));
        let (svg, png) = (drawn("svg"), drawn("png"));
        let written = [
            ("output", &self.output),
            ("candidates", &self.candidates),
            ("figure", &svg),
            ("figure", &png),
        ];
        let written = written.map(|(option, path)| (option, path.as_deref()));
        let mut inputs = lists.clone();
        inputs.extend(self.poses.iter().map(PathBuf::as_path));
        outputs::check(&inputs, &written)?;
        let mut pairs = Vec::new();
        for path in lists {
            let own = path.parent().unwrap_or(Path::new(""));
            pairs.extend(list::read(path, self.folder.as_deref().unwrap_or(own))?);
        }
        inputs.extend(pairs.iter().flat_map(|pair| [pair.source.as_path(), &pair.target]));
        outputs::check(&inputs, &written)?;
        let poses = self.read_external_poses(&pairs)?;
        let pairs: Vec<_> = pairs.into_iter().step_by(self.every as usize).collect();
        let settings = Settings {
            moved: !self.as_they_stand,
            seed: self.seed,
            viewpoints: self.viewpoints,
            rule: self.rule,
            points: self.sample,
        };
        let bar = progress(1, "pairs");
        let follow = |done, all| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        if let Some(output) = &self.candidates {
            let written = par::with_threads(self.threads, || {
                benchmark::candidates::write(&pairs, settings, output, follow)
            })??;
            bar.finish_and_clear();
            print(&format!("{written} poses of {} pairs\n", pairs.len()))?;
            return Ok(CommandOutcome::Trusted);
        }
        let mut rows = par::with_threads(self.threads, || {
            benchmark::run(&pairs, &self.method, settings, self.output.as_deref(), follow)
        })??;
        bar.finish_and_clear();
        for (poses, path) in poses.iter().zip(&self.poses) {
            for (method, missing) in poses.missing(&pairs) {
                log(&format!(
                    "cfreg: {}: {missing} of {} pairs have no row by {method}: they count as \
                     failed\n",
                    path.display(),
                    pairs.len()
                ));
            }
            rows.extend(poses.evaluate(&pairs, settings)?);
        }
        print(&report::markdown(&rows))?;
        if let Some(stem) = &self.figure {
            reliability::figure(&rows)?.save(stem)?;
        }
        if let Some(folder) = &self.report {
            let bar = progress(1, "pages");
            let follow = |done, all| {
                bar.set_length(all as u64);
                bar.set_position(done as u64);
            };
            par::with_threads(self.threads, || {
                crate::report::write_benchmark(&rows, &pairs, settings, folder, self.pages, follow)
            })??;
            bar.finish_and_clear();
        }
        Ok(CommandOutcome::Trusted)
    }

    /// What other programs found for the pairs of the lists.
    fn read_external_poses(&self, listed: &[Pair]) -> Result<Vec<ExternalPoses>> {
        let folder = self.folder.as_deref().or_else(|| self.pairs[0].parent());
        let read =
            |path: &PathBuf| ExternalPoses::read(path, folder.unwrap_or(Path::new("")), listed);
        self.poses.iter().map(read).collect()
    }
}
