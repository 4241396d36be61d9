//! Panics within a pair: bugs, which fail that pair and nothing else.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::par;

thread_local! {
    /// Location of the last panic of this thread.
    static PANIC_LOCATION: RefCell<Option<String>> = const { RefCell::new(None) };
    /// Whether panics of this thread become an error and are not printed.
    static IS_SILENT: Cell<bool> = const { Cell::new(false) };
}

/// Installs a process-wide panic hook, once, that records the location of a panic within a pair in
/// its row and prints nothing. Panics elsewhere are printed as before.
pub fn install_panic_hook() {
    RECORD_IN_ROWS.store(true, Ordering::Relaxed);
    install_once();
}

/// Whether panics of pairs are recorded in their rows.
static RECORD_IN_ROWS: AtomicBool = AtomicBool::new(false);

/// Installs a hook before that of the process, once. It acts only on threads that request it.
fn install_once() {
    static ONCE: Once = Once::new();
    // A thread that panics cannot set a hook.
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

/// Returns the result of `work`, or an error if it panicked; nothing is printed.
pub(super) fn catch_panic<T>(work: impl FnOnce() -> T) -> Result<T, ()> {
    install_once();
    let before = IS_SILENT.replace(true);
    let found = panic::catch_unwind(AssertUnwindSafe(work));
    IS_SILENT.set(before);
    found.map_err(drop)
}

/// Returns the message of a panic of this thread.
pub(super) fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    let place = PANIC_LOCATION.take().map(|place| format!(" ({place})")).unwrap_or_default();
    format!("a bug, please report it: {text}{place}")
}
