//! Locks whose owner may have unwound.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Locks a mutex; a thread that unwound with it has left its data whole.
pub(crate) fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
