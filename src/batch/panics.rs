//! Panics within a pair: bugs, which cost that pair its answer and nothing else.

use std::any::Any;
use std::cell::RefCell;
use std::panic;
use std::sync::Once;

use crate::par;

thread_local! {
    /// Where the last panic of this thread was.
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Has the row of a pair in which a panic happens say where, and nothing printed. It is the hook
/// of the whole process that is changed, once; panics elsewhere are printed as before.
pub fn panics_go_to_rows() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let others = panic::take_hook();
        panic::set_hook(Box::new(move |panic| match par::in_crew() {
            true => PLACE.set(panic.location().map(ToString::to_string)),
            false => others(panic),
        }));
    });
}

/// What a panic of this thread said.
pub(super) fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    let place = PLACE.take().map(|place| format!(" ({place})")).unwrap_or_default();
    format!("a bug, please report it: {text}{place}")
}
