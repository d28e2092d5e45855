//! Thread pools of 1 to P threads, measured in alternation by one run.

use super::args::ThreadArgs;
use ballast_session::Result;
use ballast_session::threads;
use rayon::ThreadPool;
use std::sync::Arc;

/// Creates a pool of `threads` threads.
pub fn pool(threads: usize) -> Result<Arc<ThreadPool>> {
    threads::pool(threads).map(Arc::new)
}

/// Creates a pool for each requested number of threads: 1 to 4, then powers of two and the largest.
pub fn pools(args: &ThreadArgs) -> Result<Vec<Arc<ThreadPool>>> {
    let max = args.threads_up_to.unwrap_or_else(rayon::current_num_threads);
    (1..=max).filter(|&n| n <= 4 || n.is_power_of_two() || n == max).map(pool).collect()
}
