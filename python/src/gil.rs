//! The only way from Python into long work: without the interpreter, interruptible by Ctrl-C.

use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pyo3::prelude::*;

use super::errors::to_pyerr;
use super::panics;
use super::shutdown::{detach, is_shutting_down};
use cfreg::error::{Error, Result};
use cfreg::par::{self, Interrupt};

/// How long a signal waits at most before it is looked at.
const SIGNAL_POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Threads on which loops run.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Pool {
    /// The threads shared by all calls.
    Shared,
    /// Threads of this call alone: for work that may wait for other calls, such as Python functions
    /// that take a lock.
    Own,
}

/// Runs `work` in a separate thread while this one, without the interpreter, waits for it and
/// handles signals: other Python threads continue, and Ctrl-C ends the work. A panic in the work
/// becomes an exception.
pub(super) fn run_interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    run_interruptible_on(py, Pool::Shared, work)
}

/// [`run_interruptible`] with loops on the threads of `pool`.
pub(super) fn run_interruptible_on<T: Send>(
    py: Python<'_>,
    pool: Pool,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    let interrupt = Interrupt::default();
    let (send, receive) = channel();
    let within = interrupt.clone();
    // A Python weight function may call this module again, from a thread that waits for it.
    let pool = if par::in_pool() { Pool::Own } else { pool };
    let worker = move || {
        // Nobody waits for an answer after an interrupt.
        let _ = send.send(within.guard(|| with_live_threads(pool, work)));
    };
    detach(py, move || {
        std::thread::scope(|scope| {
            let worker = std::thread::Builder::new()
                .name("cfreg".into())
                .spawn_scoped(scope, worker)
                .map_err(|source| to_pyerr(Error::io("a new thread", source)))?;
            loop {
                match receive.recv_timeout(SIGNAL_POLL_INTERVAL) {
                    Ok(answer) => return answer.flatten().flatten().map_err(to_pyerr),
                    Err(RecvTimeoutError::Timeout)
                        if par::is_interrupt_requested() || is_shutting_down() =>
                    {
                        interrupt.request();
                        return Err(to_pyerr(Error::Interrupted));
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        // Handlers run in the main thread only; elsewhere this does nothing.
                        let signals = Python::attach(|py| py.check_signals());
                        signals.inspect_err(|_| interrupt.request())?;
                    }
                    Err(RecvTimeoutError::Disconnected) => {
                        let panic = worker.join().err();
                        return Err(panics::panic_to_pyerr(
                            panic.unwrap_or_else(|| Box::new("no answer")),
                        ));
                    }
                }
            }
        })
    })
    .flatten()
}

/// Runs `work` on threads that will take it up: new ones, too, in a process that was forked,
/// as `multiprocessing` does, where the shared ones are not.
fn with_live_threads<T: Send>(pool: Pool, work: impl FnOnce() -> T + Send) -> Result<T> {
    static FIRST_PROCESS: OnceLock<u32> = OnceLock::new();
    let process = std::process::id();
    let shared = pool == Pool::Shared && *FIRST_PROCESS.get_or_init(|| process) == process;
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    par::with_threads(if shared { 0 } else { all() }, work)
}
