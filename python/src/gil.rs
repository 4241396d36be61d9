//! The only way from Python into long work: without the interpreter, interruptible by Ctrl-C.

use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pyo3::prelude::*;

use super::errors::exception;
use super::panics;
use super::shutdown::{detached, ending};
use cfreg::error::{Error, Result};
use cfreg::par::{self, Interrupt};

/// Maximum delay before a signal is handled. Chosen by hand.
const PATIENCE: Duration = Duration::from_millis(50);

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
pub(super) fn released<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    released_on(py, Pool::Shared, work)
}

/// Runs [`released`] with loops on the threads of `pool`.
pub(super) fn released_on<T: Send>(
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
        // After an interrupt nobody waits for a result.
        let _ = send.send(within.guard(|| on_live_threads(pool, work)));
    };
    detached(py, move || {
        std::thread::scope(|scope| {
            let worker = std::thread::Builder::new()
                .name("cfreg".into())
                .spawn_scoped(scope, worker)
                .map_err(|source| exception(Error::io("a new thread", source)))?;
            loop {
                match receive.recv_timeout(PATIENCE) {
                    Ok(answer) => return answer.flatten().flatten().map_err(exception),
                    Err(RecvTimeoutError::Timeout) if par::is_interrupt_requested() || ending() => {
                        interrupt.request();
                        return Err(exception(Error::Interrupted));
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        // Handlers run in the main thread only; elsewhere this does nothing.
                        let signals = Python::attach(|py| py.check_signals());
                        signals.inspect_err(|_| interrupt.request())?;
                    }
                    Err(RecvTimeoutError::Disconnected) => {
                        let panic = worker.join().err();
                        return Err(panics::exception(
                            panic.unwrap_or_else(|| Box::new("no answer")),
                        ));
                    }
                }
            }
        })
    })
    .flatten()
}

/// Runs `work` on live threads. A forked process, as from `multiprocessing`, gets new threads,
/// because the shared ones do not exist there.
fn on_live_threads<T: Send>(pool: Pool, work: impl FnOnce() -> T + Send) -> Result<T> {
    static FIRST: OnceLock<u32> = OnceLock::new();
    let process = std::process::id();
    let shared = pool == Pool::Shared && *FIRST.get_or_init(|| process) == process;
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    par::with_threads(if shared { 0 } else { all() }, work)
}
