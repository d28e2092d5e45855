//! Roofline of the kernel: peak rates of memory and arithmetic on a number of threads.

use ballast::lanes::{BodyVelocity, InstructionSet};
use ballast::nlgs::{MemoryTraffic, OperationCounts};
use ballast_session::lock::enter;
use ballast_session::profile::cpu_time;
use rayon::ThreadPool;
use std::hint::black_box;
use std::sync::Mutex;
use std::time::Instant;

/// Bytes of a triad that fits every first-level cache.
pub const FIRST_CACHE_BYTES: usize = 16 << 10;

/// Repetitions per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// Rate by the wall clock.
    pub wall: f64,
    /// Rate by the CPU clock of all threads over their number, unaffected by other programs.
    pub cpu: f64,
}

impl Rate {
    /// Measures the repetitions per second of `work(repetitions)` on `threads` threads.
    ///
    /// Takes about `seconds` of CPU time per thread, and at most twenty times as long by the wall clock.
    pub fn measure(seconds: f64, threads: usize, mut work: impl FnMut(u64)) -> Self {
        let mut times = 1;
        loop {
            let (start, cpu) = (Instant::now(), cpu_time());
            work(times);
            let wall = start.elapsed().as_secs_f64().max(1e-9);
            let cpu = (cpu_time() - cpu).as_secs_f64() / threads as f64;
            // With other programs on the processors, wall time passes without work.
            let worked = if cpu > 0.0 { cpu } else { wall };
            if worked >= 0.7 * seconds || wall >= 20.0 * seconds || times > 1 << 40 {
                return Self { wall: times as f64 / wall, cpu: times as f64 / worked };
            }
            times = (2 * times).max((times as f64 * (seconds / worked).min(100.0)) as u64);
        }
    }

    /// Returns the rate multiplied by `factor`.
    pub fn times(&self, factor: f64) -> Self {
        Self { wall: factor * self.wall, cpu: factor * self.cpu }
    }
}

/// STREAM triad on two arrays for each thread of a pool.
pub struct Triad {
    bytes: usize,
    arrays: Vec<Mutex<[Vec<BodyVelocity>; 2]>>,
}

impl Triad {
    /// Creates arrays of `bytes` bytes together for each of `threads` threads.
    pub fn new(bytes: usize, threads: usize) -> Self {
        let array = || vec![BodyVelocity([1.0; 8]); (bytes / 2 / size_of::<BodyVelocity>()).max(1)];
        let arrays = (0..threads).map(|_| Mutex::new([array(), array()])).collect();
        Self { bytes, arrays }
    }

    /// Returns true if the arrays have this size and number.
    pub fn matches(&self, bytes: usize, threads: usize) -> bool {
        self.bytes == bytes && self.arrays.len() == threads
    }

    /// Measures the bytes per second of all threads together.
    pub fn bandwidth(&self, pool: &ThreadPool, seconds: f64) -> Rate {
        let instructions = InstructionSet::detect();
        let rate = Rate::measure(seconds, self.arrays.len(), |times| {
            pool.broadcast(|thread| {
                let [a, b] = &mut *enter(&self.arrays[thread.index()]);
                for _ in 0..times {
                    instructions.triad(black_box(a), b, 0.5);
                }
            });
        });
        let lines: usize = self.arrays.iter().map(|arrays| enter(arrays)[0].len()).sum();
        rate.times((lines * InstructionSet::TRIAD_BYTES) as f64)
    }
}

/// Measures fused operations and divisions per second of all threads of a pool.
pub fn arithmetic_rates(
    instructions: InstructionSet,
    pool: &ThreadPool,
    seconds: f64,
) -> [Rate; 2] {
    // Enough rounds for one call that calling costs nothing.
    const ROUNDS: u64 = 1000;
    let threads = pool.current_num_threads();
    let operations = (ROUNDS as usize * instructions.operations_per_round() * threads) as f64;
    let of = |work: fn(InstructionSet, u64, f64) -> f64| {
        let rate = Rate::measure(seconds, threads, |times| {
            pool.broadcast(|_| {
                for _ in 0..times {
                    black_box(work(instructions, ROUNDS, black_box(0.999)));
                }
            });
        });
        rate.times(operations)
    };
    [of(InstructionSet::multiply_adds), of(InstructionSet::divisions)]
}

/// Upper bounds of the rate of sweeps, measured in one round by the CPU clock.
#[derive(Debug, Clone, Copy)]
pub struct RooflineLimits {
    /// Bytes per second from the first-level caches.
    pub first_cache: f64,
    /// Bytes per second from the memory that holds the set.
    pub set: f64,
    /// Fused multiply-adds per second.
    pub fused: f64,
    /// Divisions per second.
    pub divisions: f64,
}

impl RooflineLimits {
    /// Returns the lowest bound of the visits per second and its name.
    ///
    /// `traffic` and `operations` belong to `visits` visits.
    pub fn lowest(
        &self,
        traffic: &MemoryTraffic,
        operations: &OperationCounts,
        visits: f64,
    ) -> (f64, &'static str) {
        let lanes = 8.0;
        let issued = lanes * (operations.plain + operations.fused) as f64;
        let bounds = [
            (self.first_cache / traffic.core as f64, "first cache"),
            (self.set / traffic.streamed as f64, "memory"),
            (self.fused / issued, "arithmetic"),
            (self.divisions / (lanes * operations.divisions as f64), "divisions"),
        ];
        let least = bounds.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let (bound, name) = least.expect("four bounds");
        (bound * visits, name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lowest_bound_is_returned_with_its_name() {
        let traffic = MemoryTraffic { footprint: 1000, core: 400, streamed: 200 };
        let operations = OperationCounts { plain: 10, fused: 10, divisions: 1 };
        let roofs =
            RooflineLimits { first_cache: 4000.0, set: 1000.0, fused: 16_000.0, divisions: 80.0 };
        assert_eq!(roofs.lowest(&traffic, &operations, 2.0), (10.0, "memory"));
        let roofs = RooflineLimits { divisions: 8.0, ..roofs };
        assert_eq!(roofs.lowest(&traffic, &operations, 2.0), (2.0, "divisions"));
    }

    #[test]
    fn rate_counts_repetitions() {
        let mut done = 0;
        let rate = Rate::measure(0.001, 1, |times| {
            std::thread::sleep(std::time::Duration::from_micros(200 * times));
            done += times;
        });
        assert!(rate.wall > 0.0 && rate.wall <= 5000.0, "{rate:?}");
        assert!(done >= 1 && rate.cpu > 0.0, "{done}, {rate:?}");
    }
}
