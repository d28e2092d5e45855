//! Parallel sums in a fixed order.
//!
//! Chunks have a fixed length and are added in order, so the result has the same bits for any number of threads.

use rayon::prelude::*;
use std::ops::{Add, Range};

const CHUNK: usize = 1024;

/// Returns the sum of `chunk` over `0..count`, in ranges of at most 1024.
pub(super) fn in_chunks<T, F>(count: usize, zero: T, chunk: F) -> T
where
    T: Add<Output = T> + Send,
    F: Fn(Range<usize>) -> T + Sync,
{
    let parts: Vec<T> = (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .map(|k| chunk(k * CHUNK..count.min((k + 1) * CHUNK)))
        .collect();
    parts.into_iter().fold(zero, T::add)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_the_same_bits_for_any_number_of_threads() {
        let term = |k: usize| 1.0 / (k as f64 + 0.1);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| in_chunks(100_003, 0.0, |range| range.map(term).sum::<f64>()))
        };
        let one = run(1);
        let plain: f64 = (0..100_003).map(term).sum();
        assert!((one - plain).abs() < 1e-11);
        for threads in [2, 3, 5] {
            assert_eq!(run(threads).to_bits(), one.to_bits());
        }
    }
}
