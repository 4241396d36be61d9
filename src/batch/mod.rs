//! Registration in bulk: a list of pairs, a row of results for each.
//!
//! Pairs run beside each other, each on one thread; each cloud is read once, what a method makes
//! of it alone is made once, and both are kept under a budget of memory. Rows go to a journal beside the output (`RESULTS.csv.part`) as they come,
//! and into the output, in the order of the list, at the end: a run that was cut short at any
//! moment goes on from its journal, and ends with the same bytes as one that was not. The bytes
//! do not depend on the number of threads either. What does depend on the machine are pairs that
//! come near a [time limit](Batch::time_limit).
//!
//! Memory holds the clouds, and for each pair 24 bytes; the names of files once each.

mod cloud_cache;
mod columns;
mod deadlines;
mod graph;
mod hash;
mod journal;
mod list;
mod output;
mod pairing;
mod panic_hook;
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

pub use columns::Column;
pub use graph::RowGraph;
pub use list::PairList;
pub use pairing::{radius_pairs, sequential_pairs};
pub use panic_hook::install_panic_hook;
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

/// How often time limits and requests to end are looked at.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// What to do where an earlier run has left something.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartMode {
    /// Refuse to begin.
    #[default]
    Fresh,
    /// Go on from its journal; begin where there is none, and do nothing where there is an
    /// output without a journal, which is complete. An output of another list or of other
    /// settings is refused: Parquet has within what it was made with, CSV and JSON Lines in a file
    /// beside them (`RESULTS.csv.run.json`), without which they are refused too.
    Resume,
    /// Begin anew. An output that is there is replaced at the end.
    Overwrite,
}

/// How a list of pairs is run.
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
    /// Clouds that are at hand, by the names that the list has for them; others are files.
    pub in_memory: HashMap<String, Arc<PointCloud>>,
    /// What is known of where sensors stood; by default what the clouds say.
    pub viewpoints: ViewpointSource,
    /// Whether rows of files that mark measurements without a return are kept
    /// ([`crate::filter::find_no_returns`]); by default they are left out.
    pub keep_no_returns: bool,
    /// How clouds are thinned; not at all by default.
    pub thinning: Downsampling,
    /// Pairs that run beside each other, 0 (the default) for as many as there are cores.
    pub threads: usize,
    /// Bytes of clouds, and of what was made of them alone, that are kept for later pairs, beside
    /// those in use; default 1 GiB. More helps where pairs of a cloud are far apart in the list.
    pub memory: usize,
    /// Time after which a pair is given up, the reading of its clouds counted; its row has an
    /// `error`. None by default. Near the limit it depends on the machine which pairs that are.
    pub time_limit: Option<Duration>,
    /// Whether the results have the column `seconds`. Off by default: no two runs agree on it.
    pub times: bool,
    /// What to do where an earlier run has left something.
    pub start: StartMode,
    /// Ends the run when it is requested, with [`Error::Interrupted`]; the journal is kept. So
    /// does the interrupt under which the caller works.
    pub interrupt: Interrupt,
}

/// What came of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Summary {
    /// Pairs of the list.
    pub pairs: usize,
    /// Those that this run took over from an earlier one; all, if there was nothing left to do.
    pub resumed: usize,
    /// Lines of the journal that were changed since they were written, or are of other pairs than
    /// the list has; their pairs were done again.
    pub damaged: usize,
    /// Pairs whose pose may be used ([`Row::is_usable`]).
    pub trusted: usize,
    /// Pairs without an answer.
    pub errors: usize,
}

impl Summary {
    fn add_row(&mut self, row: &Row) {
        self.trusted += usize::from(row.is_usable());
        self.errors += usize::from(row.error.is_some());
    }
}

impl<'a> Batch<'a> {
    /// By this method; `settings` is what it was made of, which a resumed run compares.
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

    /// The same; `progress` is called with the pairs done and all of them.
    ///
    /// # Errors
    /// [`Error::Config`] for an output of another kind, for what an earlier run has left
    /// ([`StartMode`]), for a journal of another list or other settings, for an output that is the list
    /// or one of its clouds, and for files beside it (`RESULTS.part`, `RESULTS.run.json`) that no run
    /// has left; [`Error::Io`] of journal
    /// and output; [`Error::Interrupted`]. A pair that cannot be read or registered is a row.
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

    /// Registers every pair of `list`, and keeps the rows, in the order of the list, instead of
    /// writing them; `progress` is called with the pairs done and all of them.
    ///
    /// # Errors
    /// [`Error::Config`] for settings that will not do; [`Error::Interrupted`].
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

    /// Refuses what would make an error of every row.
    fn check(&self) -> Result<()> {
        par::check_threads(self.threads)?;
        self.thinning.validate()
    }

    /// Looks at what an earlier run has left: whether that is all there is to do.
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

    /// What rows depend on: a journal with another header is of another run.
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

    /// A number that differs between clouds that are given.
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

    /// Registers these pairs, and gives each row to `give` as it comes, in no fixed order.
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

    /// One pair; `None` when all work is to end.
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
        let found = catch_unwind(guarded)
            .unwrap_or_else(|panic| Err(panic_hook::panic_message(panic.as_ref())));
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

    /// The cloud of that name, thinned for that side of a pair.
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
