//! `--report` and `--figure`: a page and a picture of a registration.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::error::{Error, Result};
use crate::io;
use crate::report::PairReport;

#[derive(Args, Clone)]
pub(super) struct ReportOptions {
    /// Write a page with the verdict, its reasons, and the clouds before and after registration; one
    /// file, which needs no network
    #[arg(long, value_name = "OUT.html")]
    pub(super) report: Option<PathBuf>,
    /// Write a picture of the clouds before and after registration, .png or .svg
    #[arg(long, value_name = "OUT.png")]
    pub(super) figure: Option<PathBuf>,
}

impl ReportOptions {
    /// Returns whether either is asked for.
    pub(super) fn is_requested(&self) -> bool {
        self.report.is_some() || self.figure.is_some()
    }

    /// Returns the files to be written, by their options.
    pub(super) fn outputs(&self) -> [(&'static str, Option<&Path>); 2] {
        [("report", self.report.as_deref()), ("figure", self.figure.as_deref())]
    }

    /// Refuses a figure of an unknown format.
    pub(super) fn check(&self) -> Result<()> {
        self.figure.as_deref().map_or(Ok(()), |path| figure_format(path).map(|_| ()))
    }

    pub(super) fn write(&self, pair: &PairReport<'_>) -> Result<()> {
        if let Some(path) = &self.report {
            io::write_bytes(path, pair.html()?.as_bytes())?;
        }
        if let Some(path) = &self.figure {
            let figure = pair.figure()?;
            match figure_format(path)? {
                FigureFormat::Svg => io::write_bytes(path, figure.svg()?.as_bytes())?,
                FigureFormat::Png => io::write_bytes(path, &figure.png()?)?,
            }
        }
        Ok(())
    }
}

enum FigureFormat {
    Png,
    Svg,
}

fn figure_format(path: &Path) -> Result<FigureFormat> {
    let end = path.extension().map(|end| end.to_string_lossy().to_lowercase());
    match end.as_deref() {
        Some("png") => Ok(FigureFormat::Png),
        Some("svg") => Ok(FigureFormat::Svg),
        _ => Err(Error::config("figure", path.display(), "must end in .png or .svg")),
    }
}
