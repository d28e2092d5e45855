//! Samples of a check, and how far they are.

use ballast_session::Outcome;
use ballast_session::Reporter;
use ballast_session::threads;
use ballast_session::{ProgressLabel, ProgressMeter};
use serde_json::{Value, json};
use std::sync::Mutex;

/// Samples that are computed beside each other, each on its share of the threads: many small ones.
pub fn side_by_side<T: Sync, R: Send>(
    what: &str,
    items: &[T],
    console: &dyn Reporter,
    compute: impl Fn(&T) -> Outcome<R> + Sync,
) -> Outcome<Vec<R>> {
    let done = Mutex::new(Done::none(what, items.len(), console));
    threads::side_by_side(items, compute, || done.lock().expect("counting cannot fail").one())
}

/// Samples that are computed one after the other, each on all threads: those that grow from one to the next.
pub fn in_turn<T, R>(
    what: &str,
    items: &[T],
    console: &dyn Reporter,
    compute: impl Fn(&T) -> Outcome<R>,
) -> Outcome<Vec<R>> {
    let mut done = Done::none(what, items.len(), console);
    items.iter().map(|item| compute(item).inspect(|_| done.one())).collect()
}

/// How many of how many are done.
struct Done {
    progress: Box<dyn ProgressMeter>,
    count: usize,
    of: usize,
}

impl Done {
    fn none(what: &str, of: usize, console: &dyn Reporter) -> Self {
        let mut done = Self { progress: console.start_progress(what), count: 0, of };
        done.tell();
        done
    }

    fn one(&mut self) {
        self.count += 1;
        self.tell();
    }

    fn tell(&mut self) {
        let mark = Counted { done: self.count, of: self.of };
        self.progress.advance(self.count as f64 / self.of.max(1) as f64, &mark);
    }
}

struct Counted {
    done: usize,
    of: usize,
}

impl ProgressLabel for Counted {
    fn text(&self) -> String {
        format!("{} of {}", self.done, self.of)
    }

    fn fields(&self) -> Value {
        json!({ "done": self.done, "of": self.of })
    }
}
