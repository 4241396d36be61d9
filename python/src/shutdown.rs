//! Work without the interpreter, which may exit meanwhile.
//!
//! Daemon threads continue while Python exits. A thread that then requests the interpreter again is
//! unwound by force, which aborts the process. So Python waits, before it finalizes, for all
//! detached calls, and threads that would return stay here until the process ends.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::SeqCst};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

use super::panics::caught;
use cfreg::par;

/// Maximum wait at exit: a Python function that sleeps cannot be ended. Chosen by hand.
const LONGEST: Duration = Duration::from_secs(5);
/// Interval between two checks. Chosen by hand.
const STEP: Duration = Duration::from_millis(5);

/// Number of detached calls, in the process whose id is in `PROCESS`: calls of other threads do not
/// continue in a fork.
static DETACHED: AtomicUsize = AtomicUsize::new(0);
static PROCESS: AtomicU32 = AtomicU32::new(0);

/// The thread that ends the interpreter, once it does. Its own calls still run: Python executes
/// functions while it ends.
static ENDING: OnceLock<ThreadId> = OnceLock::new();

/// Runs `work` without the interpreter, so that other threads can use it. A panic in the work
/// becomes an exception.
pub(super) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| {
        let _away = Away::new();
        caught(work)
    })
}

/// Returns whether the interpreter is ending, so that nobody waits for the work of this thread.
pub(super) fn ending() -> bool {
    let elsewhere = |ending: &ThreadId| *ending != thread::current().id();
    // Threads of a pool work for another thread, which decides.
    ENDING.get().is_some_and(elsewhere) && !par::in_pool()
}

/// Guard: a thread is detached as long as the guard exists.
struct Away;

impl Away {
    fn new() -> Self {
        let process = std::process::id();
        if PROCESS.swap(process, SeqCst) != process {
            DETACHED.store(0, SeqCst);
        }
        DETACHED.fetch_add(1, SeqCst);
        Away
    }
}

impl Drop for Away {
    fn drop(&mut self) {
        DETACHED.fetch_sub(1, SeqCst);
        while ending() {
            thread::park();
        }
    }
}

/// Request the end of all calls of other threads, and wait for them. Run by atexit.
#[pyfunction]
fn end(py: Python<'_>) {
    ENDING.get_or_init(|| thread::current().id());
    let here = PROCESS.load(SeqCst) == std::process::id();
    py.detach(|| {
        let begun = Instant::now();
        while here && DETACHED.load(SeqCst) > 0 && begun.elapsed() < LONGEST {
            thread::sleep(STEP);
        }
    });
}

/// Registers [`end`] to run before the interpreter ends.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let end = wrap_pyfunction!(end, module)?;
    module.py().import("atexit")?.call_method1("register", (end,))?;
    Ok(())
}
