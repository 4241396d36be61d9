//! Running pairs and their start times, for time limits and for the end of a run.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use crate::par::{self, Interrupt};

/// The running pairs and their start times.
#[derive(Default)]
pub(super) struct Deadlines(Mutex<DeadlineState>);

#[derive(Default)]
struct DeadlineState {
    running: HashMap<usize, (Instant, Interrupt)>,
    ended: bool,
}

impl Deadlines {
    fn lock(&self) -> MutexGuard<'_, DeadlineState> {
        par::lock(&self.0)
    }

    /// Registers the start of a pair and returns its interrupt.
    pub(super) fn start(&self, index: usize) -> Interrupt {
        let interrupt = Interrupt::default();
        let mut watched = self.lock();
        if watched.ended {
            interrupt.request();
        }
        watched.running.insert(index, (Instant::now(), interrupt.clone()));
        interrupt
    }

    /// Registers the end of a pair and returns whether all work is to end.
    pub(super) fn finish(&self, index: usize) -> bool {
        let mut watched = self.lock();
        watched.running.remove(&index);
        watched.ended
    }

    /// Interrupts the pairs that run longer than `limit`.
    pub(super) fn interrupt_late(&self, limit: Option<Duration>) {
        let Some(limit) = limit else { return };
        for (begun, interrupt) in self.lock().running.values() {
            if begun.elapsed() > limit {
                interrupt.request();
            }
        }
    }

    /// Interrupts all pairs, including those that start later.
    pub(super) fn interrupt_all(&self) {
        let mut watched = self.lock();
        watched.ended = true;
        watched.running.values().for_each(|(_, interrupt)| interrupt.request());
    }
}
