//! What the threads of the transport see of the computing one.
//!
//! Contract: a short lock, never held while waiting; a picture that is whole at any time.

use crate::{HEARTBEAT_INTERVAL, MAX_MESSAGE_BYTES, locked};
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{
    ComponentState, ErrorCode, Lockstep, RequestError, RequestKind, StatusReport, WindowProgress,
};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;

/// Most requests that wait, and most bytes of theirs.
pub(super) const MOST_REQUESTS: usize = 64;
const MOST_BYTES: usize = 2 * MAX_MESSAGE_BYTES;
/// Most of them that want to drive: each may take a look at who is alive.
const MOST_ATTACHES: usize = 4;
/// Most requests of others than the owner: at once, and per second in the long run. A thousand observers that look
/// twice a second stay below.
const BURST: f64 = 4000.0;
const PER_SECOND: f64 = 4000.0;
/// Most clients whose tokens are remembered; others are looked up.
const MOST_CLIENTS: usize = 1000;

/// A window is computed for an owner that is gone for so long, in case it comes back: ten heartbeats.
const FORSAKEN_MS: u64 = 10 * HEARTBEAT_INTERVAL.as_millis() as u64;

/// What is waited for while a bed is prepared.
const BED: &str = "the bed to be prepared";

pub(super) struct Shared {
    start: Instant,
    seen: Mutex<Seen>,
}

struct Seen {
    /// As it was `at` ms after the start.
    report: StatusReport,
    at: u64,
    /// None before there is a bed.
    description: Option<ComponentDescription>,
    /// Who drives, with the ticket.
    owner: Option<(String, String)>,
    /// Since when the owner's token is gone, ms after the start.
    owner_gone_at: Option<u64>,
    /// The ticket with which its owner has asked to leave, or to end the component, until that is done.
    leaving: Option<String>,
    /// Clients that are alive, as many as are remembered.
    live: BTreeSet<String>,
    /// The client that was seen alive when it asked to drive, while it is: however many others there are.
    driver: Option<String>,
    requests: usize,
    attaches: usize,
    bytes: usize,
    /// How many requests of others are still answered now, as of so many ns after the start.
    allowance: f64,
    allowed_at: u64,
}

impl Seen {
    fn is_live(&self, client: &str) -> bool {
        self.live.contains(client) || self.driver.as_deref() == Some(client)
    }
}

impl Shared {
    /// Of a component that is being prepared.
    pub fn settling() -> Self {
        let report = StatusReport {
            state: ComponentState::Preparing,
            waiting_for: Some(BED.into()),
            waiting_since_ms: Some(0),
            ..StatusReport::default()
        };
        let seen = Seen {
            report,
            at: 0,
            description: None,
            owner: None,
            owner_gone_at: None,
            leaving: None,
            live: BTreeSet::new(),
            driver: None,
            requests: 0,
            attaches: 0,
            bytes: 0,
            allowance: BURST,
            allowed_at: 0,
        };
        Self { start: Instant::now(), seen: Mutex::new(seen) }
    }

    fn seen(&self) -> MutexGuard<'_, Seen> {
        locked(&self.seen)
    }

    /// Wall time since the start, ms.
    pub fn now_ms(&self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    /// The same, ns.
    pub fn now_ns(&self) -> u64 {
        self.start.elapsed().as_nanos() as u64
    }

    /// What the component is doing, now.
    pub fn status(&self) -> StatusReport {
        let now = self.now_ms();
        let seen = self.seen();
        let (mut report, passed) = (seen.report.clone(), now.saturating_sub(seen.at));
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

    pub fn is_quitting(&self) -> bool {
        self.seen().report.state == ComponentState::ShuttingDown
    }

    /// Shows the component between two requests.
    pub fn show(&self, lockstep: &Lockstep, report: StatusReport) {
        let now = self.now_ms();
        let owner = lockstep.owner();
        let owner = owner.client().zip(owner.ticket()).map(|(c, t)| (c.to_string(), t.to_string()));
        let mut seen = self.seen();
        if seen.owner != owner {
            // A token may have gone while its owner was still asking.
            let live = owner.as_ref().is_none_or(|(client, _)| seen.is_live(client));
            (seen.owner_gone_at, seen.owner) = ((!live).then_some(now), owner);
        }
        (seen.report, seen.at) = (report, now);
        if let Some(description) = &mut seen.description {
            description.follow(lockstep);
        }
    }

    /// Shows that a bed is being prepared.
    pub fn show_settling(&self) {
        let now = self.now_ms();
        let mut seen = self.seen();
        let passed = now.saturating_sub(seen.at);
        let report = &mut seen.report;
        report.state = ComponentState::Preparing;
        report.owner_since_ms = report.owner_since_ms.map(|ms| ms + passed);
        (report.waiting_for, report.waiting_since_ms) = (Some(BED.into()), Some(0));
        seen.at = now;
    }

    /// Shows how far a window is.
    pub fn show_progress(&self, progress: &WindowProgress) {
        let now = self.now_ms();
        let mut seen = self.seen();
        let passed = now.saturating_sub(seen.at);
        let report = &mut seen.report;
        report.state = ComponentState::Running;
        report.owner_since_ms = report.owner_since_ms.map(|ms| ms + passed);
        (report.waiting_for, report.waiting_since_ms) = (None, None);
        report.progress = Some(*progress);
        seen.at = now;
    }

    /// Shows what the component is; where its bodies are follows with each [`Shared::show`].
    pub fn describe(&self, description: Option<ComponentDescription>) {
        self.seen().description = description;
    }

    /// What the component says of itself, as JSON.
    ///
    /// # Errors
    /// It is being prepared.
    pub fn description(&self) -> Result<String, RequestError> {
        self.described(serde_json::to_string)
    }

    /// What the case has set, as JSON.
    ///
    /// # Errors
    /// It is being prepared.
    pub fn parameters(&self) -> Result<String, RequestError> {
        self.described(|whole| serde_json::to_string(&whole.parameters))
    }

    fn described(
        &self,
        json: impl Fn(&ComponentDescription) -> serde_json::Result<String>,
    ) -> Result<String, RequestError> {
        // Out of the lock, which the computing thread takes in every step.
        let (description, activity) = {
            let seen = self.seen();
            (seen.description.clone(), seen.report.state)
        };
        match description {
            Some(description) => json(&description)
                .map_err(|e| RequestError::new(ErrorCode::ErrorState, e.to_string())),
            None if activity == ComponentState::Unconfigured => {
                let message = "there is no bed yet; the owner asks for init";
                Err(RequestError::new(ErrorCode::Unconfigured, message))
            }
            None => {
                let message = "the bed is being prepared; ask again when the status says PAUSED";
                Err(RequestError::new(ErrorCode::Preparing, message))
            }
        }
    }

    pub fn client_is_alive(&self, client: String) {
        let mut seen = self.seen();
        if seen.owner.as_ref().is_some_and(|(owner, _)| *owner == client) {
            seen.owner_gone_at = None;
        }
        if seen.live.len() < MOST_CLIENTS {
            seen.live.insert(client);
        }
    }

    /// The same of a client that asks to drive.
    pub fn driver_is_alive(&self, client: String) {
        self.seen().driver = Some(client.clone());
        self.client_is_alive(client);
    }

    pub fn client_is_gone(&self, client: &str) {
        let now = self.now_ms();
        let mut seen = self.seen();
        seen.live.remove(client);
        seen.driver.take_if(|driver| driver == client);
        if seen.owner.as_ref().is_some_and(|(owner, _)| owner == client) {
            seen.owner_gone_at.get_or_insert(now);
        }
    }

    pub fn is_live(&self, client: &str) -> bool {
        self.seen().is_live(client)
    }

    /// The owner, if it has gone since it was asked last.
    pub fn take_lost_owner(&self) -> Option<String> {
        let mut seen = self.seen();
        let gone = seen.owner_gone_at.take();
        seen.owner.as_ref().filter(|_| gone.is_some()).map(|(client, _)| client.clone())
    }

    /// Whether the owner has been gone for so long that its window is not worth computing any more.
    pub fn is_forsaken(&self) -> bool {
        let now = self.now_ms();
        self.seen().owner_gone_at.is_some_and(|at| now.saturating_sub(at) >= FORSAKEN_MS)
    }

    /// Tells the window at hand whose owner leaves, if it does.
    pub fn set_leaving(&self, ticket: Option<&str>) {
        self.seen().leaving = ticket.map(str::to_string);
    }

    /// Whether the owner waits for its window only to leave.
    pub fn is_left(&self) -> bool {
        let seen = self.seen();
        seen.leaving.is_some() && seen.leaving.as_ref() == seen.owner.as_ref().map(|(_, t)| t)
    }

    /// Refuses who does not drive, before its request takes any room.
    pub fn check_owner(&self, ticket: &str) -> Result<(), RequestError> {
        let seen = self.seen();
        match &seen.owner {
            Some((_, known)) if known == ticket => Ok(()),
            owner => {
                Err(RequestError::not_owner(ticket, owner.as_ref().map(|(client, _)| &client[..])))
            }
        }
    }

    /// Refuses who wants to drive while another one does; also while a window is computed.
    pub fn check_free(&self, ticket: Option<&str>) -> Result<(), RequestError> {
        let status = self.status();
        let seen = self.seen();
        let Some((owner, known)) = &seen.owner else { return Ok(()) };
        if ticket == Some(known) {
            return Ok(());
        }
        let since = status.owner_since_ms.unwrap_or(0);
        let gone = if seen.owner_gone_at.is_some() {
            "; it is gone, its last window is being computed"
        } else {
            ""
        };
        let message = format!("{owner:?} drives, for {:.1} s{gone}", since as f64 * 1e-3);
        let fault = RequestError::new(ErrorCode::Busy, message);
        Err(RequestError { owner: Some(owner.clone()), since_ms: Some(since), ..fault })
    }

    /// Refuses what comes faster than this component answers, whoever sends it; the owner is not counted, for
    /// what it asks waits in its turn.
    pub fn check_rate(&self) -> Result<(), RequestError> {
        let now = self.now_ns();
        let mut seen = self.seen();
        let passed = now.saturating_sub(seen.allowed_at) as f64 * 1e-9;
        seen.allowance = (seen.allowance + passed * PER_SECOND).min(BURST);
        seen.allowed_at = now;
        if seen.allowance >= 1.0 {
            seen.allowance -= 1.0;
            return Ok(());
        }
        let expected = format!("at most {PER_SECOND} of others than the owner");
        Err(RequestError::expected(
            ErrorCode::TooManyRequests,
            "requests per second",
            expected,
            "more",
        ))
    }

    /// Takes room for a request of so many bytes.
    pub fn admit(self: &Arc<Self>, verb: RequestKind, bytes: usize) -> Result<Room, RequestError> {
        let mut seen = self.seen();
        let attaches = verb == RequestKind::Attach;
        if attaches && seen.attaches >= MOST_ATTACHES {
            let expected = format!("at most {MOST_ATTACHES}");
            let found = format!("{}, and one more", seen.attaches);
            let place = "clients that wait to attach";
            return Err(RequestError::expected(ErrorCode::TooManyRequests, place, expected, found));
        }
        if seen.requests >= MOST_REQUESTS || seen.bytes + bytes > MOST_BYTES {
            let expected = format!("at most {MOST_REQUESTS} with {MOST_BYTES} bytes");
            let found = format!("{} with {}, and one more", seen.requests, seen.bytes);
            return Err(RequestError::expected(
                ErrorCode::TooManyRequests,
                "requests that wait",
                expected,
                found,
            ));
        }
        seen.requests += 1;
        seen.attaches += usize::from(attaches);
        seen.bytes += bytes;
        Ok(Room { shared: Arc::clone(self), attaches, bytes })
    }
}

/// What a request takes while it waits and is done: given back when it is let go.
pub(super) struct Room {
    shared: Arc<Shared>,
    attaches: bool,
    bytes: usize,
}

impl Drop for Room {
    fn drop(&mut self) {
        let mut seen = self.shared.seen();
        seen.requests -= 1;
        seen.attaches -= usize::from(self.attaches);
        seen.bytes -= self.bytes;
    }
}
