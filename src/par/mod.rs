//! Ordered parallel loops, and the way to stop them: the only place that spawns threads.
//!
//! Work is cut at fixed places, results come back by index and whoever reduces
//! them does so in index order, so that the number of threads never changes a bit.
//! The loops run on the pool they are called from: [`with_threads`] chooses it. Whoever
//! runs work under an [`Interrupt`] can end it from another thread.

mod interrupt;
mod loops;
mod threads;
mod worker_pool;

pub use interrupt::{Interrupt, checkpoint, is_interrupt_requested, stop};
pub use loops::{for_each_row, in_pool, join_pair, map, map_blocks, on_new_thread, with_threads};
pub use threads::{MAX_THREADS, check_threads, in_worker};
pub use worker_pool::worker_pool;
