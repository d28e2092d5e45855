//! The running call of a simulation, and its cancellation by other threads.

use crate::lock::lock;
use ballast::cancel::{CancelToken, StopReason};
use std::process;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, ThreadId};

/// State of the calls of a simulation; one thread at a time makes a call.
#[derive(Default)]
pub struct CallState {
    /// Cancels the running call: a window within its step, a wait for a remote reply within a moment.
    pub cancel: CancelToken,
    /// Process and thread of the running call; a fork of the process has no such thread.
    caller: Mutex<Option<(u32, ThreadId)>>,
    /// No further call begins.
    is_closing: AtomicBool,
}

/// A running call, until it is dropped.
pub struct CallGuard<'a>(&'a CallState);

impl Drop for CallGuard<'_> {
    fn drop(&mut self) {
        *lock(&self.0.caller) = None;
    }
}

impl CallState {
    /// Begins a call; it is cancelled at once after [`CallState::close`].
    pub fn begin(&self) -> CallGuard<'_> {
        let call = self.begin_last();
        if self.is_closing() {
            self.cancel.cancel(StopReason::Early);
        }
        call
    }

    /// Begins the last call, after [`CallState::close`].
    pub fn begin_last(&self) -> CallGuard<'_> {
        let mut caller = lock(&self.caller);
        *caller = Some((process::id(), thread::current().id()));
        self.cancel.reset();
        CallGuard(self)
    }

    /// Cancels the running call, if there is one.
    pub fn stop(&self) {
        self.cancel_running(*lock(&self.caller));
    }

    fn cancel_running(&self, caller: Option<(u32, ThreadId)>) {
        if caller.is_some() {
            self.cancel.cancel(StopReason::Early);
        }
    }

    /// Cancels the running call and all later ones.
    ///
    /// Returns false, without effect, if the caller could not wait for the running call: it belongs to the same thread, or to
    /// a process that this one was forked from.
    pub fn close(&self) -> bool {
        let caller = lock(&self.caller);
        let is_other_thread = |(process, thread): (u32, ThreadId)| {
            process == process::id() && thread != thread::current().id()
        };
        let can_wait = caller.is_none_or(is_other_thread);
        if can_wait {
            self.is_closing.store(true, Ordering::Relaxed);
            self.cancel_running(*caller);
        }
        can_wait
    }

    /// Returns true after [`CallState::close`].
    pub fn is_closing(&self) -> bool {
        self.is_closing.load(Ordering::Relaxed)
    }
}
