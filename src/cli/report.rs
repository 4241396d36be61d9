//! `cfreg report`: pages of saved results.

use std::path::{Path, PathBuf};

use clap::Args;

use super::report_options::ReportOptions;
use super::{CommandOutcome, input, log, outputs, progress};
use crate::batch;
use crate::cloud::ViewpointSource;
use crate::error::{Error, Result};
use crate::report::{self, BatchReport, SavedResult};

#[derive(Args)]
pub(super) struct ReportCommand {
    /// Output of `cfreg register --json`, for a page; or rows of `cfreg batch` (.csv, .jsonl, .parquet
    /// or a folder of these), for a table, the worst first, with links to pages of pairs. Clouds are
    /// searched at their paths, then relative to the folder of this file
    result: PathBuf,
    /// The page, or the folder of the table [default: the result's name with .html, or with -report
    /// instead of its extension]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Also write a picture of the clouds before and after registration, .png or .svg
    #[arg(long, value_name = "OUT.png")]
    figure: Option<PathBuf>,
    /// Folder that the files of rows are relative to [default: that of the rows]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Number of rows, the worst first, with a page of their own
    #[arg(long, value_name = "N", default_value_t = 100)]
    pages: usize,
    #[arg(long, value_name = "WHERE", default_value_t, help = input::VIEWPOINTS_HELP)]
    viewpoints: ViewpointSource,
}

impl ReportCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let end = self.result.extension().map(|end| end.to_string_lossy().to_lowercase());
        let rows = matches!(end.as_deref(), Some("csv" | "jsonl" | "parquet"));
        if rows || self.result.is_dir() { self.write_table() } else { self.write_page() }
    }

    fn write_table(&self) -> Result<CommandOutcome> {
        if let Some(figure) = &self.figure {
            let rule = "shows one result, and these are rows: leave it out";
            return Err(Error::config("figure", figure.display(), rule));
        }
        let rows = batch::results::read(&self.result)?;
        let stem = self.result.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let beside = || self.result.with_file_name(format!("{stem}-report"));
        let output = self.output.clone().unwrap_or_else(beside);
        let own = self.result.parent().unwrap_or(Path::new(""));
        let bulk = BatchReport {
            clouds: self.folder.as_deref().unwrap_or(own),
            output: &output,
            pages: self.pages,
            viewpoints: self.viewpoints,
        };
        let bar = progress(1, "pages");
        let made = bulk.write(&rows, |done, all| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        })?;
        bar.finish_and_clear();
        let index = output.join("index.html");
        log(&format!("cfreg: {} rows, {made} pages: {}\n", rows.len(), index.display()));
        Ok(CommandOutcome::Trusted)
    }

    fn write_page(&self) -> Result<CommandOutcome> {
        let output = self.output.clone().unwrap_or_else(|| self.result.with_extension("html"));
        if self.output.is_none() {
            outputs::check_default_path("output", &output, report::is_report_page)?;
        }
        let pictures = ReportOptions { report: Some(output), figure: self.figure.clone() };
        pictures.check()?;
        let kept = SavedResult::read(&self.result)?;
        let [source, target] = kept.files()?.map(|file| self.find_cloud(file));
        let (source, target) = (source?, target?);
        outputs::check(&[&self.result, &source, &target], &pictures.outputs())?;
        let bar = progress(0, "drawing");
        let [source, target] = input::read_pair(
            [&source, &target],
            &kept.thinning(),
            kept.viewpoints(),
            kept.keeps_no_returns(),
        )?;
        pictures.write(&kept.pair(&source, &target)?)?;
        bar.finish_and_clear();
        Ok(CommandOutcome::Trusted)
    }

    /// Finds a cloud that the result names.
    fn find_cloud(&self, named: &Path) -> Result<PathBuf> {
        let beside = self.result.parent().unwrap_or(Path::new("")).join(named);
        let places = [named.to_path_buf(), beside];
        places.into_iter().find(|place| place.is_file()).ok_or_else(|| {
            let what = format!(
                "names the cloud {}, which is neither at that path nor relative to this file: restore \
                 it, or register again with --report",
                named.display()
            );
            Error::parse(&self.result, None, what)
        })
    }
}
