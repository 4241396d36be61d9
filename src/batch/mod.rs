//! Batch registration: a list of pairs, one row of results for each.
//!
//! Pairs run in parallel, each on one thread. Each cloud is read once, and the data that a method
//! computes from it alone is computed once; both are cached within a memory budget. Rows go to a
//! journal beside the output (`RESULTS.csv.part`) as they come, and into the output, in the order
//! of the list, at the end. A run that was interrupted at any moment resumes from its journal and
//! ends with the same bytes as an uninterrupted one. The bytes are also independent of the number
//! of threads. Only pairs close to a [time limit](Batch::time_limit) depend on the machine.
//!
//! Memory holds the clouds, and for each pair 24 bytes; the names of files once each.

mod cell_reader;
mod cloud_cache;
mod columns;
mod deadlines;
mod graph;
mod hash;
mod journal;
mod list;
mod output;
mod pairing;
#[cfg(feature = "parquet")]
mod parquet;
pub mod results;
mod resume;
mod row;
mod run_file;
mod scan_positions;

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::{Value, json};

pub use crate::par::install_panic_hook;
pub use columns::Column;
pub use graph::RowGraph;
pub use list::PairList;
pub use pairing::{radius_pairs, sequential_pairs};
pub use row::Row;
pub(crate) use row::symmetric_from_triangle;
pub use scan_positions::ScanPositions;

pub use crate::filter::{self, Downsampling};

use self::cloud_cache::CloudCache;
use self::deadlines::Deadlines;
use self::hash::Fnv1a;
use self::journal::Journal;
use self::output::ResultsFormat;
use crate::cloud::{PointCloud, ViewpointSource};
use crate::error::{Error, Result};
use crate::io;
use crate::method::{Register, Registration};
use crate::par::{self, Interrupt};

/// Interval of the checks of time limits and interrupts. Chosen by hand.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// The action for the output or journal of an earlier run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartMode {
    /// Refuse to begin.
    #[default]
    Fresh,
    /// Resume from its journal. Begin if there is no journal and no output; do nothing if there is
    /// an output without a journal, which is complete. An output of another list or of other
    /// settings is refused: Parquet stores the inputs of its run inside, CSV and JSON Lines in a
    /// file beside them (`RESULTS.csv.run.json`), without which they are refused too.
    Resume,
    /// Begin anew. An existing output is replaced at the end.
    Overwrite,
}

/// The settings of a batch run.
///
/// ```
/// use cfreg::batch::{Batch, PairList};
/// use cfreg::{cloud::shape::boulder, io, method::{Pipeline, Consensus}};
/// # let folder = tempfile::tempdir().unwrap();
/// # let folder = folder.path();
/// for seed in 0..3 {
///     io::write(folder.join(format!("{seed}.ply")), &boulder().sample(500, seed)?)?;
/// }
/// let list = PairList::new(folder, [["0.ply", "1.ply"], ["1.ply", "2.ply"], ["2.ply", "none.ply"]]);
/// let method: Pipeline = Pipeline::new("cf".parse()?, vec!["icp".parse()?])?;
/// let done = Batch::new(&method, &method).run(&list, &folder.join("poses.csv"))?;
/// assert_eq!((done.pairs, done.errors), (3, 1));
/// # Ok::<(), cfreg::Error>(())
/// ```
pub struct Batch<'a> {
    method: &'a dyn Register,
    settings: Value,
    /// Clouds in memory, by their names in the list; all other names are files.
    pub in_memory: HashMap<String, Arc<PointCloud>>,
    /// Source of the sensor viewpoints; by default the clouds.
    pub viewpoints: ViewpointSource,
    /// Whether rows of files that mark measurements without a return are kept
    /// ([`crate::filter::find_no_returns`]); by default they are removed.
    pub keep_no_returns: bool,
    /// How clouds are downsampled; not at all by default.
    pub thinning: Downsampling,
    /// Pairs that run in parallel, 0 (the default) for the number of cores.
    pub threads: usize,
    /// Bytes of clouds, and of data computed from them alone, that are cached for later pairs, in
    /// addition to those in use; default 1 GiB. More helps if pairs of a cloud are far apart in the
    /// list.
    pub memory: usize,
    /// Time after which a pair is given up, including the reading of its clouds; its row has an
    /// `error`. None by default. Near the limit the set of these pairs depends on the machine.
    pub time_limit: Option<Duration>,
    /// Whether the results have the column `seconds`. Off by default: it differs between any two
    /// runs.
    pub times: bool,
    /// The action for the output or journal of an earlier run.
    pub start: StartMode,
    /// Ends the run when it is requested, with [`Error::Interrupted`]; the journal is kept. The
    /// interrupt of the caller has the same effect.
    pub interrupt: Interrupt,
}

/// The result of a batch run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Summary {
    /// Pairs of the list.
    pub pairs: usize,
    /// Pairs that this run kept from an earlier one; all, if there was nothing left to do.
    pub resumed: usize,
    /// Lines of the journal that were modified, or are of pairs that the list does not have; their
    /// pairs were done again.
    pub damaged: usize,
    /// Pairs whose pose may be used ([`Row::is_usable`]).
    pub trusted: usize,
    /// Pairs without a pose.
    pub errors: usize,
}

impl Summary {
    fn add_row(&mut self, row: &Row) {
        self.trusted += usize::from(row.is_usable());
        self.errors += usize::from(row.error.is_some());
    }
}

impl<'a> Batch<'a> {
    /// Creates a run of this method; `settings` are its settings, which a resumed run compares.
    pub fn new(method: &'a dyn Register, settings: &impl Serialize) -> Self {
        Batch {
            method,
            settings: serde_json::to_value(settings).unwrap_or_default(),
            in_memory: HashMap::new(),
            viewpoints: ViewpointSource::default(),
            keep_no_returns: false,
            thinning: Downsampling::default(),
            threads: 0,
            memory: 1 << 30,
            time_limit: None,
            times: false,
            start: StartMode::Fresh,
            interrupt: Interrupt::default(),
        }
    }

    /// Registers every pair of `list` and writes the [rows](Row) to `output`, by its extension
    /// `.csv`, `.jsonl` or `.parquet`.
    ///
    /// # Errors
    /// As [`run_with`](Self::run_with).
    pub fn run(&self, list: &PairList, output: &Path) -> Result<Summary> {
        self.run_with(list, output, |_, _| ())
    }

    /// Registers every pair as [`run`](Self::run); `progress` is called with the numbers of pairs
    /// done and of all pairs.
    ///
    /// # Errors
    /// [`Error::Config`] for an output of another kind, for the output or journal of an earlier run
    /// ([`StartMode`]), for a journal of another list or other settings, for an output that is the
    /// list or one of its clouds, and for files beside it (`RESULTS.part`, `RESULTS.run.json`) that
    /// no run wrote; [`Error::Io`] of journal and output; [`Error::Interrupted`]. A pair that
    /// cannot be read or registered is a row.
    pub fn run_with(
        &self,
        list: &PairList,
        output: &Path,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<Summary> {
        let format = ResultsFormat::from_path(output)?;
        self.check()?;
        output::check(output, format, list)?;
        let (path, header) = (Journal::path_for(output), self.header(list));
        if self.is_complete(output, &path)? {
            return resume::summarize_complete(output, format, list, &header);
        }
        let resume = self.start == StartMode::Resume;
        let mut journal = Journal::open(&path, &header, list, resume)?;
        let resumed = journal.done_count();
        progress(resumed, list.len());
        self.register_pairs(list, journal.missing_indices(), |row| {
            journal.add(&row)?;
            progress(journal.done_count(), list.len());
            Ok(())
        })?;
        journal.sync(Duration::ZERO)?;
        let damaged = journal.damaged_count();
        let mut summary = Summary { pairs: list.len(), resumed, damaged, ..Summary::default() };
        let counted =
            journal.rows()?.inspect(|row| row.iter().for_each(|row| summary.add_row(row)));
        format.write(output, counted, self.times, &header)?;
        journal.remove()?;
        Ok(summary)
    }

    /// Registers every pair of `list`, and returns the rows, in the order of the list, instead of
    /// writing them; `progress` is called with the numbers of pairs done and of all pairs.
    ///
    /// # Errors
    /// [`Error::Config`] for invalid settings; [`Error::Interrupted`].
    pub fn rows(
        &self,
        list: &PairList,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<Vec<Row>> {
        self.check()?;
        progress(0, list.len());
        let mut rows = vec![Row::default(); list.len()];
        let mut done = 0;
        self.register_pairs(list, (0..list.len()).collect(), |row| {
            let index = row.index;
            rows[index] = row;
            done += 1;
            progress(done, list.len());
            Ok(())
        })?;
        Ok(rows)
    }

    /// Refuses settings that would make every row an error.
    fn check(&self) -> Result<()> {
        par::check_threads(self.threads)?;
        self.thinning.validate()
    }

    /// Checks the output and journal of an earlier run; returns whether the output is complete.
    fn is_complete(&self, output: &Path, journal: &Path) -> Result<bool> {
        let refuse = |rule: String| Err(Error::config("output", output.display(), rule));
        if output.exists() && !output.is_file() {
            return refuse("is not a regular file".into());
        }
        match (self.start, output.exists(), journal.exists()) {
            (StartMode::Fresh, _, true) => refuse(format!(
                "an earlier run has left {}: go on from it with --resume, or start anew with \
                 --overwrite",
                journal.display()
            )),
            (StartMode::Fresh, true, false) => {
                refuse("is there already: replace it with --overwrite".into())
            }
            (StartMode::Resume, true, false) => Ok(true),
            _ => Ok(false),
        }
    }

    /// Returns the inputs that rows depend on: a journal with another header is of another run.
    fn header(&self, list: &PairList) -> Value {
        json!({
            "cfreg": env!("CARGO_PKG_VERSION"),
            "list": format!("{:016x}", list.hash()),
            "pairs": list.len(),
            "folder": list.folder(),
            "clouds": (!self.in_memory.is_empty()).then(|| format!("{:016x}", self.hash_in_memory())),
            "method": self.settings,
            "viewpoints": self.viewpoints,
            "keep_no_returns": self.keep_no_returns,
            "thinning": self.thinning,
            "time_limit": self.time_limit.map(|limit| limit.as_secs_f64()),
        })
    }

    /// Returns a hash of the clouds in memory.
    fn hash_in_memory(&self) -> u64 {
        let mut names: Vec<&String> = self.in_memory.keys().collect();
        names.sort();
        let mut hash = Fnv1a::default();
        for name in names {
            hash.add_text(name);
            cloud_cache::hash_cloud(&mut hash, &self.in_memory[name]);
        }
        hash.value()
    }

    /// Registers these pairs, and passes each row to `give` as it comes, in no fixed order.
    fn register_pairs(
        &self,
        list: &PairList,
        pairs: Vec<usize>,
        mut give: impl FnMut(Row) -> Result<()>,
    ) -> Result<()> {
        let clouds = CloudCache::new(self.thinning, self.memory);
        let watch = Deadlines::default();
        let ended = || self.interrupt.is_requested() || par::is_interrupt_requested();
        let mut failed = None;
        let take = |row: Option<Option<Row>>| {
            if ended() {
                watch.interrupt_all();
                return ControlFlow::Break(());
            }
            watch.interrupt_late(self.time_limit);
            let Some(row) = row.flatten() else { return ControlFlow::Continue(()) };
            if let Err(error) = give(row) {
                failed = Some(error);
                watch.interrupt_all();
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        };
        par::worker_pool(
            self.threads,
            pairs.into_iter(),
            |index| self.register_pair(index, list, &clouds, &watch),
            POLL_INTERVAL,
            take,
        )?;
        match failed {
            Some(error) => Err(error),
            None if ended() => Err(Error::Interrupted),
            None => Ok(()),
        }
    }

    /// Registers one pair; `None` when all work is to end.
    fn register_pair(
        &self,
        index: usize,
        list: &PairList,
        clouds: &CloudCache,
        watch: &Deadlines,
    ) -> Option<Row> {
        let names = list.pair(index);
        let mut row = Row::new(index, names);
        let mut seconds = None;
        let guarded = AssertUnwindSafe(|| -> std::result::Result<Registration, String> {
            let found = watch.start(index).guard(|| {
                let [source, target] = names;
                let source = self.load_cloud(list.folder(), source, 0, clouds)?;
                let target = self.load_cloud(list.folder(), target, 1, clouds)?;
                par::checkpoint();
                let start = Instant::now();
                let found = self.method.register_cached(source.cached(), target.cached());
                seconds = Some(start.elapsed().as_secs_f64());
                [source, target].iter().for_each(|kept| clouds.touch(kept));
                found.map_err(|error| error.to_string())
            });
            found.unwrap_or_else(|error| match (error, self.time_limit) {
                (Error::Interrupted, Some(limit)) => {
                    Err(format!("the time limit of {} s ran out", limit.as_secs_f64()))
                }
                (error, _) => Err(error.to_string()),
            })
        });
        let found =
            catch_unwind(guarded).unwrap_or_else(|panic| Err(par::panic_message(panic.as_ref())));
        if watch.finish(index) {
            return None;
        }
        match found {
            Ok(found) => row.set_registration(&found),
            Err(error) => row.error = Some(error),
        }
        row.seconds = seconds;
        Some(row)
    }

    /// Returns the cloud of that name, downsampled for that side of a pair.
    fn load_cloud(
        &self,
        folder: &Path,
        name: &str,
        side: u64,
        clouds: &CloudCache,
    ) -> cloud_cache::ReadResult {
        let path = folder.join(name);
        clouds.get(&path, side, || {
            let cloud = match self.in_memory.get(name) {
                Some(given) => given.as_ref().clone(),
                None => io::read(&path)?,
            };
            let keep = self.keep_no_returns;
            let cloud = if keep { cloud } else { filter::remove_no_returns(cloud) };
            self.viewpoints.apply(cloud)
        })
    }
}
