//! The program `cfreg-paper`: `reproduce` runs the experiments, `accuracy` runs the test of Table
//! II on any cloud.

mod accuracy_command;
mod overlap_command;
mod reproduce;

use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;

use cfreg::Error;
use cfreg_paper::scaling::Meter;
use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use peak_alloc::PeakAlloc;

/// Counts allocations, so that `reproduce` can report the memory of a method. Resident memory is
/// not suitable: it includes memory that an earlier run has freed.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// The experiments of the paper on correspondence-free registration in one step.
#[derive(Parser)]
#[command(name = "cfreg-paper", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// The experiments of the paper: every trial, and its tables beside the printed ones
    Reproduce(reproduce::ReproduceCommand),
    /// The accuracy test of the paper on a cloud of your own (Table II)
    Accuracy(accuracy_command::AccuracyCommand),
    /// One step against overlap: pairs of real scans, moved at random, by methods that solve once
    Overlap(overlap_command::OverlapCommand),
}

fn main() -> ExitCode {
    let start = || {
        MEMORY.reset_peak_usage();
        MEMORY.current_usage()
    };
    let meter = Meter { start, peak: || MEMORY.peak_usage() };
    let done = match Arguments::parse().command {
        Command::Reproduce(command) => command.run(meter).map(|()| true),
        Command::Accuracy(command) => command.run(),
        Command::Overlap(command) => command.run().map(|()| true),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            log(&format!("cfreg-paper: {error}\n"));
            ExitCode::from(2)
        }
    }
}

/// Writes `text` to stderr.
fn log(text: &str) {
    let _ = io::stderr().write_all(text.as_bytes());
}

/// Writes `text` to stdout.
fn print(text: &str) -> cfreg::Result<()> {
    let mut out = io::stdout();
    let done = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    done.map_err(|error| Error::io("standard output", error))
}

/// Creates a progress bar on stderr over `length` steps; hidden if stderr is no terminal.
fn progress(length: u64, name: &'static str) -> ProgressBar {
    let target = match io::stderr().is_terminal() {
        true => ProgressDrawTarget::stderr(),
        false => ProgressDrawTarget::hidden(),
    };
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
    ProgressBar::with_draw_target(Some(length), target)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        .with_message(name)
}
