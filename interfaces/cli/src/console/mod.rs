//! What the program says: results on stdout, messages on stderr, events as JSON lines.

use crate::progress::Progress;
use ballast_session::{Failure, ProgressMeter, Reporter};
use serde_json::{Value, json};
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(feature = "zenoh")]
mod voice;

/// Where words go. With `json`, stdout carries one event per line and nothing else.
#[derive(Debug, Clone, Copy)]
pub struct Console {
    pub json: bool,
}

impl Console {
    /// A result, for a person; kept off stdout when events are asked for.
    pub fn result(&self, text: &str) {
        if !self.json {
            write_out(text);
        }
    }

    /// An event, for a program: an object with the key `event`.
    pub fn event(&self, name: &str, fields: Value) {
        if self.json {
            let mut event = json!({ "event": name });
            if let (Some(event), Value::Object(fields)) = (event.as_object_mut(), fields) {
                event.extend(fields);
            }
            write_out(&event.to_string());
        }
    }

    /// A message about the course of things.
    pub fn note(&self, text: &str) {
        write_err(text);
    }

    /// Something the person should know although the program goes on.
    pub fn warning(&self, text: &str) {
        write_err(&format!("warning: {text}"));
        self.event("warning", json!({ "message": text }));
    }

    /// Why the program ends.
    pub fn failure(&self, failure: &Failure) {
        write_err(&format!("{}: {failure}", failure.word()));
        self.failure_event(failure);
    }

    /// The same for programs alone, where the person has been told.
    pub fn failure_event(&self, failure: &Failure) {
        let mut fields = json!({
            "kind": failure.word(), "message": failure.to_string(), "exit_code": failure.code(),
        });
        if let Failure::Case(found) = failure {
            fields["errors"] = json!(found.errors);
        }
        self.event("error", fields);
    }

    /// Whether a bar can be drawn.
    pub fn is_terminal(&self) -> bool {
        std::io::stderr().is_terminal()
    }
}

impl Reporter for Console {
    fn note(&self, text: &str) {
        Console::note(self, text);
    }

    fn warning(&self, text: &str) {
        Console::warning(self, text);
    }

    fn event(&self, name: &str, fields: Value) {
        Console::event(self, name, fields);
    }

    fn result(&self, text: &str) {
        Console::result(self, text);
    }

    fn line(&self, text: &str) {
        write_out(text);
    }

    fn start_progress(&self, task: &str) -> Box<dyn ProgressMeter> {
        Box::new(Progress::start(*self, task))
    }
}

/// Whether something could not be written to stdout. What the program does goes on; how it ends is another matter.
static IS_SILENT: AtomicBool = AtomicBool::new(false);
/// Whether the reader of stdout has left.
static IS_LEFT: AtomicBool = AtomicBool::new(false);

/// How stdout and stderr are written once the program [must not wait](never_wait) for who reads them.
#[cfg(feature = "zenoh")]
static OUT: voice::Voice = voice::Voice::new();
#[cfg(feature = "zenoh")]
static ERR: voice::Voice = voice::Voice::new();

/// From here on a reader that has stopped holds nothing up: what it leaves lying is written in the background.
#[cfg(feature = "zenoh")]
pub fn never_wait(console: Console) {
    ERR.open(write_err_now, |count| {
        format!("{count} lines are missing here: nobody has read them in time")
    });
    OUT.open(
        write_out_now,
        match console.json {
            true => |count| json!({ "event": "lost", "lines": count }).to_string(),
            false => |count| format!("{count} lines are missing here"),
        },
    );
}

/// The last word: what was said is written, where somebody reads it.
pub fn finish() {
    #[cfg(feature = "zenoh")]
    for voice in [&OUT, &ERR] {
        voice.finish();
    }
}

/// Writes to stdout. A reader that has seen enough (`| head`) is no error of the run's.
pub fn write_out(text: &str) {
    #[cfg(feature = "zenoh")]
    if OUT.takes(text) {
        return;
    }
    write_out_now(text);
}

fn write_out_now(text: &str) {
    let mut out = std::io::stdout();
    let Err(e) = writeln!(out, "{text}").and_then(|()| out.flush()) else { return };
    if e.kind() == ErrorKind::BrokenPipe {
        IS_LEFT.store(true, Ordering::Relaxed);
    } else if !IS_SILENT.swap(true, Ordering::Relaxed) {
        write_err(&format!("cannot write to standard output: {e}"));
    }
}

/// Writes to stderr. Nobody is left to be told of a failure there (a closed terminal, a reader that has ended), and a run
/// is worth more than a word about it.
pub fn write_err(text: &str) {
    #[cfg(feature = "zenoh")]
    if ERR.takes(text) {
        return;
    }
    write_err_now(text);
}

fn write_err_now(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Whether somebody may still read what is written to stdout.
#[cfg(feature = "zenoh")]
pub fn is_read() -> bool {
    !IS_LEFT.load(Ordering::Relaxed)
}

/// Whether all that was said on stdout was written.
pub fn was_heard() -> bool {
    !IS_SILENT.load(Ordering::Relaxed)
}
