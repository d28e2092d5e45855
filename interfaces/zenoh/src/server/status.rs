//! Status of the computing thread, shared with the transport's threads.
//!
//! Contract: the lock is short and never held while waiting; the snapshot is consistent at any time.

use crate::{HEARTBEAT_INTERVAL, MAX_MESSAGE_BYTES, lock_unpoisoned};
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{
    ComponentState, ErrorCode, Lockstep, RequestError, RequestKind, StatusReport, WindowProgress,
};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;

/// Maximum number of queued requests.
pub(super) const MAX_QUEUED_REQUESTS: usize = 64;
/// Maximum size of all queued requests, bytes.
const MAX_QUEUED_BYTES: usize = 2 * MAX_MESSAGE_BYTES;
/// Maximum number of queued `attach` requests: each may query liveliness tokens.
const MAX_QUEUED_ATTACHES: usize = 4;
/// Maximum burst of requests from clients other than the owner.
const MAX_BURST: f64 = 4000.0;
/// Maximum sustained rate of these requests, 1/s; a thousand observers that poll twice a second stay below.
const MAX_REQUESTS_PER_SECOND: f64 = 4000.0;
/// Maximum number of remembered liveliness tokens; other clients are looked up.
const MAX_KNOWN_CLIENTS: usize = 1000;

/// Time for which a window is computed for a disconnected owner, ms: ten heartbeats.
const OWNER_GRACE_MS: u64 = 10 * HEARTBEAT_INTERVAL.as_millis() as u64;

/// Text of the awaited event while a bed is prepared.
const PREPARATION: &str = "the bed to be prepared";

/// Status of a served component, with the accounts of clients and queued requests.
pub(super) struct SharedStatus {
    start: Instant,
    snapshot: Mutex<ServerSnapshot>,
}

struct ServerSnapshot {
    report: StatusReport,
    /// Time of the report, ms after the start.
    report_at: u64,
    /// `None` before a bed has been prepared.
    description: Option<ComponentDescription>,
    /// Owner and its ticket.
    owner: Option<(String, String)>,
    /// Time at which the owner's token vanished, ms after the start.
    owner_gone_at: Option<u64>,
    /// Ticket of a pending `detach` or `shutdown`.
    leaving: Option<String>,
    /// Clients with a liveliness token, at most [`MAX_KNOWN_CLIENTS`].
    live: BTreeSet<String>,
    /// Client that was alive when it attached, remembered regardless of the limit.
    owner_candidate: Option<String>,
    requests: usize,
    attaches: usize,
    bytes: usize,
    /// Remaining requests of the rate limit.
    allowance: f64,
    /// Time of the last update of the allowance, ns after the start.
    allowance_at: u64,
}

impl ServerSnapshot {
    fn is_live(&self, client: &str) -> bool {
        self.live.contains(client) || self.owner_candidate.as_deref() == Some(client)
    }
}

impl SharedStatus {
    /// Creates the status of a component that is being prepared.
    pub fn preparing() -> Self {
        let report = StatusReport {
            state: ComponentState::Preparing,
            waiting_for: Some(PREPARATION.into()),
            waiting_since_ms: Some(0),
            ..StatusReport::default()
        };
        let snapshot = ServerSnapshot {
            report,
            report_at: 0,
            description: None,
            owner: None,
            owner_gone_at: None,
            leaving: None,
            live: BTreeSet::new(),
            owner_candidate: None,
            requests: 0,
            attaches: 0,
            bytes: 0,
            allowance: MAX_BURST,
            allowance_at: 0,
        };
        Self { start: Instant::now(), snapshot: Mutex::new(snapshot) }
    }

    fn lock(&self) -> MutexGuard<'_, ServerSnapshot> {
        lock_unpoisoned(&self.snapshot)
    }

    /// Wall time since the start, ms.
    pub fn now_ms(&self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    /// Wall time since the start, ns.
    pub fn now_ns(&self) -> u64 {
        self.start.elapsed().as_nanos() as u64
    }

    /// Returns the current status.
    pub fn status(&self) -> StatusReport {
        let now = self.now_ms();
        let seen = self.lock();
        let (mut report, passed) = (seen.report.clone(), now.saturating_sub(seen.report_at));
        drop(seen);
        let later = |ms: &mut Option<u64>| *ms = ms.map(|ms| ms + passed);
        later(&mut report.owner_since_ms);
        later(&mut report.waiting_since_ms);
        if let Some(progress) = &mut report.progress {
            progress.elapsed_ms += passed;
            progress.remaining_ms = progress.remaining_ms.map(|ms| ms.saturating_sub(passed));
        }
        report.uptime_ms = now;
        report
    }

    pub fn is_shutting_down(&self) -> bool {
        self.lock().report.state == ComponentState::ShuttingDown
    }

    /// Sets the status between two requests.
    pub fn set_status(&self, lockstep: &Lockstep, report: StatusReport) {
        let now = self.now_ms();
        let owner = lockstep.owner();
        let owner = owner.client().zip(owner.ticket()).map(|(c, t)| (c.to_string(), t.to_string()));
        let mut seen = self.lock();
        if seen.owner != owner {
            // A token may vanish while its owner attaches.
            let live = owner.as_ref().is_none_or(|(client, _)| seen.is_live(client));
            (seen.owner_gone_at, seen.owner) = ((!live).then_some(now), owner);
        }
        seen.report = report;
        seen.report_at = now;
        if let Some(description) = &mut seen.description {
            description.update(lockstep);
        }
    }

    /// Sets the status while a bed is prepared.
    pub fn set_preparing(&self) {
        let now = self.now_ms();
        let mut seen = self.lock();
        let passed = now.saturating_sub(seen.report_at);
        let report = &mut seen.report;
        report.state = ComponentState::Preparing;
        report.owner_since_ms = report.owner_since_ms.map(|ms| ms + passed);
        (report.waiting_for, report.waiting_since_ms) = (Some(PREPARATION.into()), Some(0));
        seen.report_at = now;
    }

    /// Sets the progress of the running window.
    pub fn set_progress(&self, progress: &WindowProgress) {
        let now = self.now_ms();
        let mut seen = self.lock();
        let passed = now.saturating_sub(seen.report_at);
        let report = &mut seen.report;
        report.state = ComponentState::Running;
        report.owner_since_ms = report.owner_since_ms.map(|ms| ms + passed);
        (report.waiting_for, report.waiting_since_ms) = (None, None);
        report.progress = Some(*progress);
        seen.report_at = now;
    }

    /// Sets the description; [`SharedStatus::set_status`] updates the poses of its bodies.
    pub fn set_description(&self, description: Option<ComponentDescription>) {
        self.lock().description = description;
    }

    /// Returns the description of the component as JSON.
    ///
    /// # Errors
    /// The bed is not prepared.
    pub fn description(&self) -> Result<String, RequestError> {
        self.description_json(serde_json::to_string)
    }

    /// Returns the current parameters as JSON.
    ///
    /// # Errors
    /// The bed is not prepared.
    pub fn parameters(&self) -> Result<String, RequestError> {
        self.description_json(|description| serde_json::to_string(&description.parameters))
    }

    fn description_json(
        &self,
        json: impl Fn(&ComponentDescription) -> serde_json::Result<String>,
    ) -> Result<String, RequestError> {
        // Encoded outside of the lock, which the computing thread takes in every step.
        let (description, activity) = {
            let seen = self.lock();
            (seen.description.clone(), seen.report.state)
        };
        match description {
            Some(description) => json(&description)
                .map_err(|e| RequestError::new(ErrorCode::ErrorState, e.to_string())),
            None if activity == ComponentState::Unconfigured => {
                let message = "no bed has been prepared; the owner requests `init` first";
                Err(RequestError::new(ErrorCode::Unconfigured, message))
            }
            None => {
                let message = "the bed is being prepared; retry when the state is IDLE";
                Err(RequestError::new(ErrorCode::Preparing, message))
            }
        }
    }

    /// Records the liveliness token of a client.
    pub fn client_appeared(&self, client: String) {
        let mut seen = self.lock();
        if seen.owner.as_ref().is_some_and(|(owner, _)| *owner == client) {
            seen.owner_gone_at = None;
        }
        if seen.live.len() < MAX_KNOWN_CLIENTS {
            seen.live.insert(client);
        }
    }

    /// Records the liveliness of a client that attaches.
    pub fn owner_candidate_appeared(&self, client: String) {
        self.lock().owner_candidate = Some(client.clone());
        self.client_appeared(client);
    }

    /// Records that the token of a client has vanished.
    pub fn client_vanished(&self, client: &str) {
        let now = self.now_ms();
        let mut seen = self.lock();
        seen.live.remove(client);
        seen.owner_candidate.take_if(|owner_candidate| owner_candidate == client);
        if seen.owner.as_ref().is_some_and(|(owner, _)| owner == client) {
            seen.owner_gone_at.get_or_insert(now);
        }
    }

    pub fn is_live(&self, client: &str) -> bool {
        self.lock().is_live(client)
    }

    /// Returns the owner if its token has vanished since the last call.
    pub fn take_disconnected_owner(&self) -> Option<String> {
        let mut seen = self.lock();
        let gone = seen.owner_gone_at.take();
        seen.owner.as_ref().filter(|_| gone.is_some()).map(|(client, _)| client.clone())
    }

    /// Returns true if the owner has been disconnected for longer than [`OWNER_GRACE_MS`].
    pub fn is_owner_lost(&self) -> bool {
        let now = self.now_ms();
        self.lock().owner_gone_at.is_some_and(|at| now.saturating_sub(at) >= OWNER_GRACE_MS)
    }

    /// Sets or clears the ticket of a pending `detach` or `shutdown`, which cancels the running window.
    pub fn set_leaving(&self, ticket: Option<&str>) {
        self.lock().leaving = ticket.map(str::to_string);
    }

    /// Returns true if a `detach` or `shutdown` of the owner is pending.
    pub fn is_owner_leaving(&self) -> bool {
        let seen = self.lock();
        seen.leaving.is_some() && seen.leaving.as_ref() == seen.owner.as_ref().map(|(_, t)| t)
    }

    /// Returns an error unless the ticket is that of the owner.
    pub fn check_owner(&self, ticket: &str) -> Result<(), RequestError> {
        let seen = self.lock();
        match &seen.owner {
            Some((_, known)) if known == ticket => Ok(()),
            owner => {
                Err(RequestError::not_owner(ticket, owner.as_ref().map(|(client, _)| &client[..])))
            }
        }
    }

    /// Returns an error if another client is the owner, also while a window is computed.
    pub fn check_free(&self, ticket: Option<&str>) -> Result<(), RequestError> {
        let status = self.status();
        let seen = self.lock();
        let Some((owner, known)) = &seen.owner else { return Ok(()) };
        if ticket == Some(known) {
            return Ok(());
        }
        let since = status.owner_since_ms.unwrap_or(0);
        let gone = if seen.owner_gone_at.is_some() {
            ", which has disconnected; its last window is being computed"
        } else {
            ""
        };
        Err(RequestError::busy(owner, since, gone))
    }

    /// Returns an error if requests of clients other than the owner exceed the rate limit.
    pub fn check_rate(&self) -> Result<(), RequestError> {
        let now = self.now_ns();
        let mut seen = self.lock();
        let passed = now.saturating_sub(seen.allowance_at) as f64 * 1e-9;
        seen.allowance = (seen.allowance + passed * MAX_REQUESTS_PER_SECOND).min(MAX_BURST);
        seen.allowance_at = now;
        if seen.allowance >= 1.0 {
            seen.allowance -= 1.0;
            return Ok(());
        }
        let expected =
            format!("at most {MAX_REQUESTS_PER_SECOND} from clients other than the owner");
        Err(RequestError::expected(
            ErrorCode::TooManyRequests,
            "requests per second",
            expected,
            "more",
        ))
    }

    /// Reserves a place in the queue for a request of `bytes` bytes.
    pub fn admit(
        self: &Arc<Self>,
        kind: RequestKind,
        bytes: usize,
    ) -> Result<QueueSlot, RequestError> {
        let mut seen = self.lock();
        let attaches = kind == RequestKind::Attach;
        if attaches && seen.attaches >= MAX_QUEUED_ATTACHES {
            let expected = format!("at most {MAX_QUEUED_ATTACHES}");
            let found = format!("{} and another one", seen.attaches);
            let place = "queued attach requests";
            return Err(RequestError::expected(ErrorCode::TooManyRequests, place, expected, found));
        }
        if seen.requests >= MAX_QUEUED_REQUESTS || seen.bytes + bytes > MAX_QUEUED_BYTES {
            let expected = format!("at most {MAX_QUEUED_REQUESTS} with {MAX_QUEUED_BYTES} bytes");
            let found = format!("{} with {} and another one", seen.requests, seen.bytes);
            return Err(RequestError::expected(
                ErrorCode::TooManyRequests,
                "queued requests",
                expected,
                found,
            ));
        }
        seen.requests += 1;
        seen.attaches += usize::from(attaches);
        seen.bytes += bytes;
        Ok(QueueSlot { shared: Arc::clone(self), attaches, bytes })
    }
}

/// Reserved place of a request in the queue, released on drop.
pub(super) struct QueueSlot {
    shared: Arc<SharedStatus>,
    attaches: bool,
    bytes: usize,
}

impl Drop for QueueSlot {
    fn drop(&mut self) {
        let mut seen = self.shared.lock();
        seen.requests -= 1;
        seen.attaches -= usize::from(self.attaches);
        seen.bytes -= self.bytes;
    }
}
