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

use super::panics::catch_panic;
use cfreg::par;

/// Longest wait at exit: a Python function that sleeps cannot be ended.
const MAX_WAIT: Duration = Duration::from_secs(5);
/// Between two looks.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// Calls that are detached, in the process of that number: those of other threads do not
/// follow into a fork.
static DETACHED_CALLS: AtomicUsize = AtomicUsize::new(0);
static OWNER_PROCESS: AtomicU32 = AtomicU32::new(0);

/// The thread that ends the interpreter, once it does. Its own calls are still answered:
/// Python runs functions while it ends.
static SHUTDOWN_THREAD: OnceLock<ThreadId> = OnceLock::new();

/// Runs `work` without the interpreter, so that other threads have it. A panic in it becomes an
/// exception.
pub(super) fn detach<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    py.detach(|| {
        let _away = DetachedGuard::new();
        catch_panic(work)
    })
}

/// Whether the interpreter ends, so that nobody waits for what this thread does.
pub(super) fn is_shutting_down() -> bool {
    let elsewhere = |ending: &ThreadId| *ending != thread::current().id();
    // Threads of a pool work for another, which decides.
    SHUTDOWN_THREAD.get().is_some_and(elsewhere) && !par::in_pool()
}

/// A thread is detached as long as this is there.
struct DetachedGuard;

impl DetachedGuard {
    fn new() -> Self {
        let process = std::process::id();
        if OWNER_PROCESS.swap(process, SeqCst) != process {
            DETACHED_CALLS.store(0, SeqCst);
        }
        DETACHED_CALLS.fetch_add(1, SeqCst);
        DetachedGuard
    }
}

impl Drop for DetachedGuard {
    fn drop(&mut self) {
        DETACHED_CALLS.fetch_sub(1, SeqCst);
        while is_shutting_down() {
            thread::park();
        }
    }
}

/// Request the end of all calls of other threads, and wait for them. Run by atexit.
#[pyfunction]
fn end(py: Python<'_>) {
    SHUTDOWN_THREAD.get_or_init(|| thread::current().id());
    let here = OWNER_PROCESS.load(SeqCst) == std::process::id();
    py.detach(|| {
        let begun = Instant::now();
        while here && DETACHED_CALLS.load(SeqCst) > 0 && begun.elapsed() < MAX_WAIT {
            thread::sleep(POLL_INTERVAL);
        }
    });
}

/// Registers [`end`] to run before the interpreter ends.
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let end = wrap_pyfunction!(end, module)?;
    module.py().import("atexit")?.call_method1("register", (end,))?;
    Ok(())
}
