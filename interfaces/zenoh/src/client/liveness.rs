//! Liveness of a component: its liveliness tokens and its heartbeat.

use crate::lock_unpoisoned;
use ballast_protocol::lockstep::{ComponentState, StatusReport};
use std::collections::BTreeSet;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Maximum number of remembered tokens; a component has two for a moment when a new run starts.
const MAX_TOKENS: usize = 16;

/// Monitor of the tokens and heartbeats of a component.
pub(super) struct LivenessMonitor {
    snapshot: Mutex<PeerSnapshot>,
    changed: Condvar,
}

struct PeerSnapshot {
    /// Runs with a liveliness token.
    tokens: BTreeSet<String>,
    /// Time of the last token or heartbeat.
    last_seen_at: Instant,
    status: Option<StatusReport>,
    heartbeats: u64,
    /// Number of consecutive heartbeats in an idle state.
    idle_heartbeats: u64,
    /// Number of consecutive heartbeats with the same owner.
    same_owner_heartbeats: u64,
}

impl LivenessMonitor {
    pub fn new() -> Self {
        let snapshot = PeerSnapshot {
            tokens: BTreeSet::new(),
            last_seen_at: Instant::now(),
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
        snapshot.last_seen_at = Instant::now();
        self.changed.notify_all();
    }

    pub fn token_vanished(&self, run: &str) {
        let mut snapshot = self.lock();
        snapshot.tokens.remove(run);
        snapshot.last_seen_at = Instant::now();
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
        snapshot.last_seen_at = Instant::now();
        self.changed.notify_all();
    }

    /// Returns the status of the last heartbeat.
    pub fn status(&self) -> Option<StatusReport> {
        self.lock().status.clone()
    }

    /// Returns the number of received heartbeats.
    pub fn heartbeats(&self) -> u64 {
        self.lock().heartbeats
    }

    /// Returns the owner that two consecutive heartbeats after number `heartbeats` have named.
    ///
    /// A single one may be late, or come from another component that is about to find its key in use.
    pub fn owner_since(&self, heartbeats: u64) -> Option<Option<String>> {
        let snapshot = self.lock();
        let is_sure = snapshot.heartbeats >= heartbeats + 2 && snapshot.same_owner_heartbeats >= 2;
        snapshot.status.as_ref().filter(|_| is_sure).map(|status| status.owner.clone())
    }

    /// Returns true if two heartbeats after number `heartbeats` were idle: the request has not arrived, or is answered.
    pub fn is_idle_since(&self, heartbeats: u64) -> bool {
        let snapshot = self.lock();
        snapshot.heartbeats >= heartbeats + 2 && snapshot.idle_heartbeats >= 2
    }

    /// Returns the time without token and heartbeat, counted from `since` at the earliest; `None` while a token exists.
    pub fn disconnected_for(&self, since: Option<Instant>) -> Option<Duration> {
        let snapshot = self.lock();
        snapshot.tokens.is_empty().then(|| {
            since.map_or(snapshot.last_seen_at, |since| snapshot.last_seen_at.max(since)).elapsed()
        })
    }

    /// Sleeps until a token or heartbeat arrives, at most for `timeout`.
    pub fn wait(&self, timeout: Duration) {
        let snapshot = self.lock();
        let before = snapshot.last_seen_at;
        let waited = self
            .changed
            .wait_timeout_while(snapshot, timeout, |snapshot| snapshot.last_seen_at == before);
        drop(waited);
    }
}
