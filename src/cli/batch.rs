//! `cfreg batch`: registration of a list of pairs, with a row of results for each.

use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use indicatif::ProgressStyle;

use super::options::MethodOptions;
use super::{CommandOutcome, input, log, outputs, progress};
use crate::batch::{self, Batch, PairList, StartMode, Summary};
use crate::cloud::ViewpointSource;
use crate::error::{Error, Result};
use crate::filter::Downsampling;
use crate::method::Pipeline;
use crate::par::Interrupt;

/// The exit status is 0 when every pair has its row, including pairs without a pose; 1 if none of
/// the poses may be used; 130 after Ctrl-C; 2 if the run could not start or write.
#[derive(Args)]
pub(super) struct BatchCommand {
    /// Pairs: CSV or Parquet with the columns source and target, files of clouds; other columns are
    /// ignored
    pairs: PathBuf,
    /// Rows in the order of the list: .csv, .jsonl or .parquet; until all are complete they are in
    /// RESULTS.part
    #[arg(short, long, value_name = "RESULTS")]
    output: PathBuf,
    /// Folder that the files of the list are relative to [default: that of the list]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Resume an interrupted run
    #[arg(long, conflicts_with = "overwrite")]
    resume: bool,
    /// Start again, and replace the files of an earlier run
    #[arg(long)]
    overwrite: bool,
    /// Memory for clouds and data computed from them, cached for later pairs, in bytes or with a unit:
    /// 512MB, 4GiB
    #[arg(long, value_name = "SIZE", default_value = "1GiB", value_parser = parse_size)]
    memory: usize,
    #[arg(long, value_name = "WHERE", default_value_t, help = input::VIEWPOINTS_HELP)]
    viewpoints: ViewpointSource,
    /// Give up a pair after this number of seconds; the set of pairs near the limit depends on the
    /// machine
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    time_limit: Option<Duration>,
    /// Add the column seconds, which differs between any two runs
    #[arg(long)]
    times: bool,
    #[command(flatten)]
    method: MethodOptions,
    #[command(flatten)]
    thinning: Downsampling,
}

impl BatchCommand {
    pub(super) fn run(&self) -> Result<CommandOutcome> {
        let mut inputs = vec![self.pairs.as_path()];
        inputs.extend(self.method.inputs());
        outputs::check(&inputs, &[("output", Some(&self.output))])?;
        let (method, thinning) = self.method.for_batch().with_voxel(&self.thinning)?;
        let own = self.pairs.parent().unwrap_or(Path::new(""));
        let list = PairList::read(&self.pairs, self.folder.as_deref().unwrap_or(own))?;
        let batch = self.batch(&method, thinning);
        handle_ctrl_c(batch.interrupt.clone())?;
        batch::install_panic_hook();
        self.outcome(self.run_with_bar(&batch, &list))
    }

    /// Returns the batch with the settings of the command.
    fn batch<'a>(&self, method: &'a Pipeline, thinning: Downsampling) -> Batch<'a> {
        let mut batch = Batch::new(method, method);
        batch.viewpoints = self.viewpoints;
        batch.keep_no_returns = self.method.keep_no_returns;
        batch.thinning = thinning;
        batch.threads = self.method.threads.unwrap_or(0);
        batch.memory = self.memory;
        batch.time_limit = self.time_limit;
        batch.times = self.times;
        batch.start = match (self.resume, self.overwrite) {
            (true, _) => StartMode::Resume,
            (_, true) => StartMode::Overwrite,
            _ => StartMode::Fresh,
        };
        batch
    }

    fn run_with_bar(&self, batch: &Batch<'_>, list: &PairList) -> Result<Summary> {
        let bar = progress(list.len() as u64, "pairs");
        let style = "{msg} {wide_bar} {pos}/{len} {per_sec} {eta}";
        bar.set_style(ProgressStyle::with_template(style).unwrap_or(ProgressStyle::default_bar()));
        let mut begun = false;
        let follow = |done: usize, _| {
            bar.set_position(done as u64);
            if !begun {
                // Pairs of an earlier run do not count in the rate.
                bar.reset_eta();
                begun = true;
            }
        };
        let done = batch.run_with(list, &self.output, follow);
        bar.finish_and_clear();
        done
    }

    /// Reports how the run ended, and returns the outcome of the command.
    fn outcome(&self, done: Result<Summary>) -> Result<CommandOutcome> {
        let output = self.output.display();
        match done {
            Ok(done) => {
                if done.resumed == done.pairs {
                    log(&format!("cfreg: {output} is complete: nothing to resume\n"));
                }
                if done.damaged > 0 {
                    log(&format!(
                        "cfreg: {} lines of {output}.part were modified, or belong to other pairs: \
                         these pairs were registered again\n",
                        done.damaged
                    ));
                }
                let (pairs, trusted, errors) = (done.pairs, done.trusted, done.errors);
                log(&format!("{pairs} pairs: {trusted} poses to use, {errors} without a pose\n"));
                Ok(if trusted > 0 { CommandOutcome::Trusted } else { CommandOutcome::Doubted })
            }
            Err(Error::Interrupted) => {
                log(&format!(
                    "cfreg: interrupted; {output}.part has the pairs that are done: continue with --resume\n"
                ));
                Err(Error::Interrupted)
            }
            Err(error) => Err(error),
        }
    }
}

/// The first Ctrl-C (or SIGTERM) ends the work at its next step, the second at once.
fn handle_ctrl_c(interrupt: Interrupt) -> Result<()> {
    let end = move || match interrupt.is_requested() {
        true => std::process::exit(130),
        false => interrupt.request(),
    };
    ctrlc::set_handler(end).map_err(|error| Error::io("signals", std::io::Error::other(error)))
}

/// Parses a number of bytes, with a unit or without: `512MB`, `4GiB`.
fn parse_size(text: &str) -> std::result::Result<usize, String> {
    const UNITS: [(&str, f64); 9] = [
        ("KiB", 1024.0),
        ("MiB", 1048576.0),
        ("GiB", 1073741824.0),
        ("TiB", 1099511627776.0),
        ("kB", 1e3),
        ("MB", 1e6),
        ("GB", 1e9),
        ("TB", 1e12),
        ("B", 1.0),
    ];
    let find = |(name, unit): (&str, f64)| {
        let split = text.len().checked_sub(name.len())?;
        let end = text.get(split..).filter(|end| end.eq_ignore_ascii_case(name))?;
        Some((text.len() - end.len(), unit))
    };
    let (end, unit) = UNITS.into_iter().find_map(find).unwrap_or((text.len(), 1.0));
    match text[..end].trim().parse::<f64>() {
        Ok(count) if count.is_finite() && count >= 0.0 => Ok((count * unit) as usize),
        _ => Err("must be a number of bytes, or one with kB, MB, GB, KiB, MiB or GiB".into()),
    }
}

/// Parses a time above 0.
fn parse_seconds(text: &str) -> std::result::Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().filter(|&seconds| seconds > 0.0);
    seconds
        .and_then(|seconds| Duration::try_from_secs_f64(seconds).ok())
        .ok_or_else(|| "must be a number of seconds above 0".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        assert_eq!(parse_size("1024"), Ok(1024));
        assert_eq!(
            (parse_size("1.5GB"), parse_size("2 MiB"), parse_size("0")),
            (Ok(1_500_000_000), Ok(2 << 20), Ok(0))
        );
        for wrong in ["", "GB", "-1", "1XB", "nan", "inf"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
        assert!(
            parse_seconds("0").is_err()
                && parse_seconds("1e400").is_err()
                && parse_seconds("0.5").is_ok()
        );
    }
}
