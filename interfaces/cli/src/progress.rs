//! How far the work is: a bar on a terminal, elsewhere a line per tenth, for programs an event per
//! hundredth; at least one in half a minute.

use crate::console::Console;
use ballast_session::table::duration;
pub use ballast_session::{ProgressLabel as Mark, ProgressMeter};
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Parts of the whole that the bar distinguishes.
const PARTS: u64 = 1000;
/// Longest time without a word where there is no bar.
const SILENCE: Duration = Duration::from_secs(30);

/// Tells people and programs how far a piece of work is.
#[derive(Debug)]
pub struct Progress {
    console: Console,
    label: String,
    bar: Option<ProgressBar>,
    began: Instant,
    /// Shares between two words, and the next one.
    shares: u64,
    next: u64,
    last: Instant,
}

impl Progress {
    /// Starts a piece of work.
    pub fn start(console: Console, label: &str) -> Self {
        let bar = console.is_terminal().then(|| {
            let style = ProgressStyle::with_template("{prefix} [{bar:24}] {percent:>3} % {msg}");
            let bar = ProgressBar::new(PARTS).with_prefix(label.to_string());
            bar.set_style(style.expect("the template is constant").progress_chars("=> "));
            bar
        });
        let shares = if console.json { 100 } else { 10 };
        Self {
            console,
            label: label.to_string(),
            bar,
            began: Instant::now(),
            shares,
            next: 1,
            last: Instant::now(),
        }
    }

    /// The share `share` (0 to 1) of the whole is done.
    pub fn advance(&mut self, share: f64, mark: &dyn Mark) {
        let left = self.left(share);
        if let Some(bar) = &self.bar {
            bar.set_position(whole(share, PARTS));
            bar.set_message(format!("{} · {}", mark.text(), left_text(left)));
        }
        let due = whole(share, self.shares) >= self.next || self.last.elapsed() >= SILENCE;
        if due && (self.console.json || self.bar.is_none()) {
            self.next = whole(share, self.shares) + 1;
            self.last = Instant::now();
            if self.console.json {
                self.event(share, left, mark);
            } else {
                let (label, percent) = (&self.label, whole(share, 100));
                let (text, left) = (mark.text(), left_text(left));
                self.console.note(&format!("{label} {percent:>3} % · {text} · {left}"));
            }
        }
    }

    fn event(&self, share: f64, left: Option<Duration>, mark: &dyn Mark) {
        let mut fields = json!({ "work": self.label, "share": share });
        if let (Some(fields), Value::Object(more)) = (fields.as_object_mut(), mark.fields()) {
            fields.extend(more);
            let seconds = left.map(|left| left.as_secs_f64());
            fields.insert("seconds_left".into(), json!(seconds));
        }
        self.console.event("progress", fields);
    }

    /// Wall time since this piece of work began here.
    pub fn elapsed(&self) -> Duration {
        self.began.elapsed()
    }

    /// Takes the bar off the terminal.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// Time that the rest takes at the pace so far, once there is a pace.
    fn left(&self, share: f64) -> Option<Duration> {
        (share > 1e-6).then(|| self.elapsed().mul_f64(((1.0 - share) / share).clamp(0.0, 1e9)))
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

impl ProgressMeter for Progress {
    fn advance(&mut self, fraction: f64, label: &dyn Mark) {
        Progress::advance(self, fraction, label);
    }

    fn elapsed(&self) -> Duration {
        Progress::elapsed(self)
    }

    fn finish(&self) {
        Progress::finish(self);
    }
}

fn whole(share: f64, parts: u64) -> u64 {
    // A share that should be exactly k/parts may be a rounding error below it.
    (share.clamp(0.0, 1.0) * parts as f64 + 1e-9) as u64
}

fn left_text(left: Option<Duration>) -> String {
    left.map_or("time left unknown".into(), |left| format!("{} left", duration(left)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tenths_are_not_missed_by_rounding() {
        assert_eq!(whole(0.1 + 0.2, 10), 3);
        assert_eq!((1..=50).filter(|i| whole(*i as f64 / 50.0, 50) != *i).count(), 0);
        assert_eq!(whole(7.0, 10), 10);
    }
}
