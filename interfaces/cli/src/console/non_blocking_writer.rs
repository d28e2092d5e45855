//! Bounded output that never blocks its caller.
//!
//! A reader that stops reading (a supervisor that reads up to `ready`, a terminal after Ctrl-S) lets a pipe fill up, and
//! writes to it block. A separate thread does the writing here. With [`MAX_LINES`] in the queue further lines are dropped,
//! and a line with their number takes their place.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// Maximum number of queued lines: about a megabyte of events.
const MAX_LINES: usize = 4096;
/// Time without a read after which the program ends with lines in the queue.
const READ_TIMEOUT: Duration = Duration::from_secs(1);

/// Queue and writing thread of one stream; inactive until [`open`](NonBlockingWriter::open).
pub struct NonBlockingWriter {
    queue: Mutex<LineQueue>,
    moved: Condvar,
}

struct LineQueue {
    lines: VecDeque<String>,
    /// Lines dropped since the last queued one.
    dropped: usize,
    /// Number of written lines.
    written: u64,
    is_open: bool,
    is_writing: bool,
}

impl NonBlockingWriter {
    pub const fn new() -> Self {
        let lines = VecDeque::new();
        let queue = LineQueue { lines, dropped: 0, written: 0, is_open: false, is_writing: false };
        Self { queue: Mutex::new(queue), moved: Condvar::new() }
    }

    /// Starts the thread, which writes with `write`; `lost` makes the line about dropped ones.
    pub fn open(&'static self, write: fn(&str), lost: fn(usize) -> String) {
        self.queue().is_open = true;
        let work = move || {
            loop {
                let line = self.next(lost);
                write(&line);
                let mut queue = self.queue();
                queue.written += 1;
                queue.is_writing = false;
                self.moved.notify_all();
            }
        };
        if thread::Builder::new().name("output".into()).spawn(work).is_err() {
            self.queue().is_open = false;
        }
    }

    /// Queues or drops a line; returns false if the writer is inactive.
    pub fn accepts(&self, line: &str) -> bool {
        let mut queue = self.queue();
        if queue.is_open {
            if queue.lines.len() < MAX_LINES && queue.dropped == 0 {
                queue.lines.push_back(line.into());
            } else {
                queue.dropped += 1;
            }
            self.moved.notify_all();
        }
        queue.is_open
    }

    /// Waits until all lines are written, or none within [`READ_TIMEOUT`].
    pub fn finish(&self) {
        let mut queue = self.queue();
        while queue.is_open && (queue.is_writing || !queue.lines.is_empty() || queue.dropped > 0) {
            let written = queue.written;
            let is_still = |queue: &mut LineQueue| queue.written == written;
            let (now, waited) = self
                .moved
                .wait_timeout_while(queue, READ_TIMEOUT, is_still)
                .unwrap_or_else(PoisonError::into_inner);
            if waited.timed_out() {
                return;
            }
            queue = now;
        }
    }

    /// Waits for the next line to write.
    fn next(&self, lost: fn(usize) -> String) -> String {
        let mut queue = self.queue();
        loop {
            let line = queue.lines.pop_front().or_else(|| {
                let count = std::mem::take(&mut queue.dropped);
                (count > 0).then(|| lost(count))
            });
            if let Some(line) = line {
                queue.is_writing = true;
                return line;
            }
            queue = self.moved.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn queue(&self) -> MutexGuard<'_, LineQueue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    static WRITTEN: Mutex<Vec<String>> = Mutex::new(Vec::new());
    static READS: Mutex<()> = Mutex::new(());

    fn write(line: &str) {
        let _reads = READS.lock().unwrap();
        WRITTEN.lock().unwrap().push(line.into());
    }

    #[test]
    fn stopped_reader_blocks_no_writer_and_learns_the_number_of_dropped_lines() {
        static WRITER: NonBlockingWriter = NonBlockingWriter::new();
        assert!(!WRITER.accepts("before it is opened"));
        WRITER.open(write, |count| format!("{count} lost"));
        let all = MAX_LINES + 10;
        let stopped = READS.lock().unwrap();
        for line in 0..all {
            assert!(WRITER.accepts(&line.to_string()));
        }
        WRITER.finish();
        assert!(WRITTEN.lock().unwrap().is_empty());
        drop(stopped);
        WRITER.finish();
        assert!(WRITER.accepts("after"));
        WRITER.finish();
        let lines_written = WRITTEN.lock().unwrap();
        // One line may have been on its way already.
        let count = lines_written.len() - 2;
        assert!((MAX_LINES..=MAX_LINES + 1).contains(&count), "{count} of {all} were written");
        assert!(
            lines_written[..count].iter().enumerate().all(|(at, line)| *line == at.to_string())
        );
        assert_eq!(lines_written[count..], [format!("{} lost", all - count), "after".into()]);
    }
}
