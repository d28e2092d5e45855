//! Steps a component from another process.
//!
//! Contract: a request that is not answered is asked again, and has its effect once. A client whose
//! connection was cut becomes the owner again by itself; when the component comes back from an older
//! checkpoint, the windows since then are asked for again, and their state hashes compared. One that finds the run
//! elsewhere than it left it goes on only from a kept state or from the beginning. Every call ends: with the answer, with
//! what the component refuses, with *diverged*, or with *slow* or *peer lost*; in time, where the wire takes what is sent.

mod connection;
mod control;
mod journal;
mod liveness;
mod pending;
mod recovery;

pub use connection::{Connection, Timeouts};

use crate::wire::cdr;
use crate::{Error, SessionConfig, random};
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
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use zenoh::liveliness::LivelinessToken;

/// The owner of a component.
pub struct Client {
    connection: Connection,
    id: String,
    _token: LivelinessToken,
    ticket: String,
    /// How many had driven when this client became the owner.
    owner_count: u64,
    position: RunPosition,
    journal: Journal,
    /// Time was let run by itself: where it is, nobody knows beforehand.
    is_real_time: bool,
    /// How many times the component had told what it does when this client last became its owner.
    heartbeats: u64,
    /// The component may have lost sight of this client, or is not where it was left: to be snapshot to first.
    must_reattach: bool,
    /// What was asked, and not answered yet.
    pending: Option<PendingRequest>,
    /// Where the component was found, as if what is pending had been done.
    assumed_position: Option<RunPosition>,
    /// Where the run is, in words, after it has gone on without this client, or may have.
    diverged_at: Option<String>,
    /// The number and the text of a request to drive that was not answered: it may have had its effect.
    pending_attach: Option<(String, Vec<u8>)>,
}

impl Client {
    /// Connects to the component `site/id` and becomes its owner. `name` is what others are told; letters,
    /// digits, `-`, `_`, `.`. With `run_id`, only if it has this run.
    ///
    /// # Errors
    /// A name or a link that cannot be used; nobody there; someone else drives; another run.
    pub fn attach(
        component: &str,
        link: &SessionConfig,
        name: &str,
        run_id: Option<&str>,
        timeouts: Timeouts,
    ) -> Result<Self, Error> {
        Self::attach_cancellable(component, link, name, run_id, timeouts, Arc::default())
    }

    /// The same; this and every later call ends within a moment once `cancelled` is set ([`Connection::cancelled`]).
    ///
    /// # Errors
    /// As for [`Client::attach`]; [`Error::Cancelled`].
    pub fn attach_cancellable(
        component: &str,
        link: &SessionConfig,
        name: &str,
        run_id: Option<&str>,
        timeouts: Timeouts,
        cancelled: Arc<AtomicBool>,
    ) -> Result<Self, Error> {
        // A name of its own for every connection: the token of one that is gone says so.
        let id = format!("{name}-{}", &random()?[..8]);
        let connection = Connection::open_cancellable(component, link, timeouts, cancelled)?;
        let token = connection.declare_client(&id)?;
        let (ticket, owner_count, position, journal) = Default::default();
        let (is_real_time, heartbeats, must_reattach) = (false, 0, false);
        let (pending, assumed_position, diverged_at, pending_attach) = (None, None, None, None);
        let mut client = Self {
            connection,
            id,
            _token: token,
            ticket,
            owner_count,
            position,
            journal,
            is_real_time,
            heartbeats,
            must_reattach,
            pending,
            assumed_position,
            diverged_at,
            pending_attach,
        };
        let run_id = run_id.map(str::to_string);
        let ask = AttachRequest { client: client.id.clone(), run_id, ticket: None };
        let attached = client.send_attach(&ask)?;
        (client.ticket, client.owner_count) = (attached.ticket, attached.owner_count);
        (client.position, client.heartbeats) = (attached.position, client.connection.heartbeats());
        Ok(client)
    }

    /// Where the run stands.
    pub fn position(&self) -> &RunPosition {
        &self.position
    }

    /// The name under which this client drives.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The line, for looking, and for giving up.
    pub fn connection(&self) -> &Connection {
        &self.connection
    }

    /// What the component says of itself.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn describe(&self) -> Result<ComponentDescription, Error> {
        self.connection.describe()
    }

    /// What the component is doing.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn status(&self) -> Result<StatusReport, Error> {
        self.connection.status()
    }

    /// The request of the next window, to `t1_ns`: without inputs, without a deadline.
    pub fn next(&self, t1_ns: u64) -> AdvanceRequest {
        let RunPosition { run_id, seq, now_ns, .. } = &self.position;
        AdvanceRequest::of(run_id, seq + 1, [*now_ns, t1_ns])
    }

    /// The request of the last window, whose ends are given, again.
    pub fn again(&self, ends: [u64; 2]) -> AdvanceRequest {
        AdvanceRequest::of(&self.position.run_id, self.position.seq, ends)
    }

    /// Computes the next window, to `t1_ns`.
    ///
    /// # Errors
    /// What the component refuses; [`Error::Timeout`], [`Error::Disconnected`]: the same call may be made again. Another one
    /// waits for the answer to this first, and is refused as out of sequence where the window has been computed:
    /// [`Client::position`] tells where the run is then.
    pub fn advance_to(
        &mut self,
        t1_ns: u64,
        motions: Vec<BodyMotion>,
        loads: Vec<BodyLoad>,
    ) -> Result<AdvanceReply, Error> {
        let request = AdvanceRequest { motions, loads, ..self.next(t1_ns) };
        self.send(WindowKind::Advance, request)
    }

    /// Computes the last window again with other inputs; `ends` are those it was asked to have.
    ///
    /// # Errors
    /// As for [`Client::advance_to`].
    pub fn redo(
        &mut self,
        ends: [u64; 2],
        motions: Vec<BodyMotion>,
        loads: Vec<BodyLoad>,
    ) -> Result<AdvanceReply, Error> {
        let request = AdvanceRequest { motions, loads, ..self.again(ends) };
        self.send(WindowKind::Redo, request)
    }

    /// Sends a window's request as it is; for those who number their windows themselves, or set deadlines.
    ///
    /// # Errors
    /// As for [`Client::advance_to`].
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

    /// Whether a request may have had its effect although its answer is lost: the same one again is safe.
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
