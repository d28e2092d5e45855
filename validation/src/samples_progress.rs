//! Computation of the samples of a check, with progress.

use ballast_session::{ProgressLabel, ProgressMeter, Reporter, Result, threads};

use serde_json::{Value, json};
use std::sync::Mutex;

/// Computes many small samples in parallel, each on its share of the threads.
pub fn map_parallel<T: Sync, R: Send>(
    what: &str,
    items: &[T],
    console: &dyn Reporter,
    compute: impl Fn(&T) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let done = Mutex::new(SampleCounter::start(what, items.len(), console));
    threads::map_parallel(items, compute, || done.lock().expect("counting cannot fail").add_one())
}

/// Computes samples of growing size one after the other, each on all threads.
pub fn map_in_order<T, R>(
    what: &str,
    items: &[T],
    console: &dyn Reporter,
    compute: impl Fn(&T) -> Result<R>,
) -> Result<Vec<R>> {
    let mut done = SampleCounter::start(what, items.len(), console);
    items.iter().map(|item| compute(item).inspect(|_| done.add_one())).collect()
}

/// Number of finished samples, with their progress display.
struct SampleCounter {
    progress: Box<dyn ProgressMeter>,
    count: usize,
    total: usize,
}

impl SampleCounter {
    fn start(what: &str, total: usize, console: &dyn Reporter) -> Self {
        let mut done = Self { progress: console.start_progress(what), count: 0, total };
        done.show();
        done
    }

    fn add_one(&mut self) {
        self.count += 1;
        self.show();
    }

    fn show(&mut self) {
        let label = CountLabel { done: self.count, total: self.total };
        self.progress.advance(self.count as f64 / self.total.max(1) as f64, &label);
    }
}

/// Number of finished samples and of all samples.
struct CountLabel {
    done: usize,
    total: usize,
}

impl ProgressLabel for CountLabel {
    fn text(&self) -> String {
        format!("{} of {}", self.done, self.total)
    }

    fn fields(&self) -> Value {
        json!({ "done": self.done, "total": self.total })
    }
}
