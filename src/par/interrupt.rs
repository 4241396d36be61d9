//! Interruption of work from another thread.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, Result};

/// A request by one thread to end work in others.
///
/// Work sees the request at the next step of a parallel loop, or at a [`checkpoint`], and unwinds
/// from there, so that no function in between needs to know of it. Results do not depend on whether
/// work could be interrupted.
///
/// ```
/// use cfreg::{Error, par};
/// let interrupt = par::Interrupt::default();
/// assert_eq!(interrupt.guard(|| par::map(3, || (), |_, i| i))?, [0, 1, 2]);
/// interrupt.request();
/// let stopped = interrupt.guard(|| par::map(3, || (), |_, i| i));
/// assert!(matches!(stopped, Err(Error::Interrupted)));
/// # Ok::<(), Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

/// Payload of the unwinding; it never leaves [`Interrupt::guard`].
struct InterruptUnwind;

thread_local! {
    /// The interrupt under which this thread works.
    static CURRENT: RefCell<Option<Interrupt>> = const { RefCell::new(None) };
}

impl Interrupt {
    /// Requests that all work under this interrupt ends, now and in future.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns whether an end was requested.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Runs `work` under this interrupt, instead of the caller's interrupt if there is one.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when `work` was ended early, by a [`request`](Self::request) or by a
    /// [`stop`].
    pub fn guard<T>(&self, work: impl FnOnce() -> T) -> Result<T> {
        // Values that `work` owned when it was ended are dropped, and nobody sees them.
        let guarded = AssertUnwindSafe(|| {
            let _entered = enter(&Some(self.clone()));
            work()
        });
        catch_unwind(guarded).map_err(|panic| match panic.is::<InterruptUnwind>() {
            true => Error::Interrupted,
            false => resume_unwind(panic),
        })
    }

    /// Returns the interrupt under which the caller works, to pass it to other threads.
    pub(super) fn current() -> Option<Interrupt> {
        CURRENT.with_borrow(Option::clone)
    }
}

/// Guard: this thread works under an interrupt as long as the guard exists.
pub(super) struct InterruptScope {
    before: Option<Interrupt>,
}

/// Continues work of another thread in this thread, under the interrupt of that thread.
pub(super) fn enter(interrupt: &Option<Interrupt>) -> InterruptScope {
    InterruptScope { before: CURRENT.replace(interrupt.clone()) }
}

impl Drop for InterruptScope {
    fn drop(&mut self) {
        CURRENT.set(self.before.take());
    }
}

/// Ends the work of this thread here if an end was requested: for long stretches without a parallel
/// loop.
pub fn checkpoint() {
    if is_interrupt_requested() {
        stop();
    }
}

/// Returns whether this thread has been asked to end its work: for code that cannot unwind.
pub fn is_interrupt_requested() -> bool {
    CURRENT.with_borrow(|current| current.as_ref().is_some_and(Interrupt::is_requested))
}

/// Ends all work up to the enclosing [`guard`](Interrupt::guard), from within: for weights that
/// fail. Without a guard it is a panic without a message.
pub fn stop() -> ! {
    // Not a panic: no hook is called and nothing is printed.
    resume_unwind(Box::new(InterruptUnwind))
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;
    use std::time::Duration;

    use super::*;
    use crate::par::{map, on_new_thread, with_threads};

    /// Runs nested loops, in several pools, for longer than any test may take.
    fn endless(begun: &mpsc::Sender<()>) {
        let inner = |_: &mut (), _| {
            begun.send(()).unwrap();
            map(1_000_000, || (), |_, _| std::thread::sleep(Duration::from_millis(1)))
        };
        let outer = || map(1_000_000, || (), inner);
        with_threads(2, || on_new_thread(outer).unwrap()).unwrap();
    }

    #[test]
    fn a_request_ends_work_in_every_thread() {
        let interrupt = Interrupt::default();
        let (begun, wait) = mpsc::channel();
        std::thread::scope(|scope| {
            let worker = scope.spawn(|| interrupt.guard(|| endless(&begun)));
            wait.recv().unwrap();
            interrupt.request();
            assert!(matches!(worker.join().unwrap(), Err(Error::Interrupted)));
        });
        assert!(Interrupt::current().is_none());
    }

    #[test]
    fn other_work_on_the_same_threads_goes_on() {
        let (mine, other) = (Interrupt::default(), Interrupt::default());
        mine.request();
        let nested = || other.guard(|| map(10, || (), |_, i| i)).unwrap();
        assert_eq!(nested().len(), 10);
        assert!(mine.guard(checkpoint).is_err() && other.guard(checkpoint).is_ok());
        // Outside a guard nobody requests an end.
        checkpoint();
    }

    #[test]
    fn panics_are_not_swallowed() {
        let panicked = catch_unwind(|| Interrupt::default().guard(|| panic!("a bug")));
        assert!(panicked.is_err());
    }
}
