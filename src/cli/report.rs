//! `cfreg report`: the page of a result that was kept.

use std::path::{Path, PathBuf};

use clap::Args;

use super::pictured::Pictures;
use super::{Outcome, outputs, progress, reading};
use crate::error::{Error, Result};
use crate::report::Kept;

#[derive(Args)]
pub(super) struct Report {
    /// What `cfreg register --json` printed. Its clouds are looked for where the command found
    /// them: from here, then from beside this file
    result: PathBuf,
    /// The page [default: the name of the result with .html]
    #[arg(short, long, value_name = "OUT.html")]
    output: Option<PathBuf>,
    /// Also write a picture of the clouds before and after, by its extension .png or .svg
    #[arg(long, value_name = "OUT.png")]
    figure: Option<PathBuf>,
}

impl Report {
    pub(super) fn run(&self) -> Result<Outcome> {
        let output = self.output.clone().unwrap_or_else(|| self.result.with_extension("html"));
        let pictures = Pictures { report: Some(output), figure: self.figure.clone() };
        pictures.check()?;
        let kept = Kept::read(&self.result)?;
        let [source, target] = kept.files()?.map(|file| self.found(file));
        let (source, target) = (source?, target?);
        outputs::check(&[&self.result, &source, &target], &pictures.outputs())?;
        let bar = progress(0, "drawing");
        let [source, target] =
            reading::read_pair([&source, &target], &kept.thinning(), kept.viewpoints())?;
        pictures.write(&kept.pair(&source, &target)?)?;
        bar.finish_and_clear();
        Ok(Outcome::Trusted)
    }

    /// Where a cloud is that the result names.
    fn found(&self, named: &Path) -> Result<PathBuf> {
        let beside = self.result.parent().unwrap_or(Path::new("")).join(named);
        let places = [named.to_path_buf(), beside];
        places.into_iter().find(|place| place.is_file()).ok_or_else(|| {
            let what = format!(
                "names the cloud {}, which is neither there nor beside this file: put it back, or \
                 register again with --report",
                named.display()
            );
            Error::parse(&self.result, None, what)
        })
    }
}
