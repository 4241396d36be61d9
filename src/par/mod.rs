//! Ordered parallel loops and their interruption: the only module that spawns threads.
//!
//! Work is cut at fixed positions, results are returned by index, and reductions run in index
//! order, so that the number of threads never changes a bit. The loops run on the pool they are
//! called from: [`with_threads`] chooses it. Work that runs under an [`Interrupt`] can be ended
//! from another thread.

mod interrupt;
mod lock;
mod loops;
mod panic_hook;
mod threads;
mod worker_pool;

pub use interrupt::{Interrupt, checkpoint, is_interrupt_requested, stop};
pub(crate) use lock::lock;
pub use loops::{for_each_row, in_pool, join_pair, map, map_blocks, on_new_thread, with_threads};
pub use panic_hook::install_panic_hook;
pub(crate) use panic_hook::{catch_panic, panic_message, panic_text};
pub use threads::{MAX_THREADS, check_threads, in_worker};
pub use worker_pool::worker_pool;
