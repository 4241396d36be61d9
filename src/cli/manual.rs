//! Completions for shells, and manual pages: both are made from the arguments themselves.

use std::path::PathBuf;

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use super::{Arguments, CommandOutcome, print};
use crate::error::{Error, Result};

#[derive(Args)]
pub(super) struct CompletionsCommand {
    /// Shell that reads them
    shell: Shell,
}

impl CompletionsCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Arguments::command(), "cfreg", &mut script);
        print(&String::from_utf8_lossy(&script))?;
        Ok(CommandOutcome::Trusted)
    }
}

#[derive(Args)]
pub(super) struct ManCommand {
    /// Folder for cfreg.1 and a page for each command; it is made if it is missing
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl ManCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let failed = |error| Error::io(&self.folder, error);
        std::fs::create_dir_all(&self.folder).map_err(failed)?;
        clap_mangen::generate_to(Arguments::command(), &self.folder).map_err(failed)?;
        Ok(CommandOutcome::Trusted)
    }
}
