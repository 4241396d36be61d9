//! Panics within a pair: bugs, which cost that pair its answer and nothing else.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::par;

thread_local! {
    /// Where the last panic of this thread was.
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
    /// Whether panics of this thread are told by an error, and not printed.
    static CAUGHT: Cell<bool> = const { Cell::new(false) };
}

/// Has the row of a pair in which a panic happens say where, and nothing printed. It is the hook
/// of the whole process that is changed, once; panics elsewhere are printed as before.
pub fn install_panic_hook() {
    ROWS.store(true, Ordering::Relaxed);
    install();
}

/// Whether panics of pairs are told by their rows.
static ROWS: AtomicBool = AtomicBool::new(false);

/// Puts a hook before that of the process, once. It keeps to threads that say so.
fn install() {
    static ONCE: Once = Once::new();
    // No hook can be set by a thread that panics.
    if std::thread::panicking() {
        return;
    }
    ONCE.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if CAUGHT.get() {
                return;
            }
            match par::in_worker() && ROWS.load(Ordering::Relaxed) {
                true => PLACE.set(panic.location().map(ToString::to_string)),
                false => others(panic),
            }
        }));
    });
}

/// What `work` gives, or that it panicked, of which nothing is printed.
pub(super) fn caught<T>(work: impl FnOnce() -> T) -> Result<T, ()> {
    install();
    let before = CAUGHT.replace(true);
    let found = panic::catch_unwind(AssertUnwindSafe(work));
    CAUGHT.set(before);
    found.map_err(drop)
}

/// What a panic of this thread said.
pub(super) fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    let place = PLACE.take().map(|place| format!(" ({place})")).unwrap_or_default();
    format!("a bug, please report it: {text}{place}")
}
