//! How many threads there may be, and which of them are workers.

use std::cell::Cell;

use crate::error::{Error, Result};

/// Most threads that may be asked for.
pub const MAX_THREADS: usize = 1024;

thread_local! {
    /// Whether this thread is of a crew.
    pub(super) static IS_WORKER: Cell<bool> = const { Cell::new(false) };
}

/// Whether the caller is one of a [`worker_pool`](super::worker_pool()), whose work stays on its thread.
pub fn in_worker() -> bool {
    IS_WORKER.get()
}

/// Refuses a number of threads that no machine has.
///
/// # Errors
/// [`Error::Config`] for more than [`MAX_THREADS`].
pub fn check_threads(threads: usize) -> Result<()> {
    if threads > MAX_THREADS {
        return Err(Error::config("threads", threads, format!("must be at most {MAX_THREADS}")));
    }
    Ok(())
}
