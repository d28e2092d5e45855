//! What memory and arithmetic deliver at most on some threads: the roofline that sweeps are held against.

use ballast::lanes::{BodyVelocity, InstructionSet};
use ballast::nlgs::{MemoryTraffic, OperationCounts};
use ballast_session::lock::enter;
use ballast_session::profile::cpu_time;
use rayon::ThreadPool;
use std::hint::black_box;
use std::sync::Mutex;
use std::time::Instant;

/// Bytes that fit every first cache, for the triad between it and the processor.
pub const FIRST_CACHE: usize = 16 << 10;

/// Repetitions per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// By the wall clock.
    pub wall: f64,
    /// As if no other program had taken a turn: by the CPU clock of all threads over their number.
    pub cpu: f64,
}

impl Rate {
    /// How often `work`, which does something as often as it is told, does it on `threads` threads; measured
    /// for `seconds` of CPU time per thread or a little more, if that is to be had.
    pub fn of(seconds: f64, threads: usize, mut work: impl FnMut(u64)) -> Self {
        let mut times = 1;
        loop {
            let (start, cpu) = (Instant::now(), cpu_time());
            work(times);
            let wall = start.elapsed().as_secs_f64().max(1e-9);
            let cpu = (cpu_time() - cpu).as_secs_f64() / threads as f64;
            // Where others take turns too, time on the wall passes without work.
            let worked = if cpu > 0.0 { cpu } else { wall };
            if worked >= 0.7 * seconds || wall >= 20.0 * seconds || times > 1 << 40 {
                return Self { wall: times as f64 / wall, cpu: times as f64 / worked };
            }
            times = (2 * times).max((times as f64 * (seconds / worked).min(100.0)) as u64);
        }
    }

    pub fn times(&self, factor: f64) -> Self {
        Self { wall: factor * self.wall, cpu: factor * self.cpu }
    }
}

/// Two arrays for each thread of a pool.
pub struct Triad {
    bytes: usize,
    arrays: Vec<Mutex<[Vec<BodyVelocity>; 2]>>,
}

impl Triad {
    /// Arrays of `bytes` together for each of `threads`.
    pub fn new(bytes: usize, threads: usize) -> Self {
        let array = || vec![BodyVelocity([1.0; 8]); (bytes / 2 / size_of::<BodyVelocity>()).max(1)];
        let arrays = (0..threads).map(|_| Mutex::new([array(), array()])).collect();
        Self { bytes, arrays }
    }

    pub fn is(&self, bytes: usize, threads: usize) -> bool {
        self.bytes == bytes && self.arrays.len() == threads
    }

    /// Bytes per second of all threads together.
    pub fn bandwidth(&self, pool: &ThreadPool, seconds: f64) -> Rate {
        let arithmetic = InstructionSet::detect();
        let rate = Rate::of(seconds, self.arrays.len(), |times| {
            pool.broadcast(|thread| {
                let [a, b] = &mut *enter(&self.arrays[thread.index()]);
                for _ in 0..times {
                    arithmetic.triad(black_box(a), b, 0.5);
                }
            });
        });
        let lines: usize = self.arrays.iter().map(|arrays| enter(arrays)[0].len()).sum();
        rate.times((lines * InstructionSet::TRIAD_BYTES) as f64)
    }
}

/// Fused operations and divisions per second of all threads of a pool.
pub fn arithmetic_rates(arithmetic: InstructionSet, pool: &ThreadPool, seconds: f64) -> [Rate; 2] {
    // Enough rounds for one call that calling costs nothing.
    const ROUNDS: u64 = 1000;
    let threads = pool.current_num_threads();
    let operations = (ROUNDS as usize * arithmetic.operations_per_round() * threads) as f64;
    let of = |work: fn(InstructionSet, u64, f64) -> f64| {
        let rate = Rate::of(seconds, threads, |times| {
            pool.broadcast(|_| {
                for _ in 0..times {
                    black_box(work(arithmetic, ROUNDS, black_box(0.999)));
                }
            });
        });
        rate.times(operations)
    };
    [of(InstructionSet::multiply_adds), of(InstructionSet::divisions)]
}

/// What bounds the rate of sweeps, measured in one turn; by the CPU clock.
#[derive(Debug, Clone, Copy)]
pub struct Roofs {
    /// Bytes per second between processors and their first caches, and where the set lies.
    pub first_cache: f64,
    pub set: f64,
    /// Fused operations and divisions per second.
    pub fused: f64,
    pub divisions: f64,
}

impl Roofs {
    /// The least of what bounds visits per second, and its name. `traffic` and `operations` are those of
    /// `visits` visits.
    pub fn least(
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
    fn the_lowest_roof_is_found_and_named() {
        let traffic = MemoryTraffic { footprint: 1000, core: 400, streamed: 200 };
        let operations = OperationCounts { plain: 10, fused: 10, divisions: 1 };
        let roofs = Roofs { first_cache: 4000.0, set: 1000.0, fused: 16_000.0, divisions: 80.0 };
        assert_eq!(roofs.least(&traffic, &operations, 2.0), (10.0, "memory"));
        let roofs = Roofs { divisions: 8.0, ..roofs };
        assert_eq!(roofs.least(&traffic, &operations, 2.0), (2.0, "divisions"));
    }

    #[test]
    fn a_rate_counts_what_was_done() {
        let mut done = 0;
        let rate = Rate::of(0.001, 1, |times| {
            std::thread::sleep(std::time::Duration::from_micros(200 * times));
            done += times;
        });
        assert!(rate.wall > 0.0 && rate.wall <= 5000.0, "{rate:?}");
        assert!(done >= 1 && rate.cpu > 0.0, "{done}, {rate:?}");
    }
}
