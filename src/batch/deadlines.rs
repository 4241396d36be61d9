//! Who is at work, and since when: what time limits and the end of a run go by.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::par::Interrupt;

/// The pairs that are at work, and since when.
#[derive(Default)]
pub(super) struct Deadlines(Mutex<DeadlineState>);

#[derive(Default)]
struct DeadlineState {
    running: HashMap<usize, (Instant, Interrupt)>,
    ended: bool,
}

impl Deadlines {
    fn lock(&self) -> MutexGuard<'_, DeadlineState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the pair is to run under.
    pub(super) fn start(&self, index: usize) -> Interrupt {
        let interrupt = Interrupt::default();
        let mut watched = self.lock();
        if watched.ended {
            interrupt.request();
        }
        watched.running.insert(index, (Instant::now(), interrupt.clone()));
        interrupt
    }

    /// Whether all work is to end.
    pub(super) fn finish(&self, index: usize) -> bool {
        let mut watched = self.lock();
        watched.running.remove(&index);
        watched.ended
    }

    /// Ends those that are at it for longer than `limit`.
    pub(super) fn interrupt_late(&self, limit: Option<Duration>) {
        let Some(limit) = limit else { return };
        for (begun, interrupt) in self.lock().running.values() {
            if begun.elapsed() > limit {
                interrupt.request();
            }
        }
    }

    /// Ends them all, and those that are yet to begin.
    pub(super) fn interrupt_all(&self) {
        let mut watched = self.lock();
        watched.ended = true;
        watched.running.values().for_each(|(_, interrupt)| interrupt.request());
    }
}
