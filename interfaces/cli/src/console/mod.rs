//! Output of the program: results on standard output, messages on standard error, events as JSON lines.

use ballast_session::{Failure, Reporter};
use serde_json::json;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(feature = "zenoh")]
mod non_blocking_writer;

/// Output of a command. With `json`, standard output carries one event per line and nothing else.
#[derive(Debug, Clone, Copy)]
pub struct Console {
    pub json: bool,
}

impl Console {
    /// Prints the failure that ends the program, also as an event.
    pub fn failure(&self, failure: &Failure) {
        write_err(&format!("{}: {failure}", failure.word()));
        self.failure_event(failure);
    }

    /// Prints the event of the failure that ends the program.
    pub fn failure_event(&self, failure: &Failure) {
        let mut fields = json!({
            "kind": failure.word(), "message": failure.to_string(), "exit_code": failure.code(),
        });
        if let Failure::Case(found) = failure {
            fields["errors"] = json!(found.errors);
        }
        self.event("error", fields);
    }

    /// Returns true if standard error is a terminal.
    pub fn is_terminal(&self) -> bool {
        std::io::stderr().is_terminal()
    }
}

/// True after a failed write to standard output; the command continues, but its exit code is not 0.
static HAS_FAILED: AtomicBool = AtomicBool::new(false);
/// True after the reader of standard output has closed it.
static IS_CLOSED: AtomicBool = AtomicBool::new(false);

/// Writer of standard output after [`stop_blocking`].
#[cfg(feature = "zenoh")]
static OUT: non_blocking_writer::NonBlockingWriter = non_blocking_writer::NonBlockingWriter::new();
/// Writer of standard error after [`stop_blocking`].
#[cfg(feature = "zenoh")]
static ERR: non_blocking_writer::NonBlockingWriter = non_blocking_writer::NonBlockingWriter::new();

/// Makes output non-blocking: a reader that stops reading does not delay the program from now on.
#[cfg(feature = "zenoh")]
pub fn stop_blocking(console: Console) {
    ERR.open(write_err_now, |count| {
        format!("{count} lines are missing here: they were not read in time")
    });
    OUT.open(
        write_out_now,
        match console.json {
            true => |count| json!({ "event": "lost", "lines": count }).to_string(),
            false => |count| format!("{count} lines are missing here"),
        },
    );
}

/// Waits until all output is written, unless the reader has stopped reading.
pub fn finish() {
    #[cfg(feature = "zenoh")]
    for writer in [&OUT, &ERR] {
        writer.finish();
    }
}

/// Writes a line to standard output. A reader that closes it (`| head`) is no error.
pub fn write_out(text: &str) {
    #[cfg(feature = "zenoh")]
    if OUT.accepts(text) {
        return;
    }
    write_out_now(text);
}

fn write_out_now(text: &str) {
    let mut out = std::io::stdout();
    let Err(e) = writeln!(out, "{text}").and_then(|()| out.flush()) else { return };
    if e.kind() == ErrorKind::BrokenPipe {
        IS_CLOSED.store(true, Ordering::Relaxed);
    } else if !HAS_FAILED.swap(true, Ordering::Relaxed) {
        write_err(&format!("cannot write to standard output: {e}"));
    }
}

/// Writes a line to standard error. Failures are ignored: there is no place left to report them.
pub fn write_err(text: &str) {
    #[cfg(feature = "zenoh")]
    if ERR.accepts(text) {
        return;
    }
    write_err_now(text);
}

fn write_err_now(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Returns true until the reader of standard output closes it.
#[cfg(feature = "zenoh")]
pub fn is_open() -> bool {
    !IS_CLOSED.load(Ordering::Relaxed)
}

/// Returns true if all of standard output was written.
pub fn is_complete() -> bool {
    !HAS_FAILED.load(Ordering::Relaxed)
}
