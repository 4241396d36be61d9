//! The one way from Python into long work: without the interpreter, to be ended by Ctrl-C.

use std::panic::resume_unwind;
use std::sync::OnceLock;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pyo3::prelude::*;

use super::errors::exception;
use crate::error::{Error, Result};
use crate::par::{self, Interrupt};

/// How long a signal waits at most before it is looked at.
const PATIENCE: Duration = Duration::from_millis(50);

/// Runs `work` in a thread of its own while this one, without the interpreter, waits for it
/// and looks after signals: other Python threads go on, and Ctrl-C ends the work.
pub(super) fn released<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    let interrupt = Interrupt::default();
    let (send, receive) = channel();
    let within = interrupt.clone();
    // A weight written in Python may call on us again, from a thread of the pool.
    let nested = par::in_pool();
    let worker = move || {
        // Nobody waits for an answer after an interrupt.
        let _ = send.send(within.guard(|| on_live_threads(nested, work)));
    };
    py.detach(move || {
        std::thread::scope(|scope| {
            let worker = std::thread::Builder::new()
                .name("cfreg".into())
                .spawn_scoped(scope, worker)
                .map_err(|source| exception(Error::io("a new thread", source)))?;
            loop {
                match receive.recv_timeout(PATIENCE) {
                    Ok(answer) => return answer.flatten().flatten().map_err(exception),
                    Err(RecvTimeoutError::Timeout) if par::requested() => {
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
                        resume_unwind(panic.unwrap_or_else(|| Box::new("no answer")))
                    }
                }
            }
        })
    })
}

/// Runs `work` on threads that will take it up: new ones where it is `nested` in other work,
/// and in a process that was forked, as `multiprocessing` does. The usual threads then wait
/// for this work, or are not there.
fn on_live_threads<T: Send>(nested: bool, work: impl FnOnce() -> T + Send) -> Result<T> {
    static FIRST: OnceLock<u32> = OnceLock::new();
    let process = std::process::id();
    let usual = !nested && *FIRST.get_or_init(|| process) == process;
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    par::with_threads(if usual { 0 } else { all() }, work)
}
