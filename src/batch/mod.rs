//! Registration in bulk: a list of pairs, a row of results for each.
//!
//! Pairs run beside each other, each on one thread; each cloud is read once and kept under a
//! budget of memory. Rows go to a journal beside the output (`RESULTS.csv.part`) as they come,
//! and into the output, in the order of the list, at the end: a run that was cut short at any
//! moment goes on from its journal, and ends with the same bytes as one that was not. The bytes
//! do not depend on the number of threads either. What does depend on the machine are pairs that
//! come near a [time limit](Batch::time_limit).
//!
//! Memory holds the clouds, and for each pair 24 bytes; the names of files once each.

mod clouds;
mod journal;
mod list;
mod output;
#[cfg(feature = "parquet")]
mod parquet;
mod row;

use std::any::Any;
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::{Value, json};

pub use list::List;
pub use row::Row;

pub use crate::filter::Thinning;

use self::clouds::Clouds;
use self::journal::Journal;
use self::output::Format;
use crate::error::{Error, Result};
use crate::method::{Register, Registration};
use crate::par::{self, Interrupt};

/// How often time limits and requests to end are looked at.
const TICK: Duration = Duration::from_millis(20);

/// What to do where an earlier run has left something.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Start {
    /// Refuse to begin.
    #[default]
    Fresh,
    /// Go on from its journal; begin where there is none, and do nothing where there is an
    /// output without a journal, which is complete.
    Resume,
    /// Begin anew. An output that is there is replaced at the end.
    Overwrite,
}

/// How a list of pairs is run.
///
/// ```
/// use cfreg::batch::{Batch, List};
/// use cfreg::{experiment::shape::boulder, io, method::{Chain, Consensus}};
/// # let folder = tempfile::tempdir().unwrap();
/// # let folder = folder.path();
/// for seed in 0..3 {
///     io::write(folder.join(format!("{seed}.ply")), &boulder().sample(500, seed)?)?;
/// }
/// let list = List::new(folder, [["0.ply", "1.ply"], ["1.ply", "2.ply"], ["2.ply", "none.ply"]]);
/// let method: Chain = Chain::new("cf".parse()?, vec!["icp".parse()?])?;
/// let done = Batch::new(&method, &method).run(&list, &folder.join("poses.csv"))?;
/// assert_eq!((done.pairs, done.errors), (3, 1));
/// # Ok::<(), cfreg::Error>(())
/// ```
pub struct Batch<'a> {
    method: &'a dyn Register,
    settings: Value,
    /// How clouds are thinned; not at all by default.
    pub thinning: Thinning,
    /// Pairs that run beside each other, 0 (the default) for as many as there are cores.
    pub threads: usize,
    /// Bytes of clouds that are kept for later pairs, beside those in use; default 1 GiB. More
    /// helps where pairs of a cloud are far apart in the list.
    pub memory: usize,
    /// Time after which a pair is given up; its row has an `error`. None by default. Near the
    /// limit it depends on the machine which pairs that are.
    pub time_limit: Option<Duration>,
    /// Whether the results have the column `seconds`. Off by default: no two runs agree on it.
    pub times: bool,
    /// What to do where an earlier run has left something.
    pub start: Start,
    /// Ends the run when it is requested, with [`Error::Interrupted`]; the journal is kept.
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
    /// Pairs whose pose is to be trusted.
    pub trusted: usize,
    /// Pairs without an answer.
    pub errors: usize,
}

impl<'a> Batch<'a> {
    /// By this method; `settings` is what it was made of, which a resumed run compares.
    pub fn new(method: &'a dyn Register, settings: &impl Serialize) -> Self {
        Batch {
            method,
            settings: serde_json::to_value(settings).unwrap_or_default(),
            thinning: Thinning::default(),
            threads: 0,
            memory: 1 << 30,
            time_limit: None,
            times: false,
            start: Start::Fresh,
            interrupt: Interrupt::default(),
        }
    }

    /// Registers every pair of `list` and writes the [rows](Row) to `output`, by its extension
    /// `.csv`, `.jsonl` or `.parquet`.
    ///
    /// # Errors
    /// As [`run_with`](Self::run_with).
    pub fn run(&self, list: &List, output: &Path) -> Result<Summary> {
        self.run_with(list, output, |_, _| ())
    }

    /// The same; `progress` is called with the pairs done and all of them.
    ///
    /// # Errors
    /// [`Error::Config`] for an output of another kind, for what an earlier run has left
    /// ([`Start`]) and for a journal of another list or other settings; [`Error::Io`] of journal
    /// and output; [`Error::Interrupted`]. A pair that cannot be read or registered is a row.
    pub fn run_with(
        &self,
        list: &List,
        output: &Path,
        mut progress: impl FnMut(usize, usize),
    ) -> Result<Summary> {
        let format = Format::of(output)?;
        par::check_threads(self.threads)?;
        let path = Journal::beside(output);
        if self.complete(output, &path)? {
            let pairs = list.len();
            return Ok(Summary { pairs, resumed: pairs, ..Summary::default() });
        }
        let resume = self.start == Start::Resume;
        let mut journal = Journal::open(&path, &self.header(list), list.len(), resume)?;
        let resumed = journal.done();
        progress(resumed, list.len());
        self.register(list, &mut journal, &mut progress)?;
        journal.sync(Duration::ZERO)?;
        let mut summary = Summary { pairs: list.len(), resumed, ..Summary::default() };
        let counted = journal.rows()?.inspect(|row| {
            if let Ok(row) = row {
                summary.trusted += usize::from(row.trusted == Some(true));
                summary.errors += usize::from(row.error.is_some());
            }
        });
        format.write(output, counted, self.times)?;
        journal.remove()?;
        Ok(summary)
    }

    /// Looks at what an earlier run has left: whether that is all there is to do.
    fn complete(&self, output: &Path, journal: &Path) -> Result<bool> {
        let refuse = |rule: String| Err(Error::config("output", output.display(), rule));
        if output.exists() && !output.is_file() {
            return refuse("is not a regular file".into());
        }
        match (self.start, output.exists(), journal.exists()) {
            (Start::Fresh, _, true) => refuse(format!(
                "an earlier run has left {}: go on from it with --resume, or start anew with \
                 --overwrite",
                journal.display()
            )),
            (Start::Fresh, true, false) => {
                refuse("is there already: replace it with --overwrite".into())
            }
            (Start::Resume, true, false) => Ok(true),
            _ => Ok(false),
        }
    }

    /// What rows depend on: a journal with another header is of another run.
    fn header(&self, list: &List) -> Value {
        json!({
            "cfreg": env!("CARGO_PKG_VERSION"),
            "list": format!("{:016x}", list.hash()),
            "pairs": list.len(),
            "folder": list.folder(),
            "method": self.settings,
            "thinning": self.thinning,
            "time_limit": self.time_limit.map(|limit| limit.as_secs_f64()),
        })
    }

    /// Registers the pairs that are not in the journal.
    fn register(
        &self,
        list: &List,
        journal: &mut Journal,
        progress: &mut impl FnMut(usize, usize),
    ) -> Result<()> {
        let clouds = Clouds::new(self.thinning, self.memory);
        let watch = Watch::default();
        let missing = journal.missing().into_iter();
        let mut failed = None;
        let take = |row: Option<Option<Row>>| {
            if self.interrupt.is_requested() {
                watch.end_all();
                return ControlFlow::Break(());
            }
            watch.end_late(self.time_limit);
            let Some(row) = row.flatten() else { return ControlFlow::Continue(()) };
            if let Err(error) = journal.add(&row) {
                failed = Some(error);
                watch.end_all();
                return ControlFlow::Break(());
            }
            progress(journal.done(), list.len());
            ControlFlow::Continue(())
        };
        par::crew(
            self.threads,
            missing,
            |index| self.row(index, list, &clouds, &watch),
            TICK,
            take,
        )?;
        match failed {
            Some(error) => Err(error),
            None if self.interrupt.is_requested() => Err(Error::Interrupted),
            None => Ok(()),
        }
    }

    /// One pair; `None` when all work is to end.
    fn row(&self, index: usize, list: &List, clouds: &Clouds, watch: &Watch) -> Option<Row> {
        let names = list.pair(index);
        let mut row = Row::new(index, names);
        let mut seconds = None;
        let guarded = AssertUnwindSafe(|| -> std::result::Result<Registration, String> {
            let [source, target] = names.map(|name| list.folder().join(name));
            let (source, target) = (clouds.get(&source, 0)?, clouds.get(&target, 1)?);
            let start = Instant::now();
            let interrupt = watch.begin(index);
            let found = interrupt.guard(|| self.method.register(&source, &target));
            seconds = Some(start.elapsed().as_secs_f64());
            found.and_then(|found| found).map_err(|error| match (error, self.time_limit) {
                (Error::Interrupted, Some(limit)) => {
                    format!("the time limit of {} s ran out", limit.as_secs_f64())
                }
                (error, _) => error.to_string(),
            })
        });
        let found = catch_unwind(guarded).unwrap_or_else(|panic| Err(words(panic.as_ref())));
        if watch.finish(index) {
            return None;
        }
        match found {
            Ok(found) => row.fill(&found),
            Err(error) => row.error = Some(error),
        }
        row.seconds = seconds;
        Some(row)
    }
}

/// What a panic said.
fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    format!("a bug, please report it: {text}")
}

/// The pairs that are being registered, and since when.
#[derive(Default)]
struct Watch(Mutex<Watched>);

#[derive(Default)]
struct Watched {
    running: HashMap<usize, (Instant, Interrupt)>,
    ended: bool,
}

impl Watch {
    fn lock(&self) -> MutexGuard<'_, Watched> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the pair is to run under.
    fn begin(&self, index: usize) -> Interrupt {
        let interrupt = Interrupt::default();
        let mut watched = self.lock();
        if watched.ended {
            interrupt.request();
        }
        watched.running.insert(index, (Instant::now(), interrupt.clone()));
        interrupt
    }

    /// Whether all work is to end.
    fn finish(&self, index: usize) -> bool {
        let mut watched = self.lock();
        watched.running.remove(&index);
        watched.ended
    }

    fn end_late(&self, limit: Option<Duration>) {
        let Some(limit) = limit else { return };
        for (begun, interrupt) in self.lock().running.values() {
            if begun.elapsed() > limit {
                interrupt.request();
            }
        }
    }

    fn end_all(&self) {
        let mut watched = self.lock();
        watched.ended = true;
        watched.running.values().for_each(|(_, interrupt)| interrupt.request());
    }
}
