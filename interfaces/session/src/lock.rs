//! Locks.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Takes a lock, whatever happened to its last holder.
pub fn enter<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}
