//! Whose turn it is: the order of the synchronous schedule, without its barriers.
//!
//! Reads: the interface. Writes: its own counters; sets are visited by the caller. Cost: two counters per turn, and a
//! lock for some. Contract: sets that share a grain have their turns in the same order as with a barrier after the
//! subdomains and one after each colour, so bytes are the same, whoever makes the visits and when.
//!
//! In a pass each subdomain has its turn, then each group of its interface, colour by colour. A group's turn comes when
//! both of its subdomains have come to it; a subdomain's next pass begins after the last of its own groups, whatever is
//! still to be done elsewhere. A subdomain is left to the thread that has visited it last and has it in its caches,
//! unless others have nothing to do.
//!
//! Passes come in stretches: between two of them all visits have ended, and whoever has ended the last one asks what
//! the next stretch is to be, while the others wait for it where they are.

use super::on_threads;
use crate::partition::Interface;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError, RwLock};

/// How often a thread without work looks for its own before it takes that of others: for some microseconds, less than
/// it takes to fetch what another thread has in its caches.
const LOYAL: u32 = 50;
/// How often it looks before it sleeps: for about as long as it takes to be woken.
const AWAKE: u32 = 1000;

/// A set's turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Turn {
    /// Subdomains first.
    pub set: usize,
    pub of_interface: bool,
    /// Counted from 0 in each stretch.
    pub pass: u32,
}

/// What threads that make the visits of a run share; kept for its memory, and for who has visited what.
#[derive(Debug, Default)]
pub(super) struct Turns {
    /// Subdomains that have come to each group since the run began: with the second of two its turn has come.
    arrivals: Vec<AtomicU32>,
    /// Passes of the present stretch that each subdomain has finished.
    passes: Vec<AtomicU32>,
    /// The thread that has visited each subdomain last.
    homes: Vec<AtomicUsize>,
    /// Subdomains that have passes of the present stretch to go.
    unfinished: AtomicUsize,
    queue: Queue,
}

/// Sets whose turn has come and that nobody has taken, by the threads that are to.
#[derive(Debug, Default)]
struct Queue {
    sets: Mutex<Vec<VecDeque<usize>>>,
    /// How many each thread has, to be seen without the lock.
    counts: Vec<AtomicUsize>,
    sleepers: AtomicUsize,
    bell: Condvar,
    /// There will be no more.
    is_over: AtomicBool,
}

impl Queue {
    /// Nothing is there yet for so many threads, which may be that of so many subdomains.
    fn reset(&mut self, threads: usize, subdomains: usize) {
        let sets = self.sets.get_mut().unwrap_or_else(PoisonError::into_inner);
        sets.resize_with(threads, VecDeque::default);
        for of_thread in &mut *sets {
            of_thread.clear();
            // No more than these wait at once, so that a run allocates nothing, whoever does what.
            of_thread.reserve(subdomains);
        }
        self.counts.clear();
        self.counts.resize_with(threads, AtomicUsize::default);
        *self.is_over.get_mut() = false;
    }

    /// The turn of all subdomains has come, each at its home.
    fn push_all(&self, homes: &[AtomicUsize]) {
        let mut sets = self.enter();
        for (set, home) in homes.iter().enumerate() {
            sets[home.load(Ordering::Relaxed)].push_back(set);
        }
        for (of_thread, count) in sets.iter().zip(&self.counts) {
            count.store(of_thread.len(), Ordering::Relaxed);
        }
        if self.sleepers.load(Ordering::Relaxed) > 0 {
            self.bell.notify_all();
        }
    }

    fn enter(&self) -> MutexGuard<'_, Vec<VecDeque<usize>>> {
        self.sets.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, thread: usize, set: usize) {
        let mut sets = self.enter();
        sets[thread].push_back(set);
        self.counts[thread].store(sets[thread].len(), Ordering::Relaxed);
        if self.sleepers.load(Ordering::Relaxed) > 0 {
            self.bell.notify_one();
        }
    }

    fn pop(&self, thread: usize) -> Option<usize> {
        if self.counts[thread].load(Ordering::Relaxed) == 0 {
            return None;
        }
        let mut sets = self.enter();
        let set = sets[thread].pop_front();
        self.counts[thread].store(sets[thread].len(), Ordering::Relaxed);
        set
    }

    /// The next set for `thread` to visit, once there is one; `None` when all is over.
    fn wait(&self, thread: usize) -> Option<usize> {
        let threads = self.counts.len();
        let mut looks = 0;
        while !self.is_over.load(Ordering::Relaxed) {
            let within_reach = if looks < LOYAL { 1 } else { threads };
            let set = (0..within_reach).find_map(|k| self.pop((thread + k) % threads));
            if set.is_some() {
                return set;
            }
            looks += 1;
            if looks < AWAKE {
                std::hint::spin_loop();
            } else {
                self.sleep();
                looks = 0;
            }
        }
        None
    }

    /// Sleeps until there is something to be seen.
    fn sleep(&self) {
        let mut sets = self.enter();
        // Under the lock, which whoever rings takes first.
        self.sleepers.fetch_add(1, Ordering::Relaxed);
        while sets.iter().all(VecDeque::is_empty) && !self.is_over.load(Ordering::Relaxed) {
            sets = self.bell.wait(sets).unwrap_or_else(PoisonError::into_inner);
        }
        self.sleepers.fetch_sub(1, Ordering::Relaxed);
    }

    fn end(&self) {
        let sets = self.enter();
        self.is_over.store(true, Ordering::Relaxed);
        drop(sets);
        self.bell.notify_all();
    }
}

/// Sends everybody home when a visit panics: what waits for its end would wait for ever.
struct Alarm<'a>(&'a Queue);

impl Drop for Alarm<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.end();
        }
    }
}

/// So many passes, and what their visits have to know.
pub(super) type Stretch<P> = (u32, P);

/// A run of some stretches.
struct Run<'a, P, V, N> {
    turns: &'a Turns,
    interface: &'a Interface,
    /// The present one.
    stretch: RwLock<Stretch<P>>,
    visit: V,
    next: Mutex<N>,
}

impl Turns {
    /// Makes stretches of passes over the sets of `interface` and its subdomains, each visit alone with what it shares
    /// with others, on as many of the present threads as are of use. `next` gives the first stretch, and when all
    /// visits of one have ended, the one after it; `None`: no more.
    pub fn run<P: Copy + Send + Sync>(
        &mut self,
        interface: &Interface,
        visit: impl Fn(Turn, &P) + Sync,
        mut next: impl FnMut() -> Option<Stretch<P>> + Send,
    ) {
        let (subdomains, threads) =
            (interface.groups_by_subdomain.len(), rayon::current_num_threads());
        // A stretch without visits has ended.
        let has_visits = |&(passes, _): &Stretch<P>| passes > 0 && subdomains > 0;
        let Some(first) = std::iter::from_fn(&mut next).find(has_visits) else { return };
        self.arrivals.clear();
        self.arrivals.resize_with(interface.pairs.len(), AtomicU32::default);
        self.passes.clear();
        self.passes.resize_with(subdomains, AtomicU32::default);
        let workers = threads.min(subdomains);
        let in_order = |s: usize| AtomicUsize::new(s * workers / subdomains);
        if self.homes.len() != subdomains || self.queue.counts.len() != threads {
            self.homes.clear();
            self.homes.extend((0..subdomains).map(in_order));
        }
        self.queue.reset(threads, subdomains);
        let (stretch, next) = (RwLock::new(first), Mutex::new(next));
        let run = Run { turns: self, interface, stretch, visit, next };
        run.begin_stretch();
        on_threads(workers, &|| run.take_turns());
    }
}

impl<P, V, N> Run<'_, P, V, N>
where
    P: Copy + Send + Sync,
    V: Fn(Turn, &P) + Sync,
    N: FnMut() -> Option<Stretch<P>> + Send,
{
    /// The present stretch begins; no visit is under way.
    fn begin_stretch(&self) {
        let Turns { passes, homes, unfinished, queue, .. } = self.turns;
        passes.iter().for_each(|passes| passes.store(0, Ordering::Relaxed));
        unfinished.store(passes.len(), Ordering::Relaxed);
        // Whoever takes a set from there sees all this.
        queue.push_all(homes);
    }

    /// All visits of a stretch have ended.
    fn end_stretch(&self) {
        let mut next = self.next.lock().unwrap_or_else(PoisonError::into_inner);
        match std::iter::from_fn(&mut *next).find(|&(passes, _)| passes > 0) {
            None => self.turns.queue.end(),
            Some(stretch) => {
                *self.stretch.write().unwrap_or_else(PoisonError::into_inner) = stretch;
                self.begin_stretch();
            }
        }
    }

    fn take_turns(&self) {
        let Turns { queue, homes, .. } = self.turns;
        let _alarm = Alarm(queue);
        let thread = rayon::current_thread_index().unwrap_or(0);
        while let Some(mut set) = queue.wait(thread) {
            // Whoever goes on from turn to turn below stays in it.
            let (passes, plan) = *self.stretch.read().unwrap_or_else(PoisonError::into_inner);
            loop {
                if let Some(home) = homes.get(set) {
                    home.store(thread, Ordering::Relaxed);
                }
                (self.visit)(self.turn(set), &plan);
                match self.go_on(set, thread, passes) {
                    Some(next) => set = next,
                    None => break,
                }
            }
        }
    }

    /// The present turn of `set`.
    fn turn(&self, set: usize) -> Turn {
        let group = set.checked_sub(self.turns.passes.len());
        let subdomain = group.map_or(set, |g| self.interface.pairs[g][0] as usize);
        let pass = self.turns.passes[subdomain].load(Ordering::Relaxed);
        Turn { set, of_interface: group.is_some(), pass }
    }

    /// After the turn of `set`: of those whose turn comes with that, one may be for `thread` to visit; others are left to
    /// whom they are at home with.
    fn go_on(&self, set: usize, thread: usize, passes: u32) -> Option<usize> {
        let come = match set.checked_sub(self.turns.passes.len()) {
            None => [self.come_to(set, 0, passes), None],
            Some(g) => self.interface.pairs[g].map(|s| {
                let course = self.interface.groups_by_subdomain.list(s as usize);
                let place = course.iter().take_while(|&&other| other as usize != g).count();
                self.come_to(s as usize, place + 1, passes)
            }),
        };
        let mut mine = None;
        for set in come.into_iter().flatten() {
            // Groups are small, and one of their subdomains has just been here.
            let home =
                self.turns.homes.get(set).map_or(thread, |home| home.load(Ordering::Relaxed));
            if home == thread && mine.is_none() {
                mine = Some(set);
            } else {
                self.turns.queue.push(home, set);
            }
        }
        mine
    }

    /// Subdomain `s` comes to a place in its course, in a stretch of so many passes: gives the set whose turn has come
    /// with that.
    fn come_to(&self, s: usize, place: usize, of_stretch: u32) -> Option<usize> {
        let Turns { arrivals, passes, unfinished, .. } = self.turns;
        // Acquire and release throughout: who comes second, or takes a next pass, has seen what the others left.
        if let Some(&g) = self.interface.groups_by_subdomain.list(s).get(place) {
            let before = arrivals[g as usize].fetch_add(1, Ordering::AcqRel);
            return (before % 2 == 1).then_some(passes.len() + g as usize);
        }
        if passes[s].fetch_add(1, Ordering::AcqRel) + 1 < of_stretch {
            return Some(s);
        }
        if unfinished.fetch_sub(1, Ordering::AcqRel) == 1 {
            self.end_stretch();
        }
        None
    }
}

#[cfg(test)]
mod tests;
