//! Many pieces of work in parallel, each of them on one thread.

use std::ops::ControlFlow;
use std::sync::{Mutex, mpsc};
use std::time::Duration;

use super::lock::lock;
use super::loops::install;
use super::threads::{IS_WORKER, check_threads};
use crate::error::{Error, Result};

/// Calls `work` with each of `items`, in order, on `threads` threads beside the caller's (0: as
/// many as there are cores); the parallel loops within a call stay on its thread, also those
/// [`with_threads`](super::with_threads) of another number: so many run beside each other already.
///
/// The caller's thread passes each result to `take` when it is ready, in no fixed order, and `None`
/// at least every `tick`. After a break no more items are started; items in progress are waited
/// for, and their results dropped: end them by an [`Interrupt`](super::Interrupt) of your own.
///
/// # Errors
/// [`Error::Config`] for more than [`MAX_THREADS`](super::MAX_THREADS), or when the system cannot
/// create that many.
///
/// # Panics
/// When `work` does.
///
/// ```
/// use std::{ops::ControlFlow, time::Duration};
/// let mut squares = Vec::new();
/// cfreg::par::worker_pool(2, 0..5, |i| i * i, Duration::from_secs(1), |square| {
///     squares.extend(square);
///     ControlFlow::Continue(())
/// })?;
/// squares.sort();
/// assert_eq!(squares, [0, 1, 4, 9, 16]);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn worker_pool<I: Send, T: Send>(
    threads: usize,
    items: impl Iterator<Item = I> + Send,
    work: impl Fn(I) -> T + Sync,
    tick: Duration,
    mut take: impl FnMut(Option<T>) -> ControlFlow<()>,
) -> Result<()> {
    check_threads(threads)?;
    let threads = if threads == 0 { rayon::current_num_threads() } else { threads };
    let refused =
        |error: &dyn std::fmt::Display| Err(Error::config("threads", threads, error.to_string()));
    let items = Mutex::new(Some(items));
    let next = || lock(&items).as_mut()?.next();
    let end = || *lock(&items) = None;
    // A few results may wait, so that no worker idles while one is written.
    let (give, results) = mpsc::sync_channel::<Result<T, String>>(4 * threads);
    let worker = |give: mpsc::SyncSender<Result<T, String>>| {
        IS_WORKER.set(true);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
        let pool = match pool {
            Ok(pool) => pool,
            Err(error) => return drop(give.send(Err(error.to_string()))),
        };
        while let Some(item) = next() {
            if give.send(Ok(install(&pool, || work(item)))).is_err() {
                break;
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (worker, give) = (&worker, give.clone());
            if let Err(error) = std::thread::Builder::new().spawn_scoped(scope, || worker(give)) {
                end();
                return refused(&error);
            }
        }
        drop(give);
        loop {
            let step = match results.recv_timeout(tick) {
                Ok(Ok(result)) => take(Some(result)),
                Ok(Err(error)) => {
                    end();
                    return refused(&error);
                }
                Err(mpsc::RecvTimeoutError::Timeout) => take(None),
                Err(mpsc::RecvTimeoutError::Disconnected) => return Ok(()),
            };
            if step.is_break() {
                end();
                drop(results);
                return Ok(());
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::super::threads::in_worker;
    use super::*;
    use crate::par::{map, with_threads};

    #[test]
    fn loops_within_stay_on_the_thread() {
        let id = || std::thread::current().id();
        let alone = |_| {
            let ids = with_threads(2, || map(100, || (), |_, _| id())).unwrap();
            in_worker() && ids.iter().all(|&other| other == id())
        };
        let mut seen = 0;
        let take = |one: Option<bool>| {
            seen += usize::from(one.inspect(|alone| assert!(alone)).is_some());
            ControlFlow::Continue(())
        };
        worker_pool(3, 0..20, alone, Duration::from_secs(1), take).unwrap();
        assert_eq!((seen, in_worker()), (20, false));
    }

    #[test]
    fn nothing_is_begun_after_a_break() {
        let begun = AtomicUsize::new(0);
        let work = |_| {
            std::thread::sleep(Duration::from_millis(1));
            begun.fetch_add(1, Ordering::Relaxed)
        };
        worker_pool(2, 0..1_000_000, work, Duration::from_secs(1), |_| ControlFlow::Break(()))
            .unwrap();
        assert!(begun.load(Ordering::Relaxed) < 100);
        let endless =
            || worker_pool(2000, 0..1, |_| (), Duration::ZERO, |_| ControlFlow::Continue(()));
        assert!(endless().is_err());
    }
}
