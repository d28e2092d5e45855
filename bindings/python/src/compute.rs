//! Long work beside the interpreter: on a pool of threads, while the calling thread listens for Ctrl-C.

use crate::errors::{self, Lost};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often the calling thread looks for Ctrl-C and tells how far the work is.
const EVERY: Duration = Duration::from_millis(100);

/// What the work and the calling thread tell each other.
#[derive(Default)]
pub struct Turn {
    is_over: Arc<AtomicBool>,
    news: Mutex<Option<(f64, String)>>,
}

impl Turn {
    /// A turn that is over once `is_over` is set, here or elsewhere.
    pub fn until(is_over: Arc<AtomicBool>) -> Self {
        Self { is_over, ..Self::default() }
    }

    /// Whether the work is to end at the next sound point.
    pub fn is_over(&self) -> bool {
        self.is_over.load(Ordering::Relaxed)
    }

    /// Says how far the work is, 0 to 1; only the last word counts.
    pub fn tell(&self, share: f64, text: impl FnOnce() -> String) {
        if let Ok(mut news) = self.news.try_lock() {
            *news = Some((share, text()));
        }
    }

    fn news(&self) -> Option<(f64, String)> {
        self.news.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// A pool of `threads` workers; one per processor unless told.
pub fn pool(py: Python<'_>, threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads.unwrap_or(0))
        .thread_name(|i| format!("ballast-{i}"))
        .build();
    pool.map(Arc::new).map_err(|e| errors::error::<errors::Error>(py, "threads", e))
}

/// Runs `work` on the pool with the interpreter released.
///
/// Ctrl-C, or an exception of `progress(share, text)`, asks the work to end, and is given back beside what came of
/// the work, for the caller to raise.
///
/// # Errors
/// [`Lost`] if the work panics.
pub fn compute<R: Send>(
    py: Python<'_>,
    pool: &ThreadPool,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Turn) -> R + Send,
) -> PyResult<(R, Option<PyErr>)> {
    attend(py, pool, progress, &Turn::default(), work)
}

/// The same, in a given turn.
///
/// # Errors
/// As for [`compute`].
pub fn attend<R: Send>(
    py: Python<'_>,
    pool: &ThreadPool,
    progress: Option<&Py<PyAny>>,
    turn: &Turn,
    work: impl FnOnce(&Turn) -> R + Send,
) -> PyResult<(R, Option<PyErr>)> {
    let listen = || -> PyResult<()> {
        Python::attach(|py| {
            py.check_signals()?;
            if let (Some(progress), Some(news)) = (progress, turn.news()) {
                progress.call1(py, news)?;
            }
            Ok(())
        })
    };
    let (result, raised) = py.detach(|| {
        let (sender, receiver) = channel();
        pool.in_place_scope(|scope| {
            scope.spawn(|_| {
                let result = catch_unwind(AssertUnwindSafe(|| work(turn)));
                // Nobody has gone: the scope waits for this thread.
                let _ = sender.send(result);
            });
            let mut raised = None;
            loop {
                match receiver.recv_timeout(EVERY) {
                    Ok(result) => return (Some(result), raised),
                    Err(RecvTimeoutError::Disconnected) => return (None, raised),
                    Err(RecvTimeoutError::Timeout) if raised.is_none() => {
                        raised = listen().err();
                        turn.is_over.store(raised.is_some(), Ordering::Relaxed);
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    });
    match result {
        Some(Ok(result)) => Ok((result, raised)),
        Some(Err(panic)) => Err(errors::error::<Lost>(py, "lost", said(panic.as_ref()))),
        None => Err(errors::error::<Lost>(py, "lost", "the work ended without a word")),
    }
}

/// The text of a panic.
fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    format!("the program failed inside: {}", text.unwrap_or("it did not say why"))
}
