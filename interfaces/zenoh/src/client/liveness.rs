//! Whether a component is there, and what it does: its liveliness tokens and its heartbeat.

use crate::lock_unpoisoned;
use ballast_protocol::lockstep::{ComponentState, StatusReport};
use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Most tokens of one component: there are two for a moment when a run begins anew.
const MAX_TOKENS: usize = 16;

pub(super) struct LivenessMonitor {
    snapshot: Mutex<PeerSnapshot>,
    changed: Condvar,
}

struct PeerSnapshot {
    /// Runs that are alive.
    tokens: BTreeSet<String>,
    /// The last sign of life.
    at: Instant,
    status: Option<StatusReport>,
    heartbeats: u64,
    /// How many of the last heartbeats in a row found it waiting.
    idle_heartbeats: u64,
    /// How many of the last heartbeats in a row told of the same owner, or of none.
    same_owner_heartbeats: u64,
}

impl LivenessMonitor {
    pub fn new() -> Self {
        let snapshot = PeerSnapshot {
            tokens: BTreeSet::new(),
            at: Instant::now(),
            status: None,
            heartbeats: 0,
            idle_heartbeats: 0,
            same_owner_heartbeats: 0,
        };
        Self { snapshot: Mutex::new(snapshot), changed: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, PeerSnapshot> {
        lock_unpoisoned(&self.snapshot)
    }

    pub fn token_appeared(&self, run: &str) {
        let mut snapshot = self.lock();
        if snapshot.tokens.len() < MAX_TOKENS {
            snapshot.tokens.insert(run.into());
        }
        snapshot.at = Instant::now();
        self.changed.notify_all();
    }

    pub fn token_vanished(&self, run: &str) {
        let mut snapshot = self.lock();
        snapshot.tokens.remove(run);
        snapshot.at = Instant::now();
    }

    pub fn heartbeat(&self, status: StatusReport) {
        let mut snapshot = self.lock();
        let is_busy = matches!(status.state, ComponentState::Running | ComponentState::Preparing);
        snapshot.idle_heartbeats = if is_busy { 0 } else { snapshot.idle_heartbeats + 1 };
        let is_alike = snapshot.status.as_ref().is_some_and(|last| last.owner == status.owner);
        snapshot.same_owner_heartbeats =
            if is_alike { snapshot.same_owner_heartbeats + 1 } else { 1 };
        snapshot.heartbeats += 1;
        snapshot.status = Some(status);
        snapshot.at = Instant::now();
        self.changed.notify_all();
    }

    /// What it was doing when it last told.
    pub fn status(&self) -> Option<StatusReport> {
        self.lock().status.clone()
    }

    /// How many times it has told what it does.
    pub fn heartbeats(&self) -> u64 {
        self.lock().heartbeats
    }

    /// Who drives, if it has told so twice in a row since there were `heartbeats` of them: the first may have been on its way
    /// before, or from another component that has yet to find out that its name is taken.
    pub fn owner_since(&self, heartbeats: u64) -> Option<Option<String>> {
        let snapshot = self.lock();
        let is_sure = snapshot.heartbeats >= heartbeats + 2 && snapshot.same_owner_heartbeats >= 2;
        snapshot.status.as_ref().filter(|_| is_sure).map(|status| status.owner.clone())
    }

    /// Whether it has been waiting for two heartbeats since there were `heartbeats` of them: it has not got, or has
    /// answered, what it was asked.
    pub fn is_idle_since(&self, heartbeats: u64) -> bool {
        let snapshot = self.lock();
        snapshot.heartbeats >= heartbeats + 2 && snapshot.idle_heartbeats >= 2
    }

    /// For how long it has been neither alive nor heard of, if so; counted from `since` at the earliest, if that is given.
    pub fn disconnected_for(&self, since: Option<Instant>) -> Option<Duration> {
        let snapshot = self.lock();
        snapshot
            .tokens
            .is_empty()
            .then(|| since.map_or(snapshot.at, |since| snapshot.at.max(since)).elapsed())
    }

    /// Sleeps until there is a sign of life, `most` at the longest.
    pub fn wait(&self, most: Duration) {
        let snapshot = self.lock();
        let before = snapshot.at;
        let waited =
            self.changed.wait_timeout_while(snapshot, most, |snapshot| snapshot.at == before);
        drop(waited);
    }
}
