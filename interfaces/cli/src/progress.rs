//! Progress of a task: a bar on a terminal, otherwise a line per tenth or an event per hundredth, at least one in half a
//! minute.

use crate::console::{Console, write_err, write_out};
use ballast_session::table::duration;
use ballast_session::{ProgressLabel, ProgressMeter, Reporter};

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Steps of the bar.
const BAR_STEPS: u64 = 1000;
/// Maximum time between two messages without a bar.
const MAX_SILENCE: Duration = Duration::from_secs(30);

/// Display of the progress of a task, as a bar, messages or events.
#[derive(Debug)]
pub struct ConsoleProgress {
    console: Console,
    task: String,
    bar: Option<ProgressBar>,
    start: Instant,
    /// Number of messages for the whole task.
    messages: u64,
    /// Number of the next message.
    next: u64,
    last: Instant,
}

impl ConsoleProgress {
    /// Starts to show a task.
    pub fn start(console: Console, task: &str) -> Self {
        let bar = console.is_terminal().then(|| {
            let style = ProgressStyle::with_template("{prefix} [{bar:24}] {percent:>3} % {msg}");
            let bar = ProgressBar::new(BAR_STEPS).with_prefix(task.to_string());
            bar.set_style(style.expect("the template is constant").progress_chars("=> "));
            bar
        });
        let messages = if console.json { 100 } else { 10 };
        Self {
            console,
            task: task.to_string(),
            bar,
            start: Instant::now(),
            messages,
            next: 1,
            last: Instant::now(),
        }
    }

    fn event(&self, fraction: f64, left: Option<Duration>, label: &dyn ProgressLabel) {
        let mut fields = json!({ "task": self.task, "fraction": fraction });
        if let (Some(fields), Value::Object(more)) = (fields.as_object_mut(), label.fields()) {
            fields.extend(more);
            let seconds = left.map(|left| left.as_secs_f64());
            fields.insert("seconds_left".into(), json!(seconds));
        }
        self.console.event("progress", fields);
    }

    /// Estimates the remaining time; `None` at the very beginning.
    fn left(&self, fraction: f64) -> Option<Duration> {
        (fraction > 1e-6)
            .then(|| self.elapsed().mul_f64(((1.0 - fraction) / fraction).clamp(0.0, 1e9)))
    }
}

impl Drop for ConsoleProgress {
    fn drop(&mut self) {
        self.finish();
    }
}

impl ProgressMeter for ConsoleProgress {
    fn advance(&mut self, fraction: f64, label: &dyn ProgressLabel) {
        let left = self.left(fraction);
        if let Some(bar) = &self.bar {
            bar.set_position(whole(fraction, BAR_STEPS));
            bar.set_message(format!("{} · {}", label.text(), left_text(left)));
        }
        let due = whole(fraction, self.messages) >= self.next || self.last.elapsed() >= MAX_SILENCE;
        if due && (self.console.json || self.bar.is_none()) {
            self.next = whole(fraction, self.messages) + 1;
            self.last = Instant::now();
            if self.console.json {
                self.event(fraction, left, label);
            } else {
                let task = &self.task;
                let percent = whole(fraction, 100);
                let text = label.text();
                let left = left_text(left);
                self.console.note(&format!("{task} {percent:>3} % · {text} · {left}"));
            }
        }
    }

    fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Removes the bar from the terminal.
    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Reporter for Console {
    fn note(&self, text: &str) {
        write_err(text);
    }

    /// Prints a warning, also as an event.
    fn warning(&self, text: &str) {
        write_err(&format!("warning: {text}"));
        self.event("warning", json!({ "message": text }));
    }

    /// Prints an event with the key `event`; nothing without `json`.
    fn event(&self, name: &str, fields: Value) {
        if self.json {
            let mut event = json!({ "event": name });
            if let (Some(event), Value::Object(fields)) = (event.as_object_mut(), fields) {
                event.extend(fields);
            }
            write_out(&event.to_string());
        }
    }

    /// Prints a result for a person; nothing with `json`.
    fn result(&self, text: &str) {
        if !self.json {
            write_out(text);
        }
    }

    fn line(&self, text: &str) {
        write_out(text);
    }

    fn start_progress(&self, task: &str) -> Box<dyn ProgressMeter> {
        Box::new(ConsoleProgress::start(*self, task))
    }
}

/// Returns the number of whole parts in a fraction of a task.
fn whole(fraction: f64, parts: u64) -> u64 {
    // A fraction that should be exactly k/parts may be a rounding error below it.
    (fraction.clamp(0.0, 1.0) * parts as f64 + 1e-9) as u64
}

fn left_text(left: Option<Duration>) -> String {
    left.map_or("time left unknown".into(), |left| format!("{} left", duration(left)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_misses_no_tenth() {
        assert_eq!(whole(0.1 + 0.2, 10), 3);
        assert_eq!((1..=50).filter(|i| whole(*i as f64 / 50.0, 50) != *i).count(), 0);
        assert_eq!(whole(7.0, 10), 10);
    }
}
