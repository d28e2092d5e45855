//! Whether a component is there, and what it does: its liveliness tokens and its heartbeat.

use crate::locked;
use ballast_protocol::lockstep::{ComponentState, StatusReport};
use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Most tokens of one component: there are two for a moment when a run begins anew.
const MOST_TOKENS: usize = 16;

pub(super) struct Presence {
    seen: Mutex<Seen>,
    changed: Condvar,
}

struct Seen {
    /// Runs that are alive.
    tokens: BTreeSet<String>,
    /// The last sign of life.
    at: Instant,
    status: Option<StatusReport>,
    beats: u64,
    /// How many of the last beats in a row found it waiting.
    idle_beats: u64,
    /// How many of the last beats in a row told of the same owner, or of none.
    alike_beats: u64,
}

impl Presence {
    pub fn new() -> Self {
        let seen = Seen {
            tokens: BTreeSet::new(),
            at: Instant::now(),
            status: None,
            beats: 0,
            idle_beats: 0,
            alike_beats: 0,
        };
        Self { seen: Mutex::new(seen), changed: Condvar::new() }
    }

    fn seen(&self) -> MutexGuard<'_, Seen> {
        locked(&self.seen)
    }

    pub fn appears(&self, run: &str) {
        let mut seen = self.seen();
        if seen.tokens.len() < MOST_TOKENS {
            seen.tokens.insert(run.into());
        }
        seen.at = Instant::now();
        self.changed.notify_all();
    }

    pub fn vanishes(&self, run: &str) {
        let mut seen = self.seen();
        seen.tokens.remove(run);
        seen.at = Instant::now();
    }

    pub fn tells(&self, status: StatusReport) {
        let mut seen = self.seen();
        let is_busy = matches!(status.state, ComponentState::Running | ComponentState::Preparing);
        seen.idle_beats = if is_busy { 0 } else { seen.idle_beats + 1 };
        let is_alike = seen.status.as_ref().is_some_and(|last| last.owner == status.owner);
        seen.alike_beats = if is_alike { seen.alike_beats + 1 } else { 1 };
        seen.beats += 1;
        seen.status = Some(status);
        seen.at = Instant::now();
        self.changed.notify_all();
    }

    /// What it was doing when it last told.
    pub fn status(&self) -> Option<StatusReport> {
        self.seen().status.clone()
    }

    /// How many times it has told what it does.
    pub fn beats(&self) -> u64 {
        self.seen().beats
    }

    /// Who drives, if it has told so twice in a row since there were `beats` of them: the first may have been on its way
    /// before, or from another component that has yet to find out that its name is taken.
    pub fn owner_since(&self, beats: u64) -> Option<Option<String>> {
        let seen = self.seen();
        let is_sure = seen.beats >= beats + 2 && seen.alike_beats >= 2;
        seen.status.as_ref().filter(|_| is_sure).map(|status| status.owner.clone())
    }

    /// Whether it has been waiting for two beats since there were `beats` of them: it has not got, or has
    /// answered, what it was asked.
    pub fn is_idle_since(&self, beats: u64) -> bool {
        let seen = self.seen();
        seen.beats >= beats + 2 && seen.idle_beats >= 2
    }

    /// For how long it has been neither alive nor heard of, if so; counted from `since` at the earliest, if that is given.
    pub fn gone_for(&self, since: Option<Instant>) -> Option<Duration> {
        let seen = self.seen();
        seen.tokens.is_empty().then(|| since.map_or(seen.at, |since| seen.at.max(since)).elapsed())
    }

    /// Sleeps until there is a sign of life, `most` at the longest.
    pub fn wait(&self, most: Duration) {
        let seen = self.seen();
        let before = seen.at;
        let waited = self.changed.wait_timeout_while(seen, most, |seen| seen.at == before);
        drop(waited);
    }
}
