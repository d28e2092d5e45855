//! Long work with the interpreter released, and somebody who listens for Ctrl-C meanwhile.

use crate::errors::{self, Lost};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::any::Any;
use std::cell::OnceCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often the calling thread looks for Ctrl-C and tells how far the work is.
const EVERY: Duration = Duration::from_millis(100);

thread_local! {
    /// Makes a thread of Python's the one worker of a pool: what the core does in parallel stays on it. rayon
    /// does not give back the few kilobytes that this takes.
    static ALONE: OnceCell<ThreadPool> = const { OnceCell::new() };
}

/// The threads that do long work.
#[derive(Clone)]
pub enum Crew {
    /// The calling one: a short window need not wait until another wakes up.
    Caller,
    /// Others; the calling one waits and listens.
    Workers(Arc<ThreadPool>),
}

impl Crew {
    /// `threads` of them; one per processor unless told.
    pub fn new(py: Python<'_>, threads: Option<usize>) -> PyResult<Self> {
        if threads == Some(1) { Ok(Self::Caller) } else { Self::workers(py, threads) }
    }

    /// The same, beside the calling one.
    pub fn workers(py: Python<'_>, threads: Option<usize>) -> PyResult<Self> {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads.unwrap_or(0))
            .thread_name(|i| format!("ballast-{i}"))
            .build();
        pool.map(|pool| Self::Workers(Arc::new(pool))).map_err(|e| no_threads(py, &e))
    }

    /// How many they are.
    pub fn threads(&self) -> usize {
        match self {
            Self::Caller => 1,
            Self::Workers(pool) => pool.current_num_threads(),
        }
    }

    /// Runs short work to its end.
    pub fn run<R: Send>(&self, py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
        let done = py.detach(|| match self {
            Self::Caller => alone(work),
            Self::Workers(pool) => Ok(pool.install(work)),
        });
        done.map_err(|e| no_threads(py, &e))
    }
}

fn no_threads(py: Python<'_>, error: &ThreadPoolBuildError) -> PyErr {
    errors::error::<errors::Error>(py, "threads", error)
}

/// Runs `work` on the calling thread, and on no other.
fn alone<R>(work: impl FnOnce() -> R) -> Result<R, ThreadPoolBuildError> {
    ALONE.with(|alone| {
        if alone.get().is_none() {
            let pool = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build()?;
            alone.get_or_init(|| pool);
        }
        Ok(())
    })?;
    Ok(work())
}

/// What the work and the calling thread tell each other.
#[derive(Default)]
pub struct Turn<'a> {
    is_over: Arc<AtomicBool>,
    /// Told `(share, text)`.
    progress: Option<&'a Py<PyAny>>,
    news: Mutex<Option<(f64, String)>>,
    /// Ctrl-C, or an exception of `progress`.
    raised: Mutex<Option<PyErr>>,
    /// When the work listened last, if it runs on the calling thread.
    listened: Option<Mutex<Instant>>,
}

impl Turn<'_> {
    /// A turn that is over once `is_over` is set, here or elsewhere.
    pub fn until(is_over: Arc<AtomicBool>) -> Self {
        Self { is_over, ..Self::default() }
    }

    /// Whether the work is to end at the next sound point.
    pub fn is_over(&self) -> bool {
        if let Some(listened) = &self.listened {
            let mut listened = sound(listened);
            if listened.elapsed() >= EVERY {
                self.listen();
                *listened = Instant::now();
            }
        }
        self.is_over.load(Ordering::Relaxed)
    }

    /// Says how far the work is, 0 to 1; only the last word counts.
    pub fn tell(&self, share: f64, text: impl FnOnce() -> String) {
        if let Ok(mut news) = self.news.try_lock() {
            *news = Some((share, text()));
        }
    }

    /// Looks for Ctrl-C and passes the news on; the first exception ends the turn.
    fn listen(&self) {
        let mut raised = sound(&self.raised);
        if raised.is_some() {
            return;
        }
        let heard = Python::attach(|py| -> PyResult<()> {
            py.check_signals()?;
            // Taken before it is passed on: the work may tell more meanwhile.
            let news = sound(&self.news).take();
            if let (Some(progress), Some(news)) = (self.progress, news) {
                progress.call1(py, news)?;
            }
            Ok(())
        });
        if let Err(error) = heard {
            *raised = Some(error);
            self.is_over.store(true, Ordering::Relaxed);
        }
    }
}

/// What a panic elsewhere has left is as good as before: nothing here is half written.
fn sound<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs `work` with the interpreter released.
///
/// Ctrl-C, or an exception of `progress(share, text)`, asks the work to end, and is given back beside what came of
/// the work, for the caller to raise.
///
/// # Errors
/// [`Lost`] if the work panics.
pub fn compute<R: Send>(
    py: Python<'_>,
    crew: &Crew,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Turn) -> R + Send,
) -> PyResult<(R, Option<PyErr>)> {
    let listened = matches!(crew, Crew::Caller).then(|| Mutex::new(Instant::now()));
    attend(py, crew, &Turn { progress, listened, ..Turn::default() }, work)
}

/// The same, in a given turn.
///
/// # Errors
/// As for [`compute`].
pub fn attend<R: Send>(
    py: Python<'_>,
    crew: &Crew,
    turn: &Turn,
    work: impl FnOnce(&Turn) -> R + Send,
) -> PyResult<(R, Option<PyErr>)> {
    let guarded = || catch_unwind(AssertUnwindSafe(|| work(turn)));
    let result = py.detach(|| match crew {
        Crew::Caller => alone(guarded),
        Crew::Workers(pool) => Ok(listening(pool, turn, guarded)),
    });
    match result.map_err(|e| no_threads(py, &e))? {
        Ok(result) => Ok((result, sound(&turn.raised).take())),
        Err(panic) => Err(errors::error::<Lost>(py, "lost", said(panic.as_ref()))),
    }
}

/// Runs `work`, which does not panic, on the pool; the calling thread listens meanwhile.
fn listening<R: Send>(pool: &ThreadPool, turn: &Turn, work: impl FnOnce() -> R + Send) -> R {
    let (sender, receiver) = channel::<()>();
    let mut result = None;
    pool.in_place_scope(|scope| {
        let result = &mut result;
        scope.spawn(move |_| {
            *result = Some(work());
            // The scope waits for this thread; the word only wakes the listener.
            drop(sender);
        });
        while receiver.recv_timeout(EVERY) == Err(RecvTimeoutError::Timeout) {
            turn.listen();
        }
    });
    result.expect("the scope ends when the work has")
}

/// The text of a panic.
fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    format!("the program failed inside: {}", text.unwrap_or("it did not say why"))
}
