//! How many threads work, and on what.

use crate::{Failure, Outcome};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Has all work of the program done on `threads` threads, on one for each core if none are given.
pub fn start(threads: Option<NonZeroUsize>) -> Outcome {
    let Some(threads) = threads else { return Ok(()) };
    let started = ThreadPoolBuilder::new().num_threads(threads.get()).build_global();
    started.map_err(|e| cannot_start(threads.get(), e))
}

/// A pool of `threads` threads.
pub fn pool(threads: usize) -> Outcome<ThreadPool> {
    let made = ThreadPoolBuilder::new().num_threads(threads).build();
    made.map_err(|e| cannot_start(threads, e))
}

fn cannot_start(threads: usize, why: rayon::ThreadPoolBuildError) -> Failure {
    Failure::Failed(format!("cannot start {threads} threads: {why}"))
}

/// What `work` makes of each of the items, as many at a time as there are threads. What one of them does by itself it does
/// on its share of the threads: small pieces of work are done sooner beside each other than each by all threads. `done`
/// is called as soon as each is done. After a failure no further ones are begun, and it is given back.
pub fn side_by_side<T: Sync, R: Send>(
    items: &[T],
    work: impl Fn(&T) -> Outcome<R> + Sync,
    done: impl Fn() + Sync,
) -> Outcome<Vec<R>> {
    let threads = rayon::current_num_threads();
    let at_a_time = items.len().clamp(1, threads);
    let pools = (0..at_a_time).map(|_| pool(threads / at_a_time)).collect::<Outcome<Vec<_>>>()?;
    let (next, has_failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let found: Vec<Mutex<Option<Outcome<R>>>> = items.iter().map(|_| Mutex::new(None)).collect();
    let work_on = |pool: &ThreadPool| {
        while !has_failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(number) else { break };
            let result = pool.install(|| work(item));
            has_failed.fetch_or(result.is_err(), Ordering::Relaxed);
            *found[number].lock().expect("nobody else writes here") = Some(result);
            done();
        }
    };
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| work_on(pool));
        }
    });
    // Those that were not begun come after one that failed.
    found.into_iter().filter_map(|one| one.into_inner().expect("nobody else writes here")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_the_items_on_any_number_of_threads() {
        for threads in [1, 2, 5] {
            let items: Vec<usize> = (0..23).collect();
            let counted = AtomicUsize::new(0);
            let done = || {
                counted.fetch_add(1, Ordering::Relaxed);
            };
            let work = |i: &usize| Ok((i * i, rayon::current_num_threads()));
            let found = pool(threads).unwrap().install(|| side_by_side(&items, work, done));
            let expected: Vec<_> = items.iter().map(|i| (i * i, 1)).collect();
            assert_eq!((found.unwrap(), counted.into_inner()), (expected, 23));
        }
        // Fewer items than threads share them.
        let found = pool(5)
            .unwrap()
            .install(|| side_by_side(&[1, 2], |i| Ok((*i, rayon::current_num_threads())), || ()));
        assert_eq!(found.unwrap(), [(1, 2), (2, 2)]);
        let none = side_by_side(&[], |_: &u8| Ok(()), || ());
        assert!(none.unwrap().is_empty());
    }

    #[test]
    fn a_failure_ends_it() {
        let begun = AtomicUsize::new(0);
        let work = |i: &usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if *i == 3 { Err(Failure::Failed("three".into())) } else { Ok(*i) }
        };
        let items: Vec<usize> = (0..1000).collect();
        let found = pool(1).unwrap().install(|| side_by_side(&items, work, || ()));
        assert!(matches!(found, Err(Failure::Failed(why)) if why == "three"));
        assert_eq!(begun.into_inner(), 4);
    }
}
