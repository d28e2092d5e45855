//! Words of a program that others wait for: they must not wait for their reader in turn.
//!
//! A reader that has stopped (a supervisor that reads no further than `ready`, a terminal after Ctrl-S) lets a pipe fill
//! up, and then whoever writes waits. Here a thread of its own does. What comes while [`LINES`] are waiting is lost, and
//! how much was lost is told where it would have stood.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// How much waits for a reader: about a megabyte of events.
const LINES: usize = 4096;
/// How long a reader may take none of it before the program ends without him.
const PATIENCE: Duration = Duration::from_secs(1);

/// What is said on one stream. Until it is [opened](Voice::open), words are written by whoever has them.
pub struct Voice {
    queue: Mutex<Queue>,
    moved: Condvar,
}

struct Queue {
    lines: VecDeque<String>,
    /// Lines that found no room since the last one that did.
    lost: usize,
    /// Lines a reader has taken.
    taken: u64,
    is_open: bool,
    is_writing: bool,
}

impl Voice {
    pub const fn new() -> Self {
        let lines = VecDeque::new();
        let queue = Queue { lines, lost: 0, taken: 0, is_open: false, is_writing: false };
        Self { queue: Mutex::new(queue), moved: Condvar::new() }
    }

    /// From here on a thread writes with `write`; `lost` words how many lines are missing.
    pub fn open(&'static self, write: fn(&str), lost: fn(usize) -> String) {
        self.queue().is_open = true;
        let speak = move || {
            loop {
                let line = self.next(lost);
                write(&line);
                let mut queue = self.queue();
                (queue.taken, queue.is_writing) = (queue.taken + 1, false);
                self.moved.notify_all();
            }
        };
        if thread::Builder::new().name("voice".into()).spawn(speak).is_err() {
            self.queue().is_open = false;
        }
    }

    /// Whether this was taken to be written, or lost.
    pub fn takes(&self, line: &str) -> bool {
        let mut queue = self.queue();
        if queue.is_open {
            if queue.lines.len() < LINES && queue.lost == 0 {
                queue.lines.push_back(line.into());
            } else {
                queue.lost += 1;
            }
            self.moved.notify_all();
        }
        queue.is_open
    }

    /// Waits until all is written, or nobody reads.
    pub fn finish(&self) {
        let mut queue = self.queue();
        while queue.is_open && (queue.is_writing || !queue.lines.is_empty() || queue.lost > 0) {
            let taken = queue.taken;
            let is_still = |queue: &mut Queue| queue.taken == taken;
            let (now, waited) = self
                .moved
                .wait_timeout_while(queue, PATIENCE, is_still)
                .unwrap_or_else(PoisonError::into_inner);
            if waited.timed_out() {
                return;
            }
            queue = now;
        }
    }

    /// The next line that is to be written, as soon as there is one.
    fn next(&self, lost: fn(usize) -> String) -> String {
        let mut queue = self.queue();
        loop {
            let line = queue.lines.pop_front().or_else(|| {
                let count = std::mem::take(&mut queue.lost);
                (count > 0).then(|| lost(count))
            });
            if let Some(line) = line {
                queue.is_writing = true;
                return line;
            }
            queue = self.moved.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    static SAID: Mutex<Vec<String>> = Mutex::new(Vec::new());
    static READS: Mutex<()> = Mutex::new(());

    fn write(line: &str) {
        let _reads = READS.lock().unwrap();
        SAID.lock().unwrap().push(line.into());
    }

    #[test]
    fn a_reader_that_stops_holds_nobody_up_and_learns_what_it_missed() {
        static VOICE: Voice = Voice::new();
        assert!(!VOICE.takes("before it is opened"));
        VOICE.open(write, |count| format!("{count} lost"));
        let all = LINES + 10;
        let stopped = READS.lock().unwrap();
        for line in 0..all {
            assert!(VOICE.takes(&line.to_string()));
        }
        VOICE.finish();
        assert!(SAID.lock().unwrap().is_empty());
        drop(stopped);
        VOICE.finish();
        assert!(VOICE.takes("after"));
        VOICE.finish();
        let said = SAID.lock().unwrap();
        // One line may have been on its way already.
        let told = said.len() - 2;
        assert!((LINES..=LINES + 1).contains(&told), "{told} of {all} were told");
        assert!(said[..told].iter().enumerate().all(|(at, line)| *line == at.to_string()));
        assert_eq!(said[told..], [format!("{} lost", all - told), "after".into()]);
    }
}
