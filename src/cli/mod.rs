//! The command line: translates words into calls, decides nothing.
//!
//! Results go to stdout, messages to stderr. Exit codes: 0 a result that may be used, 1 a result with
//! warnings, 2 no result, or none that could be written, 130 interrupted by Ctrl-C.

mod apply;
mod batch;
mod benchmark;
mod clouds;
mod demo;
mod doctor;
mod evaluate;
mod given;
mod graph;
mod input;
mod manual;
mod options;
mod outputs;
mod pairs;
mod register;
mod report;
mod report_options;

use std::io::{self, IsTerminal, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::{Parser, Subcommand};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::error::{Error, Result};

/// Rigid point-cloud registration without correspondences and without an initial guess.
///
/// Exit status: 0 a result that may be used, 1 a result with warnings (it is written all the
/// same), 2 no result.
#[derive(Parser)]
#[command(name = "cfreg", version, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Find the pose that maps one cloud into the frame of another
    Register(register::RegisterCommand),
    /// Write pages of saved results: of the output of register --json, or of rows as a table
    Report(report::ReportCommand),
    /// Print points, bounds, resolution and columns of files
    Info(clouds::InfoCommand),
    /// Write a cloud in another format, downsampled or moved if asked for
    Convert(clouds::ConvertCommand),
    /// Move whole files by a pose: everything but coordinates and normals stays
    Apply(apply::ApplyCommand),
    /// Evaluate how well two clouds overlap under a given pose
    Evaluate(evaluate::EvaluateCommand),
    /// Register two samples of a built-in shape whose true pose is known
    Demo(demo::DemoCommand),
    /// Run methods over a list of pairs with known poses: recall, errors, times, verdicts
    Benchmark(benchmark::BenchmarkCommand),
    /// Build a list of pairs: consecutive scans, scans and a map, scans near each other
    Pairs(pairs::PairsCommand),
    /// Register a list of pairs, one row of results a pair; an interrupted run can resume
    Batch(batch::BatchCommand),
    /// Export the accepted poses among the results of a list as a pose graph (g2o)
    Graph(graph::GraphCommand),
    /// Print versions, instructions, processors and memory, for a report of a fault
    Doctor,
    /// Print the completions of a shell: cfreg completions bash > FILE
    Completions(manual::CompletionsCommand),
    /// Write the manual pages of all commands to a folder
    Man(manual::ManCommand),
    /// Print the licences of all software that is compiled into this program
    Licenses,
}

/// Crates and their licences; `tests/it/licenses.rs` compares it with `Cargo.lock`.
const THIRD_PARTY: &str = include_str!("../../THIRD-PARTY.txt");

/// The outcome of a command that has a result: its exit code.
#[derive(Clone, Copy, PartialEq, Eq)]
enum CommandOutcome {
    Trusted,
    Doubted,
}

/// Whether the process was started without a standard output.
static STDOUT_CLOSED: AtomicBool = AtomicBool::new(false);

/// Runs the command line of this process; `output` is whether it was started with a standard
/// output. Rust opens /dev/null if there is none, and printed results would be lost.
pub fn main(output: bool) -> ExitCode {
    STDOUT_CLOSED.store(!output, Ordering::Relaxed);
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) if error.use_stderr() => error.exit(),
        // Help, or the version.
        Err(help) => {
            return exit_code(write_stdout(|| help.print()).map(|()| CommandOutcome::Trusted));
        }
    };
    exit_code(match arguments.command {
        Command::Register(command) => command.run(),
        Command::Report(command) => command.run(),
        Command::Info(command) => command.run(),
        Command::Convert(command) => command.run(),
        Command::Apply(command) => command.run(),
        Command::Evaluate(command) => command.run(),
        Command::Demo(command) => command.run(),
        Command::Benchmark(command) => command.run(),
        Command::Pairs(command) => command.run(),
        Command::Batch(command) => command.run(),
        Command::Graph(command) => command.run(),
        Command::Doctor => doctor::run(),
        Command::Completions(command) => command.run(),
        Command::Man(command) => command.run(),
        Command::Licenses => print(THIRD_PARTY).map(|()| CommandOutcome::Trusted),
    })
}

fn exit_code(outcome: Result<CommandOutcome>) -> ExitCode {
    match outcome {
        Ok(CommandOutcome::Trusted) => ExitCode::SUCCESS,
        Ok(CommandOutcome::Doubted) => ExitCode::from(1),
        // As shells count it: 128 and the number of the signal.
        Err(Error::Interrupted) => ExitCode::from(130),
        Err(error) => {
            log(&format!("cfreg: {error}\n"));
            ExitCode::from(2)
        }
    }
}

/// Writes `text` to stderr. A message that cannot be written is no reason to lose the result.
fn log(text: &str) {
    let _ = io::stderr().write_all(text.as_bytes());
}

/// Writes `text` to stdout.
fn print(text: &str) -> Result<()> {
    write_stdout(|| io::stdout().write_all(text.as_bytes()))
}

/// Calls `write`, which writes to stdout, and checks that all was written.
fn write_stdout(write: impl FnOnce() -> io::Result<()>) -> Result<()> {
    let closed = "closed before all was printed: the result is lost";
    if STDOUT_CLOSED.load(Ordering::Relaxed) {
        return Err(Error::io("standard output", io::Error::other(closed)));
    }
    let done = write().and_then(|()| io::stdout().flush());
    done.map_err(|error| match error.kind() {
        io::ErrorKind::BrokenPipe => Error::io("standard output", io::Error::other(closed)),
        _ => Error::io("standard output", error),
    })
}

/// Writes `value` to stdout as indented JSON.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).map_err(|error| {
        Error::io("standard output", io::Error::new(io::ErrorKind::InvalidData, error))
    })?;
    print(&(text + "\n"))
}

/// Formats a 4×4 matrix as four lines with all digits, as `evaluate --transform` reads it.
fn matrix_text(matrix: &[[f64; 4]; 4]) -> String {
    // Adding zero turns -0 into 0.
    let words = matrix.map(|row| row.map(|x| format!("{:?}", x + 0.0)));
    let width = words.as_flattened().iter().map(String::len).max().unwrap_or(0);
    let line = |row: &[String; 4]| row.each_ref().map(|x| format!("{x:>width$}")).join(" ") + "\n";
    words.iter().map(line).collect()
}

/// Creates a progress bar on stderr over `length` steps (0: a spinner); hidden if stderr is no
/// terminal, and in the first second.
fn progress(length: u64, what: &'static str) -> ProgressBar {
    let target = if io::stderr().is_terminal() {
        ProgressDrawTarget::stderr()
    } else {
        ProgressDrawTarget::hidden()
    };
    let bar = if length == 0 {
        let style = ProgressStyle::with_template("{spinner} {msg} {elapsed}");
        ProgressBar::with_draw_target(None, target)
            .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
    } else {
        let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {eta}");
        ProgressBar::with_draw_target(Some(length), target)
            .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
    };
    let bar = bar.with_message(what);
    // A spinner must not appear for short work.
    if length == 0 {
        let late = bar.downgrade();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_secs(1));
            if let Some(bar) = late.upgrade() {
                bar.enable_steady_tick(Duration::from_millis(100));
            }
        });
    }
    bar
}
