//! Dependency-driven scheduler for Gauss-Seidel sweeps over subdomains and interface groups.
//!
//! Reads: the interface. Writes: its counters; the caller visits the sets. Cost: two counters per visit, and a lock for
//! some. Contract: sets that share a body are visited in the same order as with a barrier after the subdomains and one
//! after each colour, so results are bitwise identical for any number of threads.
//!
//! In a pass each subdomain is visited, then each group of the interface, colour by colour. A group becomes ready when
//! both of its subdomains have reached it. A subdomain starts its next pass after its last group, whatever remains to
//! be done elsewhere.
//!
//! Each ready subdomain goes to the thread that visited it last (cache affinity). An idle thread steals after
//! [`POLLS_BEFORE_STEAL`] polls and parks after [`POLLS_BEFORE_PARK`].
//!
//! Passes are issued in batches. At the end of a batch no visit is running, and the thread that ended the last visit
//! calls `next` to obtain the following batch while the others wait.

use crate::partition::Interface;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError, RwLock};

/// Polls of an idle thread for its own sets before it steals: some microseconds, less than fetching what another
/// thread has in its caches.
const POLLS_BEFORE_STEAL: u32 = 50;
/// Polls of an idle thread before it parks: about as long as a wake-up takes.
const POLLS_BEFORE_PARK: u32 = 1000;

/// Visit of one set in one pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SweepTask {
    /// Number of the set, subdomains first.
    pub set: usize,
    /// True if the set is a group of the interface.
    pub is_interface: bool,
    /// Number of the pass, from 0 in each batch.
    pub pass: u32,
}

/// Number of passes, and the plan that their visits follow.
#[derive(Debug, Clone, Copy)]
pub(super) struct PassBatch<P> {
    pub passes: u32,
    pub plan: P,
}

/// Scheduler of the visits of a run; reused for its memory and the affinity of subdomains to threads.
#[derive(Debug, Default)]
pub(super) struct SweepScheduler {
    /// Arrivals of subdomains at each group since the run began: every second one makes the group ready.
    arrivals: Vec<AtomicU32>,
    /// Passes of the current batch that each subdomain has finished.
    passes: Vec<AtomicU32>,
    /// Thread that visited each subdomain last.
    affinity: Vec<AtomicUsize>,
    /// Number of subdomains that have passes of the current batch left.
    unfinished: AtomicUsize,
    queue: ReadyQueue,
}

/// Sets that are ready and not taken, by the threads that are to visit them.
#[derive(Debug, Default)]
struct ReadyQueue {
    sets: Mutex<Vec<VecDeque<usize>>>,
    /// Number of sets of each thread, readable without the lock.
    counts: Vec<AtomicUsize>,
    parked: AtomicUsize,
    wakeup: Condvar,
    /// True if no set will follow.
    is_closed: AtomicBool,
}

impl ReadyQueue {
    /// Empties the queue and reserves memory for the given numbers of threads and subdomains.
    fn reset(&mut self, threads: usize, subdomains: usize) {
        let sets = self.sets.get_mut().unwrap_or_else(PoisonError::into_inner);
        sets.resize_with(threads, VecDeque::default);
        for of_thread in &mut *sets {
            of_thread.clear();
            // No more than these wait at once, so a run allocates nothing.
            of_thread.reserve(subdomains);
        }
        self.counts.clear();
        self.counts.resize_with(threads, AtomicUsize::default);
        *self.is_closed.get_mut() = false;
    }

    /// Adds all subdomains, each for the thread of its affinity.
    fn push_all(&self, affinity: &[AtomicUsize]) {
        let mut sets = self.lock();
        for (set, thread) in affinity.iter().enumerate() {
            sets[thread.load(Ordering::Relaxed)].push_back(set);
        }
        for (of_thread, count) in sets.iter().zip(&self.counts) {
            count.store(of_thread.len(), Ordering::Relaxed);
        }
        if self.parked.load(Ordering::Relaxed) > 0 {
            self.wakeup.notify_all();
        }
    }

    fn lock(&self) -> MutexGuard<'_, Vec<VecDeque<usize>>> {
        self.sets.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, thread: usize, set: usize) {
        let mut sets = self.lock();
        sets[thread].push_back(set);
        self.counts[thread].store(sets[thread].len(), Ordering::Relaxed);
        if self.parked.load(Ordering::Relaxed) > 0 {
            self.wakeup.notify_one();
        }
    }

    fn pop(&self, thread: usize) -> Option<usize> {
        if self.counts[thread].load(Ordering::Relaxed) == 0 {
            return None;
        }
        let mut sets = self.lock();
        let set = sets[thread].pop_front();
        self.counts[thread].store(sets[thread].len(), Ordering::Relaxed);
        set
    }

    /// Waits for the next set of `thread`; returns `None` when the queue is closed.
    fn wait(&self, thread: usize) -> Option<usize> {
        let threads = self.counts.len();
        let mut polls = 0;
        while !self.is_closed.load(Ordering::Relaxed) {
            let queues = if polls < POLLS_BEFORE_STEAL { 1 } else { threads };
            let set = (0..queues).find_map(|k| self.pop((thread + k) % threads));
            if set.is_some() {
                return set;
            }
            polls += 1;
            if polls < POLLS_BEFORE_PARK {
                std::hint::spin_loop();
            } else {
                self.park();
                polls = 0;
            }
        }
        None
    }

    /// Blocks until a set is ready or the queue is closed.
    fn park(&self) {
        let mut sets = self.lock();
        // Counted under the lock, which every notifier takes first.
        self.parked.fetch_add(1, Ordering::Relaxed);
        while sets.iter().all(VecDeque::is_empty) && !self.is_closed.load(Ordering::Relaxed) {
            sets = self.wakeup.wait(sets).unwrap_or_else(PoisonError::into_inner);
        }
        self.parked.fetch_sub(1, Ordering::Relaxed);
    }

    fn close(&self) {
        let sets = self.lock();
        self.is_closed.store(true, Ordering::Relaxed);
        drop(sets);
        self.wakeup.notify_all();
    }
}

/// Closes the queue when a visit panics, because the other threads would wait for its end for ever.
struct PanicGuard<'a>(&'a ReadyQueue);

impl Drop for PanicGuard<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.close();
        }
    }
}

/// Run of one or more batches.
struct ScheduledRun<'a, P, V, N> {
    scheduler: &'a SweepScheduler,
    interface: &'a Interface,
    /// Current batch.
    batch: RwLock<PassBatch<P>>,
    visit: V,
    next: Mutex<N>,
}

impl SweepScheduler {
    /// Runs batches of passes over the subdomains and groups of `interface` on the threads of the current pool.
    ///
    /// Each visit has exclusive use of what its set shares with others. `next` returns the first batch and, when all
    /// visits of a batch have ended, the following one; `None` ends the run.
    pub fn run<P: Copy + Send + Sync>(
        &mut self,
        interface: &Interface,
        visit: impl Fn(SweepTask, &P) + Sync,
        mut next: impl FnMut() -> Option<PassBatch<P>> + Send,
    ) {
        let subdomains = interface.groups_by_subdomain.len();
        let threads = rayon::current_num_threads();
        // A batch without visits has ended.
        let has_visits = |batch: &PassBatch<P>| batch.passes > 0 && subdomains > 0;
        let Some(first) = std::iter::from_fn(&mut next).find(has_visits) else { return };
        self.arrivals.clear();
        self.arrivals.resize_with(interface.pairs.len(), AtomicU32::default);
        self.passes.clear();
        self.passes.resize_with(subdomains, AtomicU32::default);
        let workers = threads.min(subdomains);
        let in_order = |s: usize| AtomicUsize::new(s * workers / subdomains);
        if self.affinity.len() != subdomains || self.queue.counts.len() != threads {
            self.affinity.clear();
            self.affinity.extend((0..subdomains).map(in_order));
        }
        self.queue.reset(threads, subdomains);
        let run = ScheduledRun {
            scheduler: self,
            interface,
            batch: RwLock::new(first),
            visit,
            next: Mutex::new(next),
        };
        run.begin_batch();
        on_threads(workers, &|| run.work());
    }
}

impl<P, V, N> ScheduledRun<'_, P, V, N>
where
    P: Copy + Send + Sync,
    V: Fn(SweepTask, &P) + Sync,
    N: FnMut() -> Option<PassBatch<P>> + Send,
{
    /// Starts the current batch while no visit is running.
    fn begin_batch(&self) {
        let SweepScheduler { passes, affinity, unfinished, queue, .. } = self.scheduler;
        passes.iter().for_each(|passes| passes.store(0, Ordering::Relaxed));
        unfinished.store(passes.len(), Ordering::Relaxed);
        // A thread that takes a set from the queue sees all these stores.
        queue.push_all(affinity);
    }

    /// Obtains the next batch after the last visit of one.
    fn end_batch(&self) {
        let mut next = self.next.lock().unwrap_or_else(PoisonError::into_inner);
        match std::iter::from_fn(&mut *next).find(|batch| batch.passes > 0) {
            None => self.scheduler.queue.close(),
            Some(batch) => {
                *self.batch.write().unwrap_or_else(PoisonError::into_inner) = batch;
                self.begin_batch();
            }
        }
    }

    /// Visits ready sets until the run ends.
    fn work(&self) {
        let SweepScheduler { queue, affinity, .. } = self.scheduler;
        let _guard = PanicGuard(queue);
        let thread = rayon::current_thread_index().unwrap_or(0);
        while let Some(mut set) = queue.wait(thread) {
            // The sets that follow directly below belong to the same batch.
            let PassBatch { passes, plan } =
                *self.batch.read().unwrap_or_else(PoisonError::into_inner);
            loop {
                if let Some(last_thread) = affinity.get(set) {
                    last_thread.store(thread, Ordering::Relaxed);
                }
                (self.visit)(self.task(set), &plan);
                match self.finish(set, thread, passes) {
                    Some(next) => set = next,
                    None => break,
                }
            }
        }
    }

    /// Returns the task of `set` in its current pass.
    fn task(&self, set: usize) -> SweepTask {
        let group = set.checked_sub(self.scheduler.passes.len());
        let subdomain = group.map_or(set, |g| self.interface.pairs[g][0] as usize);
        let pass = self.scheduler.passes[subdomain].load(Ordering::Relaxed);
        SweepTask { set, is_interface: group.is_some(), pass }
    }

    /// Finishes the visit of `set`. Of the sets that become ready, returns one for `thread` and queues the others for
    /// the threads of their affinity.
    fn finish(&self, set: usize, thread: usize, passes: u32) -> Option<usize> {
        let ready = match set.checked_sub(self.scheduler.passes.len()) {
            None => [self.arrive(set, 0, passes), None],
            Some(g) => self.interface.pairs[g].map(|s| {
                let groups = self.interface.groups_by_subdomain.list(s as usize);
                let position = groups.iter().take_while(|&&other| other as usize != g).count();
                self.arrive(s as usize, position + 1, passes)
            }),
        };
        let mut own = None;
        for set in ready.into_iter().flatten() {
            // Groups are small, and this thread has just visited one of their subdomains.
            let affinity = self.scheduler.affinity.get(set);
            let target = affinity.map_or(thread, |last| last.load(Ordering::Relaxed));
            if target == thread && own.is_none() {
                own = Some(set);
            } else {
                self.scheduler.queue.push(target, set);
            }
        }
        own
    }

    /// Moves subdomain `s` to a position in its list of groups, in a batch of `batch_passes`; returns the set that
    /// becomes ready.
    fn arrive(&self, s: usize, position: usize, batch_passes: u32) -> Option<usize> {
        let SweepScheduler { arrivals, passes, unfinished, .. } = self.scheduler;
        // Acquire and release: the second to arrive, or to start a next pass, sees what the others have written.
        if let Some(&g) = self.interface.groups_by_subdomain.list(s).get(position) {
            let before = arrivals[g as usize].fetch_add(1, Ordering::AcqRel);
            return (before % 2 == 1).then_some(passes.len() + g as usize);
        }
        if passes[s].fetch_add(1, Ordering::AcqRel) + 1 < batch_passes {
            return Some(s);
        }
        if unfinished.fetch_sub(1, Ordering::AcqRel) == 1 {
            self.end_batch();
        }
        None
    }
}

/// Runs `work` on up to `threads` threads of the current pool at once; `work` itself finds out what remains to be done.
pub(super) fn on_threads(threads: usize, work: &(impl Fn() + Sync)) {
    match threads {
        0 => {}
        1 => work(),
        _ => {
            let half = threads / 2;
            rayon::join(|| on_threads(half, work), || on_threads(threads - half, work));
        }
    }
}

#[cfg(test)]
mod tests;
