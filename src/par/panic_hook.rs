//! Panics that become errors: of a pair of `batch`, which fail that pair and nothing else, and of
//! crates that read damaged files.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use super::in_worker;

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
            match in_worker() && RECORD_IN_ROWS.load(Ordering::Relaxed) {
                true => PANIC_LOCATION.set(panic.location().map(ToString::to_string)),
                false => others(panic),
            }
        }));
    });
}

/// Returns the result of `work`, or its panic; nothing is printed.
pub(crate) fn catch_panic<T>(work: impl FnOnce() -> T) -> std::thread::Result<T> {
    install_once();
    let before = IS_SILENT.replace(true);
    let found = panic::catch_unwind(AssertUnwindSafe(work));
    IS_SILENT.set(before);
    found
}

/// Returns the text of a panic.
pub(crate) fn panic_text(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message")
}

/// Returns the message of a panic of this thread, with its place if that was recorded.
pub(crate) fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic_text(panic);
    let place = PANIC_LOCATION.take().map(|place| format!(" ({place})")).unwrap_or_default();
    format!("a bug, please report it: {text}{place}")
}
