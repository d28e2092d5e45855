//! Client that owns a component in another process and steps it.
//!
//! Contract: a request without reply is repeated and executed once. After a disconnection the client attaches again
//! automatically. If the component restarts from an older checkpoint, the client repeats the windows since then and
//! compares their state hashes. If another client has changed the run, only a saved state or a new run can be used.
//! Every call ends within its timeout, also if the transport does not accept its message.

mod connection;
mod control;
mod journal;
mod liveness;
mod pending;
mod recovery;
mod send_thread;
mod stored_states;

pub use connection::{Connection, Timeouts};
pub use stored_states::StoredStates;

use crate::wire::cdr;
use crate::{Error, SessionConfig, random};
use ballast::cancel::CancelToken;
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{
    AttachRequest, RequestKind, RunPosition, StatusReport, WindowKind,
};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyLoad, BodyMotion, core_ns};
use ballast_protocol::{from_cdr, to_cdr};
use connection::OutgoingRequest;
use journal::Journal;
use pending::{Effect, PendingRequest};
use std::sync::Arc;
use std::time::Duration;
use zenoh::liveliness::LivelinessToken;

/// Client that owns a component.
pub struct Client {
    connection: Connection,
    id: String,
    _token: LivelinessToken,
    ticket: String,
    /// Number of owners when this client attached.
    owner_count: u64,
    position: RunPosition,
    journal: Journal,
    /// True while the real-time mode may be active, so that the position is unknown.
    is_real_time: bool,
    /// Number of heartbeats received when this client last attached.
    heartbeats: u64,
    /// True if the client must attach again before the next request.
    must_reattach: bool,
    /// Request without reply.
    pending: Option<PendingRequest>,
    /// Position found on attaching, if the pending request may have led to it.
    assumed_position: Option<RunPosition>,
    /// Description of the position to which the run has diverged.
    diverged_at: Option<String>,
    /// Credentials and text of an unanswered request to attach.
    pending_attach: Option<(String, Vec<u8>)>,
}

impl Client {
    /// Connects to the component `site/id` and becomes its owner.
    ///
    /// `name` is shown to other clients; it consists of letters, digits, `-`, `_` and `.`. With `run_id`, attaches only
    /// to this run.
    ///
    /// # Errors
    /// An invalid name, a session that cannot be opened, a disconnected component, another owner, or another run.
    pub fn attach(
        component: &str,
        link: &SessionConfig,
        name: &str,
        run_id: Option<&str>,
        timeouts: Timeouts,
    ) -> Result<Self, Error> {
        Self::attach_cancellable(component, link, name, run_id, timeouts, CancelToken::default())
    }

    /// Attaches like [`Client::attach`]; `cancel` ends this and every later call.
    ///
    /// # Errors
    /// Those of [`Client::attach`], and [`Error::Cancelled`].
    pub fn attach_cancellable(
        component: &str,
        link: &SessionConfig,
        name: &str,
        run_id: Option<&str>,
        timeouts: Timeouts,
        cancel: CancelToken,
    ) -> Result<Self, Error> {
        // A unique name, so that a vanished token identifies the connection.
        let id = format!("{name}-{}", &random()?[..8]);
        let connection = Connection::open_cancellable(component, link, timeouts, cancel)?;
        let token = connection.declare_client(&id)?;
        let mut client = Self {
            connection,
            id,
            _token: token,
            ticket: String::new(),
            owner_count: 0,
            position: RunPosition::default(),
            journal: Journal::default(),
            is_real_time: false,
            heartbeats: 0,
            must_reattach: false,
            pending: None,
            assumed_position: None,
            diverged_at: None,
            pending_attach: None,
        };
        let run_id = run_id.map(str::to_string);
        let ask = AttachRequest { client: client.id.clone(), run_id, ticket: None };
        let attached = client.send_attach(&ask)?;
        (client.ticket, client.owner_count) = (attached.ticket, attached.owner_count);
        (client.position, client.heartbeats) = (attached.position, client.connection.heartbeats());
        Ok(client)
    }

    /// Returns the position of the run.
    pub fn position(&self) -> &RunPosition {
        &self.position
    }

    /// Returns the name of this client.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Returns the connection, for read-only requests and cancellation.
    pub fn connection(&self) -> &Connection {
        &self.connection
    }

    /// Returns the description of the component.
    ///
    /// # Errors
    /// No valid reply.
    pub fn describe(&self) -> Result<ComponentDescription, Error> {
        self.connection.describe()
    }

    /// Returns the status of the component.
    ///
    /// # Errors
    /// No valid reply.
    pub fn status(&self) -> Result<StatusReport, Error> {
        self.connection.status()
    }

    /// Returns the request of the next window, to `t1_ns`, without inputs and deadline.
    pub fn next_request(&self, t1_ns: u64) -> AdvanceRequest {
        let RunPosition { run_id, seq, now_ns, .. } = &self.position;
        AdvanceRequest::of(run_id, seq + 1, [*now_ns, t1_ns])
    }

    /// Returns the request of the last window with start and end `ends`, ns, without inputs and deadline.
    pub fn redo_request(&self, ends: [u64; 2]) -> AdvanceRequest {
        AdvanceRequest::of(&self.position.run_id, self.position.seq, ends)
    }

    /// Computes the next window, to `t1_ns`.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply. Without a reply, the same call can be repeated; another call first waits for
    /// the pending reply and fails as out of sequence if the window was computed.
    pub fn advance_to(
        &mut self,
        t1_ns: u64,
        motions: Vec<BodyMotion>,
        loads: Vec<BodyLoad>,
    ) -> Result<AdvanceReply, Error> {
        let request = AdvanceRequest { motions, loads, ..self.next_request(t1_ns) };
        self.send(WindowKind::Advance, request)
    }

    /// Computes the last window again with other inputs; `ends` are its requested start and end, ns.
    ///
    /// # Errors
    /// Those of [`Client::advance_to`].
    pub fn redo(
        &mut self,
        ends: [u64; 2],
        motions: Vec<BodyMotion>,
        loads: Vec<BodyLoad>,
    ) -> Result<AdvanceReply, Error> {
        let request = AdvanceRequest { motions, loads, ..self.redo_request(ends) };
        self.send(WindowKind::Redo, request)
    }

    /// Sends the request of a window unchanged, for example with a deadline.
    ///
    /// # Errors
    /// Those of [`Client::advance_to`].
    pub fn send(
        &mut self,
        kind: WindowKind,
        request: impl Into<Arc<AdvanceRequest>>,
    ) -> Result<AdvanceReply, Error> {
        let request = request.into();
        self.ensure_in_sync()?;
        let asked = PendingRequest::Window(kind, Arc::clone(&request));
        self.resolve_other_pending(&asked)?;
        self.pending = Some(asked);
        let result =
            self.with_ownership(Effect::Continues, |client| client.deliver(kind, &request));
        let reply = result.map_err(|error| self.resolve_error(error))?;
        (self.pending, self.assumed_position) = (None, None);
        self.journal.record(request, &self.position, &reply);
        self.set_position(&reply);
        if let Some(status) = self.connection.last_status()
            && status.position.run_id == self.position.run_id
        {
            self.journal.discard_through(status.durable_seq);
        }
        Ok(reply)
    }

    /// Returns true if a request without reply may have been executed; repeating it is safe.
    pub fn has_pending(&self) -> bool {
        self.pending.is_some()
    }

    fn set_position(&mut self, reply: &AdvanceReply) {
        self.position.seq = reply.seq;
        self.position.now_ns = core_ns(reply.t1_ns);
        self.position.hash = reply.hash.to_string();
    }

    fn deliver(&self, kind: WindowKind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let verb = RequestKind::Window(kind).name();
        let timeouts = &self.connection.timeouts;
        let allowed = match request.deadline_ms {
            0 => timeouts.window,
            ms => Duration::from_millis(ms.into()) + timeouts.deadline_margin,
        };
        let bytes = to_cdr(request).map_err(|e| Error::unencodable(verb, e))?;
        let ask = OutgoingRequest {
            request: verb,
            key: self.connection.keys().control(verb),
            payload: Some((bytes, cdr::<AdvanceRequest>())),
            credentials: self.ticket.clone(),
        };
        let answer = self.connection.call(&ask, allowed)?;
        let reply: AdvanceReply = from_cdr(&answer).map_err(|e| Error::bad_reply(verb, e))?;
        if (reply.seq, &reply.run_id) == (request.seq, &request.run_id) {
            return Ok(reply);
        }
        let found = format!("window {} of run {}", reply.seq, reply.run_id);
        let what =
            format!("expected window {} of run {}, found {found}", request.seq, request.run_id);
        Err(Error::bad_reply(verb, what))
    }
}
