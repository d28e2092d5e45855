//! Long work with the interpreter released, and somebody who listens for Ctrl-C meanwhile.

use crate::errors::{self, Lost};
use crate::inputs::whole;
use crate::lock::{enter, enter_if_free};
use ballast::step::MAX_THREADS;
use ballast_protocol::lockstep::said;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use std::cell::{Cell, OnceCell};
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::thread::{self, ThreadId};
use std::time::{Duration, Instant};

/// How often the calling thread looks for Ctrl-C and tells how far the work is.
const EVERY: Duration = Duration::from_millis(100);

thread_local! {
    /// Makes a thread of Python's the first worker of a pool: work that it begins there need not wait until another
    /// thread wakes up, nor the thread until work elsewhere has woken it. rayon does not give back the few kilobytes
    /// that this takes.
    static OWN: OnceCell<Team> = const { OnceCell::new() };
    /// Whether this thread listens in the midst of a step, for whose end the others of its pool wait.
    static IS_WITHIN_STEP: Cell<bool> = const { Cell::new(false) };
    /// Whose work this thread waits for, and listens meanwhile.
    static AWAITED: Cell<*const Team> = const { Cell::new(std::ptr::null()) };
}

/// A pool, and the process that has its threads: a fork of it has none of them.
struct Team {
    process: u32,
    pool: ThreadPool,
}

impl Team {
    fn of(pool: ThreadPool) -> Self {
        Self { process: std::process::id(), pool }
    }

    fn is_here(&self) -> bool {
        self.process == std::process::id()
    }
}

/// The threads that do long work.
#[derive(Clone)]
pub struct Crew {
    threads: usize,
    /// Without the calling thread, which listens.
    is_apart: bool,
    /// Those that work where the calling thread cannot be one of them, once they are needed.
    others: Arc<Mutex<Option<Arc<Team>>>>,
}

impl Crew {
    /// `threads` of them, the calling one included; one per processor unless told.
    pub fn new(py: Python<'_>, threads: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let expected = format!("1 to {MAX_THREADS}");
        let beyond = |py: Python<'_>, place: &str, expected: &str, found: &Bound<'_, PyAny>| {
            no_threads(py, &format!("{place}: expected {expected}, found {found}"))
        };
        let threads = match threads {
            Some(asked) => {
                match usize::try_from(whole(asked, "a whole number", "threads", &expected, beyond)?)
                {
                    Ok(threads) if (1..=MAX_THREADS).contains(&threads) => threads,
                    _ => return Err(beyond(py, "threads", &expected, asked)),
                }
            }
            None => std::thread::available_parallelism().map_err(|e| no_threads(py, &e))?.get(),
        };
        let crew = Self { threads, is_apart: false, others: Arc::default() };
        crew.workers().map_err(|e| no_threads(py, &e))?;
        Ok(crew)
    }

    /// One beside the calling thread.
    pub fn apart() -> Self {
        Self { threads: 1, is_apart: true, others: Arc::default() }
    }

    /// How many they are.
    pub fn threads(&self) -> usize {
        self.threads
    }

    /// Runs short work to its end.
    pub fn run<R: Send>(&self, py: Python<'_>, work: impl FnOnce() -> R + Send) -> PyResult<R> {
        self.expect_free(py)?;
        let done: Result<R, ThreadPoolBuildError> = py.detach(|| {
            Ok(match self.workers()? {
                None => work(),
                Some(others) => others.pool.install(work),
            })
        });
        done.map_err(|e| no_threads(py, &e))
    }

    /// A signal handler must not begin work that would wait for the end of what is at hand.
    ///
    /// # Errors
    /// [`errors::Error`] with the code "busy" there.
    pub fn expect_free(&self, py: Python<'_>) -> PyResult<()> {
        let awaited = AWAITED.get();
        let is_awaited = |team: &Arc<Team>| Arc::as_ptr(team) == awaited;
        // One that is apart waits for nobody.
        let is_busy = !self.is_apart
            && (IS_WITHIN_STEP.get() || enter(&self.others).as_ref().is_some_and(is_awaited));
        if !is_busy {
            return Ok(());
        }
        let text = "a signal handler can note the signal, or raise, but not compute with the threads that it interrupts";
        Err(errors::error::<errors::Error>(py, "busy", text))
    }

    /// The pool that works; none if the calling thread is one of the crew.
    fn workers(&self) -> Result<Option<Arc<Team>>, ThreadPoolBuildError> {
        if !self.is_apart && self.is_own()? {
            return Ok(None);
        }
        let mut others = enter(&self.others);
        if let Some(team) = others.as_ref().filter(|team| team.is_here()) {
            return Ok(Some(Arc::clone(team)));
        }
        let team = Arc::new(Team::of(pool(self.threads).build()?));
        // Nobody must wait for threads that the process it was forked from has.
        std::mem::forget(others.replace(Arc::clone(&team)));
        Ok(Some(team))
    }

    /// Whether the calling thread belongs to a pool of as many threads; it joins one if it is free, for good.
    fn is_own(&self) -> Result<bool, ThreadPoolBuildError> {
        OWN.with(|own| {
            // A worker of another pool calls back into Python.
            if own.get().is_none() && rayon::current_thread_index().is_none() {
                let pool = pool(self.threads).use_current_thread().build()?;
                own.get_or_init(|| Team::of(pool));
            }
            let fits = |own: &Team| own.pool.current_num_threads() == self.threads && own.is_here();
            Ok(own.get().is_some_and(fits))
        })
    }
}

fn pool(threads: usize) -> ThreadPoolBuilder {
    ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("ballast-{i}"))
}

fn no_threads(py: Python<'_>, error: &dyn Display) -> PyErr {
    errors::error::<errors::Error>(py, "threads", error)
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
    /// The calling thread, if the work runs on it, and when it listened last.
    listened: Mutex<Option<(ThreadId, Instant)>>,
}

impl Turn<'_> {
    /// A turn that is over once `is_over` is set, here or elsewhere.
    pub fn until(is_over: Arc<AtomicBool>) -> Self {
        Self { is_over, ..Self::default() }
    }

    /// Whether the work is to end at the next sound point.
    pub fn is_over(&self) -> bool {
        // Others of the crew ask too; Ctrl-C is not told to them.
        if let Some((caller, last)) = enter(&self.listened).as_mut()
            && last.elapsed() >= EVERY
            && *caller == thread::current().id()
        {
            self.listen();
            *last = Instant::now();
        }
        self.is_over.load(Ordering::Relaxed)
    }

    /// The same in the midst of a step.
    pub fn is_over_within_step(&self) -> bool {
        let was_within = IS_WITHIN_STEP.replace(true);
        let is_over = self.is_over();
        IS_WITHIN_STEP.set(was_within);
        is_over
    }

    /// Says how far the work is, 0 to 1; only the last word counts.
    pub fn tell(&self, share: f64, text: impl FnOnce() -> String) {
        if let Some(mut news) = enter_if_free(&self.news) {
            *news = Some((share, text()));
        }
    }

    /// Looks for Ctrl-C and passes the news on; the first exception ends the turn.
    fn listen(&self) {
        let mut raised = enter(&self.raised);
        if raised.is_some() {
            return;
        }
        let heard = Python::attach(|py| -> PyResult<()> {
            py.check_signals()?;
            // Taken before it is passed on: the work may tell more meanwhile.
            let news = enter(&self.news).take();
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
    attend(py, crew, &Turn { progress, ..Turn::default() }, work)
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
    crew.expect_free(py)?;
    let guarded = || catch_unwind(AssertUnwindSafe(|| work(turn)));
    let result: Result<_, ThreadPoolBuildError> = py.detach(|| {
        Ok(match crew.workers()? {
            None => {
                *enter(&turn.listened) = Some((thread::current().id(), Instant::now()));
                guarded()
            }
            Some(others) => listening(&others, turn, guarded),
        })
    });
    match result.map_err(|e| no_threads(py, &e))? {
        Ok(result) => Ok((result, enter(&turn.raised).take())),
        Err(panic) => Err(errors::error::<Lost>(py, "lost", said(panic.as_ref()))),
    }
}

/// Runs `work`, which does not panic, on the pool; the calling thread listens meanwhile.
fn listening<R: Send>(team: &Arc<Team>, turn: &Turn, work: impl FnOnce() -> R + Send) -> R {
    let (sender, receiver) = channel::<()>();
    let mut result = None;
    team.pool.in_place_scope(|scope| {
        let result = &mut result;
        scope.spawn(move |_| {
            *result = Some(work());
            // The scope waits for this thread; the word only wakes the listener.
            drop(sender);
        });
        while receiver.recv_timeout(EVERY) == Err(RecvTimeoutError::Timeout) {
            let before = AWAITED.replace(Arc::as_ptr(team));
            turn.listen();
            AWAITED.set(before);
        }
    });
    result.expect("the scope ends when the work has")
}
