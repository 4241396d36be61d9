//! Loops over indices, blocks and rows.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::interrupt::{Interrupt, checkpoint, enter};
use super::lock::lock;
use super::threads::{check_threads, in_worker};
use crate::error::{Error, Result};

/// Runs `work` with its parallel loops on `threads` threads; 0 means as many as the
/// machine has cores (or as the pool has in which the caller already is). Within a
/// [`worker_pool`](super::worker_pool()) on the caller's alone, whatever `threads` says.
///
/// # Errors
/// [`Error::Config`] for more than [`MAX_THREADS`](super::MAX_THREADS), or when the system does not give that
/// many.
///
/// ```
/// let sum = cfreg::par::with_threads(2, || cfreg::par::map(4, || (), |_, i| i * i).iter().sum::<usize>())?;
/// assert_eq!(sum, 14);
/// # Ok::<(), cfreg::Error>(())
/// ```
pub fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    check_threads(threads)?;
    if threads == 0 || in_worker() {
        return Ok(work());
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| Error::config("threads", threads, error.to_string()))?;
    let interrupt = Interrupt::current();
    Ok(install(&pool, || {
        let _entered = enter(&interrupt);
        work()
    }))
}

/// Whether the caller is one of the threads that parallel loops run on. If it waits for
/// other work, that should have threads of its own: those here may all be waiting so.
pub fn in_pool() -> bool {
    rayon::current_thread_index().is_some()
}

/// Runs `work` with its parallel loops on one new thread, which has ended when this returns, so
/// that no per-thread state of libraries remains: [`with_threads`] lets its threads end later. For
/// measurements.
///
/// # Errors
/// [`Error::Config`] when the system cannot create a thread.
pub fn on_new_thread<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T> {
    let refused = |error: &dyn std::fmt::Display| Error::config("threads", 1, error.to_string());
    let interrupt = Interrupt::current();
    std::thread::scope(|scope| {
        let alone = || {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
            let pool = pool.build().map_err(|error| refused(&error))?;
            let _entered = enter(&interrupt);
            Ok(install(&pool, work))
        };
        let thread = std::thread::Builder::new()
            .spawn_scoped(scope, alone)
            .map_err(|error| refused(&error))?;
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

/// Parts of a loop for each thread, so that unequal parts even out. Chosen by hand.
const PARTS_PER_THREAD: usize = 16;

/// Returns how many of `n` indices a part of a loop has.
fn part_length(n: usize) -> usize {
    n.div_ceil(PARTS_PER_THREAD * rayon::current_num_threads()).max(1)
}

/// Calls `work` with each index below `n`, in parallel. Every loop goes through this function, which
/// is compiled once: loops of rayon that know their closures took a fifth of the time of a build.
fn run(n: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..n).into_par_iter().for_each(work);
}

/// Runs `work` on the threads of `pool`.
pub(super) fn install<T: Send>(pool: &rayon::ThreadPool, work: impl FnOnce() -> T + Send) -> T {
    let (mut work, mut done) = (Some(work), None);
    let mut call = || done = work.take().map(|work| work());
    let call: &mut (dyn FnMut() + Send) = &mut call;
    pool.install(call);
    done.expect("the pool calls it")
}

/// Computes `[f(0), f(1), …, f(n − 1)]`; each call gets a scratch value made by `scratch`, possibly
/// used before.
pub fn map<S, T: Send>(
    n: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize) -> T + Sync,
) -> Vec<T> {
    let (interrupt, length) = (Interrupt::current(), part_length(n));
    let parts: Vec<Mutex<Vec<T>>> = (0..n.div_ceil(length)).map(|_| Mutex::default()).collect();
    run(parts.len(), &|part| {
        let _entered = enter(&interrupt);
        let mut scratch = scratch();
        let step = |i| {
            checkpoint();
            f(&mut scratch, i)
        };
        let done = (part * length..n.min((part + 1) * length)).map(step).collect();
        *lock(&parts[part]) = done;
    });
    let mut all = Vec::with_capacity(n);
    for part in parts {
        all.append(&mut part.into_inner().unwrap_or_else(PoisonError::into_inner));
    }
    all
}

/// Computes `[f(a), f(b)]`, in parallel if there are threads: for the two clouds of a pair.
///
/// # Errors
/// The error of the first call that fails.
pub fn join_pair<A: Send, T: Send, E: Send>(
    pair: [A; 2],
    f: impl Fn(A) -> Result<T, E> + Sync,
) -> Result<[T; 2], E> {
    let given = pair.map(|cloud| Mutex::new(Some(cloud)));
    let take = |side: usize| lock(&given[side]).take();
    let mut done = map(2, || (), |(), side| take(side).map(&f)).into_iter().flatten();
    match [done.next(), done.next()] {
        [Some(a), Some(b)] => Ok([a?, b?]),
        _ => unreachable!("each side is there once"),
    }
}

/// Computes `f` of `0..block`, `block..2·block`, … up to `n`, in order; each call gets a scratch
/// value made by `scratch`, possibly used before.
///
/// # Panics
/// When `block` is 0.
pub fn map_blocks<S, T: Send>(
    n: usize,
    block: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, Range<usize>) -> T + Sync,
) -> Vec<T> {
    map(n.div_ceil(block), scratch, |scratch, b| f(scratch, b * block..((b + 1) * block).min(n)))
}

/// Calls `f` with the index and the row of every `width` values of `data`.
///
/// # Panics
/// When `width` is 0.
pub fn for_each_row<S, T: Send>(
    data: &mut [T],
    width: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize, &mut [T]) + Sync,
) {
    let rows = data.len().div_ceil(width);
    let (interrupt, length) = (Interrupt::current(), part_length(rows));
    let parts: Vec<Mutex<&mut [T]>> = data.chunks_mut(length * width).map(Mutex::new).collect();
    run(parts.len(), &|part| {
        let _entered = enter(&interrupt);
        let mut scratch = scratch();
        let mut part_of_data = lock(&parts[part]);
        for (row, i) in part_of_data.chunks_mut(width).zip(part * length..) {
            checkpoint();
            f(&mut scratch, i, row);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_everything_in_order() {
        for threads in [1, 2, 3, 7] {
            let blocks =
                with_threads(threads, || map_blocks(10, 4, || (), |_, range| range)).unwrap();
            assert_eq!(blocks, [0..4, 4..8, 8..10]);
        }
        assert!(map_blocks(0, 4, || (), |_, range| range).is_empty());
    }

    #[test]
    fn a_new_thread_does_all_and_leaves_nothing() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        static LEFT: AtomicUsize = AtomicUsize::new(0);
        struct Kept;
        impl Drop for Kept {
            fn drop(&mut self) {
                std::thread::sleep(std::time::Duration::from_millis(20));
                LEFT.fetch_sub(1, Ordering::SeqCst);
            }
        }
        thread_local!(static KEPT: Kept = { LEFT.fetch_add(1, Ordering::SeqCst); Kept });
        let id = |_: &mut (), _| KEPT.with(|_| std::thread::current().id());
        let ids = on_new_thread(|| map(100, || (), id)).unwrap();
        assert!(ids.iter().all(|id| *id == ids[0] && *id != std::thread::current().id()));
        assert_eq!(LEFT.load(Ordering::SeqCst), 0);
    }
}
