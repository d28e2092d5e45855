//! Who is in the midst of a call of a simulation, and how others have that call ended.

use crate::lock::enter;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};

/// The work on a simulation: of one thread at a time.
#[derive(Default)]
pub struct Work {
    /// What is at hand is to end: a window within its step, a wait for another process within a moment.
    pub is_over: Arc<AtomicBool>,
    /// Process and thread that are at it: a fork has none of the threads.
    at: Mutex<Option<(u32, ThreadId)>>,
    /// Nothing is begun any more.
    is_closing: AtomicBool,
}

/// A call, until it is dropped.
pub struct Call<'a>(&'a Work);

impl Drop for Call<'_> {
    fn drop(&mut self) {
        *enter(&self.0.at) = None;
    }
}

impl Work {
    /// Begins a call of the one thread that may make one.
    pub fn begin(&self) -> Call<'_> {
        self.begin_as(self.is_closing())
    }

    /// Begins the last call, after [`Work::close`].
    pub fn begin_last(&self) -> Call<'_> {
        self.begin_as(false)
    }

    fn begin_as(&self, is_over: bool) -> Call<'_> {
        let mut at = enter(&self.at);
        *at = Some((process::id(), thread::current().id()));
        self.is_over.store(is_over, Ordering::Relaxed);
        Call(self)
    }

    /// Asks the call at hand, where there is one, to end.
    pub fn stop(&self) {
        let at = enter(&self.at);
        self.is_over.fetch_or(at.is_some(), Ordering::Relaxed);
    }

    /// The same, and nothing is begun any more; false, and nothing is done, where the call at hand could not be waited
    /// for: it is one of this thread's own, or of a process that this one was forked from.
    pub fn close(&self) -> bool {
        let at = enter(&self.at);
        let is_elsewhere =
            |at: (u32, ThreadId)| at.0 == process::id() && at.1 != thread::current().id();
        let can_wait = at.is_none_or(is_elsewhere);
        if can_wait {
            // Who begins a call after this finds it told.
            self.is_closing.store(true, Ordering::Relaxed);
            self.is_over.fetch_or(at.is_some(), Ordering::Relaxed);
        }
        can_wait
    }

    pub fn is_closing(&self) -> bool {
        self.is_closing.load(Ordering::Relaxed)
    }
}
