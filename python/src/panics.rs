//! Conversion of panics of the crate, which are bugs, to exceptions of the package.
//!
//! The hook set here applies to this extension module alone: it is linked with its own standard
//! library, so that other modules of the process print as before.

use std::any::Any;
use std::env;
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;

use super::errors::InternalError;

/// Where the last panic of the process was. A panic may travel from a thread of a pool to the one
/// that waits for it, and has lost its place there.
static PANIC_LOCATION: Mutex<Option<String>> = Mutex::new(None);

/// Has panics note their place and print nothing, unless `RUST_BACKTRACE` asks for it.
pub(super) fn install_panic_hook() {
    let printing = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        let place = panic.location().map(ToString::to_string);
        *PANIC_LOCATION.lock().unwrap_or_else(PoisonError::into_inner) = place;
        if env::var_os("RUST_BACKTRACE").is_some_and(|asked| asked != "0") {
            printing(panic);
        }
    }));
}

/// Runs `work`; a panic in it becomes an exception.
pub(super) fn catch_panic<T>(work: impl FnOnce() -> T) -> PyResult<T> {
    // What `work` held when it panicked is dropped, and seen by nobody.
    catch_unwind(AssertUnwindSafe(work)).map_err(panic_to_pyerr)
}

/// The exception for what a thread panicked with.
pub(super) fn panic_to_pyerr(panic: Box<dyn Any + Send>) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no message");
    let place = PANIC_LOCATION.lock().unwrap_or_else(PoisonError::into_inner).take();
    let place = place.map(|place| format!(" ({place})")).unwrap_or_default();
    InternalError::new_err(format!("a bug in cfreg, please report it: {text}{place}"))
}

/// Registers a function that panics, for tests: only in development builds, and not among the
/// public names.
#[cfg(debug_assertions)]
pub(super) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.setattr("_panic", wrap_pyfunction!(panic_for_tests, module)?)
}

/// Panic in long work, in a loop on several threads, without the interpreter or on the way there.
#[cfg(debug_assertions)]
#[pyfunction]
#[pyo3(name = "_panic")]
fn panic_for_tests(py: Python<'_>, place: &str) -> PyResult<()> {
    match place {
        "work" => super::gil::run_interruptible(py, || {
            fail(place);
            Ok(())
        }),
        "loop" => super::gil::run_interruptible(py, || {
            cfreg::par::map(64, || (), |_, _| fail(place));
            Ok(())
        }),
        "detached" => super::shutdown::detach(py, || fail(place)),
        _ => catch_panic(|| fail(place)),
    }
}

#[cfg(debug_assertions)]
fn fail(place: &str) {
    panic!("asked for in {place}")
}
