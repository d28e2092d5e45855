//! Pools of 1 to P threads, so that one run can measure them in turn.

use super::args::Threads;
use ballast_session::Outcome;
use ballast_session::threads;
use rayon::ThreadPool;
use std::sync::Arc;

/// A pool of `threads` threads.
pub fn pool(threads: usize) -> Outcome<Arc<ThreadPool>> {
    threads::pool(threads).map(Arc::new)
}

/// One pool for each number of threads asked for: up to four all of them, beyond that each twice the one before.
pub fn pools(args: &Threads) -> Outcome<Vec<Arc<ThreadPool>>> {
    let most = args.threads_up_to.map_or_else(rayon::current_num_threads, usize::from);
    (1..=most).filter(|&n| n <= 4 || n.is_power_of_two() || n == most).map(pool).collect()
}
