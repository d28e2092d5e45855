//! Long computations with the interpreter released, while the calling thread handles signals and progress.

use crate::errors;
use crate::inputs::whole;
use crate::lock::{lock, try_lock};
use ballast::cancel::{CancelToken, StopReason};
use ballast::step::MAX_THREADS;
use ballast_protocol::lockstep::panic_message;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::cell::{Cell, OnceCell};
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

/// Interval at which the calling thread handles signals and reports progress.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

thread_local! {
    /// Pool whose first worker is this Python thread. Work that it submits starts without waking another thread. rayon
    /// never frees the few kilobytes that this takes.
    static OWN_POOL: OnceCell<ForkAwarePool> = const { OnceCell::new() };
    /// True while this thread handles signals within a step, whose end the other threads of its pool wait for.
    static IS_WITHIN_STEP: Cell<bool> = const { Cell::new(false) };
    /// Pool that this thread waits for while it handles signals.
    static AWAITED_POOL: Cell<*const ForkAwarePool> = const { Cell::new(std::ptr::null()) };
}

/// A thread pool and the process that owns its threads; a fork of the process has none of them.
struct ForkAwarePool {
    process: u32,
    pool: ThreadPool,
}

impl ForkAwarePool {
    fn new(pool: ThreadPool) -> Self {
        Self { process: std::process::id(), pool }
    }

    fn is_of_this_process(&self) -> bool {
        self.process == std::process::id()
    }
}

/// Handle to the threads that compute for a simulation.
#[derive(Clone)]
pub struct ThreadPoolHandle {
    threads: usize,
    /// True if the calling thread never computes.
    is_dedicated: bool,
    /// Pool for calling threads that are not workers themselves, created on demand.
    pool: Arc<Mutex<Option<Arc<ForkAwarePool>>>>,
}

impl ThreadPoolHandle {
    /// Returns a handle to `threads` threads including the calling one; by default one per processor.
    ///
    /// # Errors
    /// `Error` with the code "threads" if the number is out of range or the threads cannot be started.
    pub fn new(py: Python<'_>, threads: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let expected = format!("1 to {MAX_THREADS}");
        let out_of_range =
            |py: Python<'_>, place: &str, expected: &str, found: &Bound<'_, PyAny>| {
                thread_error(py, &format!("{place}: expected {expected}, found {found}"))
            };
        let threads = match threads {
            Some(found) => {
                let number = whole(found, "a whole number", "threads", &expected, out_of_range)?;
                match usize::try_from(number) {
                    Ok(threads) if (1..=MAX_THREADS).contains(&threads) => threads,
                    _ => return Err(out_of_range(py, "threads", &expected, found)),
                }
            }
            None => std::thread::available_parallelism().map_err(|e| thread_error(py, &e))?.get(),
        };
        let handle = Self { threads, is_dedicated: false, pool: Arc::default() };
        handle.workers().map_err(|e| thread_error(py, &e))?;
        Ok(handle)
    }

    /// Returns a handle to one thread other than the calling one.
    pub fn dedicated() -> Self {
        Self { threads: 1, is_dedicated: true, pool: Arc::default() }
    }

    /// Returns the number of threads.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Runs short work that cannot be interrupted.
    pub fn run<R: Send>(&self, py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
        self.check_available(py)?;
        let result: Result<R, ThreadPoolBuildError> = py.detach(|| {
            Ok(match self.workers()? {
                None => work(),
                Some(workers) => workers.pool.install(work),
            })
        });
        result.map_err(|e| thread_error(py, &e))
    }

    /// Checks that the calling thread may start work: a signal handler must not wait for the work that it interrupts.
    ///
    /// # Errors
    /// `Error` with the code "busy" in such a handler.
    pub fn check_available(&self, py: Python<'_>) -> PyResult<()> {
        let awaited = AWAITED_POOL.get();
        let is_awaited = |pool: &Arc<ForkAwarePool>| Arc::as_ptr(pool) == awaited;
        let is_busy = !self.is_dedicated
            && (IS_WITHIN_STEP.get() || lock(&self.pool).as_ref().is_some_and(is_awaited));
        if !is_busy {
            return Ok(());
        }
        let text = "threads: expected free threads, found those that this signal handler interrupts; \
                    set a flag or raise an exception in the handler";
        Err(errors::error::<errors::Error>(py, "busy", text))
    }

    /// Returns the pool that computes; none if the calling thread is one of the workers.
    fn workers(&self) -> Result<Option<Arc<ForkAwarePool>>, ThreadPoolBuildError> {
        if !self.is_dedicated && self.is_own_worker()? {
            return Ok(None);
        }
        let mut current = lock(&self.pool);
        if let Some(pool) = current.as_ref().filter(|pool| pool.is_of_this_process()) {
            return Ok(Some(Arc::clone(pool)));
        }
        let pool = Arc::new(ForkAwarePool::new(builder(self.threads).build()?));
        // Dropping the pool of the parent process would wait for threads that this process does not have.
        std::mem::forget(current.replace(Arc::clone(&pool)));
        Ok(Some(pool))
    }

    /// Returns true if the calling thread is a worker of a pool of this size; a free thread joins one for good.
    fn is_own_worker(&self) -> Result<bool, ThreadPoolBuildError> {
        OWN_POOL.with(|own| {
            // A worker of another pool may call back into Python.
            if own.get().is_none() && rayon::current_thread_index().is_none() {
                let pool = builder(self.threads).use_current_thread().build()?;
                own.get_or_init(|| ForkAwarePool::new(pool));
            }
            let fits = |own: &ForkAwarePool| {
                own.pool.current_num_threads() == self.threads && own.is_of_this_process()
            };
            Ok(own.get().is_some_and(fits))
        })
    }
}

fn builder(threads: usize) -> ThreadPoolBuilder {
    ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("ballast-{i}"))
}

fn thread_error(py: Python<'_>, error: &dyn Display) -> PyErr {
    errors::error::<errors::Error>(py, "threads", error)
}

/// Cancellation and progress of a computation, shared by its workers and the calling thread.
#[derive(Default)]
pub struct TaskControl<'a> {
    cancel: CancelToken,
    /// Callback `progress(fraction, text)`.
    progress: Option<&'a Py<PyAny>>,
    /// Latest progress that was not reported yet.
    latest: Mutex<Option<(f64, String)>>,
    /// Exception of a signal handler or of `progress`.
    raised: Mutex<Option<PyErr>>,
    /// The calling thread, if it computes, and the last time that it handled signals.
    last_poll: Mutex<Option<(ThreadId, Instant)>>,
}

impl TaskControl<'_> {
    /// Returns a control of a computation that `cancel` ends.
    pub fn new(cancel: CancelToken) -> Self {
        Self { cancel, ..Self::default() }
    }

    /// Returns true if the computation shall end at its next valid state. The calling thread also handles signals here.
    pub fn is_cancelled(&self) -> bool {
        // Only the calling thread can handle signals.
        if let Some((caller, last)) = lock(&self.last_poll).as_mut()
            && last.elapsed() >= POLL_INTERVAL
            && *caller == thread::current().id()
        {
            self.poll();
            *last = Instant::now();
        }
        self.cancel.reason().is_some()
    }

    /// Returns the same as [`TaskControl::is_cancelled`], for calls within a step.
    pub fn is_cancelled_within_step(&self) -> bool {
        let was_within = IS_WITHIN_STEP.replace(true);
        let is_cancelled = self.is_cancelled();
        IS_WITHIN_STEP.set(was_within);
        is_cancelled
    }

    /// Reports progress as a fraction from 0 to 1; only the latest report is shown.
    pub fn report(&self, fraction: f64, text: impl FnOnce() -> String) {
        if let Some(mut latest) = try_lock(&self.latest) {
            *latest = Some((fraction, text()));
        }
    }

    /// Handles signals and shows progress; the first exception cancels the computation.
    fn poll(&self) {
        let mut raised = lock(&self.raised);
        if raised.is_some() {
            return;
        }
        let result = Python::attach(|py| -> PyResult<()> {
            py.check_signals()?;
            // The lock is free during the callback: the workers may report meanwhile.
            let latest = lock(&self.latest).take();
            if let (Some(progress), Some(latest)) = (self.progress, latest) {
                progress.call1(py, latest)?;
            }
            Ok(())
        });
        if let Err(error) = result {
            *raised = Some(error);
            self.cancel.cancel(StopReason::Early);
        }
    }
}

/// Runs `work` with the interpreter released; signals and exceptions of `progress(fraction, text)` cancel it.
///
/// Returns the result of the work, and the exception that the caller must raise.
///
/// # Errors
/// [`errors::InternalError`] if the work panics.
pub fn run_interruptible<R: Send>(
    py: Python<'_>,
    threads: &ThreadPoolHandle,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&TaskControl) -> R + Send,
) -> PyResult<(R, Option<PyErr>)> {
    run_controlled(py, threads, &TaskControl { progress, ..TaskControl::default() }, work)
}

/// Runs `work` as [`run_interruptible`] does, with a given control.
///
/// # Errors
/// See [`run_interruptible`].
pub fn run_controlled<R: Send>(
    py: Python<'_>,
    threads: &ThreadPoolHandle,
    control: &TaskControl,
    work: impl FnOnce(&TaskControl) -> R + Send,
) -> PyResult<(R, Option<PyErr>)> {
    threads.check_available(py)?;
    let guarded = || catch_unwind(AssertUnwindSafe(|| work(control)));
    let result: Result<_, ThreadPoolBuildError> = py.detach(|| {
        Ok(match threads.workers()? {
            None => {
                *lock(&control.last_poll) = Some((thread::current().id(), Instant::now()));
                guarded()
            }
            Some(workers) => run_polled(&workers, control, guarded),
        })
    });
    match result.map_err(|e| thread_error(py, &e))? {
        Ok(result) => Ok((result, lock(&control.raised).take())),
        Err(panic) => Err(errors::internal(py, panic_message(panic.as_ref()))),
    }
}

/// Runs `work`, which does not panic, on the pool, while the calling thread handles signals and progress.
fn run_polled<R: Send>(
    workers: &Arc<ForkAwarePool>,
    control: &TaskControl,
    work: impl FnOnce() -> R + Send,
) -> R {
    let (sender, receiver) = channel::<()>();
    let mut result = None;
    workers.pool.in_place_scope(|scope| {
        let result = &mut result;
        scope.spawn(move |_| {
            *result = Some(work());
            // Wakes the calling thread.
            drop(sender);
        });
        while receiver.recv_timeout(POLL_INTERVAL) == Err(RecvTimeoutError::Timeout) {
            let before = AWAITED_POOL.replace(Arc::as_ptr(workers));
            control.poll();
            AWAITED_POOL.set(before);
        }
    });
    result.expect("the scope ends after the work")
}
