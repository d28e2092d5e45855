//! Thread pools, and work on many items in parallel.

use crate::{Failure, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Sets the number of threads of the global pool; `None` keeps one per processor.
///
/// # Errors
/// Threads that cannot be started.
pub fn start(threads: Option<usize>) -> Result {
    let Some(threads) = threads else { return Ok(()) };
    let started = ThreadPoolBuilder::new().num_threads(threads).build_global();
    started.map_err(|e| cannot_start(threads, e))
}

/// Creates a pool of `threads` threads.
///
/// # Errors
/// Threads that cannot be started.
pub fn pool(threads: usize) -> Result<ThreadPool> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| cannot_start(threads, e))
}

fn cannot_start(threads: usize, why: rayon::ThreadPoolBuildError) -> Failure {
    Failure::Failed(format!("cannot start {threads} threads: {why}"))
}

/// Applies `work` to all items in parallel, as many at a time as there are threads, and returns the results in order.
///
/// Each item has its share of the threads: small items finish sooner in parallel than one by one on all threads. `done`
/// is called after each item.
///
/// # Errors
/// The first failure; no further items are started after it.
pub fn map_parallel<T: Sync, R: Send>(
    items: &[T],
    work: impl Fn(&T) -> Result<R> + Sync,
    done: impl Fn() + Sync,
) -> Result<Vec<R>> {
    let threads = rayon::current_num_threads();
    let at_a_time = items.len().clamp(1, threads);
    let pools = (0..at_a_time).map(|_| pool(threads / at_a_time)).collect::<Result<Vec<_>>>()?;
    let next = AtomicUsize::new(0);
    let has_failed = AtomicBool::new(false);
    let found: Vec<Mutex<Option<Result<R>>>> = items.iter().map(|_| Mutex::new(None)).collect();
    let work_on = |pool: &ThreadPool| {
        while !has_failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(number) else { break };
            let result = pool.install(|| work(item));
            has_failed.fetch_or(result.is_err(), Ordering::Relaxed);
            *found[number].lock().expect("each entry has one writer") = Some(result);
            done();
        }
    };
    std::thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| work_on(pool));
        }
    });
    // Items without a result come after one that failed.
    found
        .into_iter()
        .filter_map(|one| one.into_inner().expect("each entry has one writer"))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_have_the_order_of_the_items_for_any_number_of_threads() {
        for threads in [1, 2, 5] {
            let items: Vec<usize> = (0..23).collect();
            let counted = AtomicUsize::new(0);
            let done = || {
                counted.fetch_add(1, Ordering::Relaxed);
            };
            let work = |i: &usize| Ok((i * i, rayon::current_num_threads()));
            let found = pool(threads).unwrap().install(|| map_parallel(&items, work, done));
            let expected: Vec<_> = items.iter().map(|i| (i * i, 1)).collect();
            assert_eq!((found.unwrap(), counted.into_inner()), (expected, 23));
        }
        // Fewer items than threads share them.
        let found = pool(5)
            .unwrap()
            .install(|| map_parallel(&[1, 2], |i| Ok((*i, rayon::current_num_threads())), || ()));
        assert_eq!(found.unwrap(), [(1, 2), (2, 2)]);
        let none = map_parallel(&[], |_: &u8| Ok(()), || ());
        assert!(none.unwrap().is_empty());
    }

    #[test]
    fn failure_stops_further_items() {
        let begun = AtomicUsize::new(0);
        let work = |i: &usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if *i == 3 { Err(Failure::Failed("three".into())) } else { Ok(*i) }
        };
        let items: Vec<usize> = (0..1000).collect();
        let found = pool(1).unwrap().install(|| map_parallel(&items, work, || ()));
        assert!(matches!(found, Err(Failure::Failed(why)) if why == "three"));
        assert_eq!(begun.into_inner(), 4);
    }
}
