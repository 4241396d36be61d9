//! Panics within a pair: bugs, which cost that pair its answer and nothing else.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::par;

thread_local! {
    /// Where the last panic of this thread was.
    static PANIC_LOCATION: RefCell<Option<String>> = const { RefCell::new(None) };
    /// Whether panics of this thread are told by an error, and not printed.
    static IS_SILENT: Cell<bool> = const { Cell::new(false) };
}

/// Has the row of a pair in which a panic happens say where, and nothing printed. It is the hook
/// of the whole process that is changed, once; panics elsewhere are printed as before.
pub fn install_panic_hook() {
    RECORD_IN_ROWS.store(true, Ordering::Relaxed);
    install_once();
}

/// Whether panics of pairs are told by their rows.
static RECORD_IN_ROWS: AtomicBool = AtomicBool::new(false);

/// Puts a hook before that of the process, once. It keeps to threads that say so.
fn install_once() {
    static ONCE: Once = Once::new();
    // No hook can be set by a thread that panics.
    if std::thread::panicking() {
        return;
    }
    ONCE.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |panic| {
            if IS_SILENT.get() {
                return;
            }
            match par::in_worker() && RECORD_IN_ROWS.load(Ordering::Relaxed) {
                true => PANIC_LOCATION.set(panic.location().map(ToString::to_string)),
                false => others(panic),
            }
        }));
    });
}

/// What `work` gives, or that it panicked, of which nothing is printed.
pub(super) fn catch_panic<T>(work: impl FnOnce() -> T) -> Result<T, ()> {
    install_once();
    let before = IS_SILENT.replace(true);
    let found = panic::catch_unwind(AssertUnwindSafe(work));
    IS_SILENT.set(before);
    found.map_err(drop)
}

/// What a panic of this thread said.
pub(super) fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    let place = PANIC_LOCATION.take().map(|place| format!(" ({place})")).unwrap_or_default();
    format!("a bug, please report it: {text}{place}")
}
