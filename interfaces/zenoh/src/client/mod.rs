//! Steps a component from another process.
//!
//! Contract: a request that is not answered is asked again, and has its effect once. A client whose
//! connection was cut becomes the owner again by itself; when the component comes back from an older
//! checkpoint, the windows since then are asked for again, and their state hashes compared. One that finds the run
//! elsewhere than it left it goes on only from a kept state or from the beginning. Every call ends: with the answer, with
//! what the component refuses, with *diverged*, or with *slow* or *peer lost*; in time, where the wire takes what is sent.

mod control;
mod journal;
mod line;
mod presence;
mod unanswered;

pub use line::{Connection, Timeouts};

use crate::wire::cdr;
use crate::{Error, SessionConfig, random};
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{
    AttachRequest, RequestKind, RunPosition, StatusReport, WindowKind,
};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyLoad, BodyMotion, core_ns};
use ballast_protocol::{from_cdr, to_cdr};
use journal::Journal;
use line::Ask;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use unanswered::{Leads, Unanswered};
use zenoh::liveliness::LivelinessToken;

/// The owner of a component.
pub struct Client {
    line: Connection,
    id: String,
    _token: LivelinessToken,
    ticket: String,
    /// How many had driven when this client became the owner.
    owners: u64,
    position: RunPosition,
    journal: Journal,
    /// Time was let run by itself: where it is, nobody knows beforehand.
    is_real_time: bool,
    /// How many times the component had told what it does when this client last became its owner.
    beats: u64,
    /// The component may have lost sight of this client, or is not where it was left: to be seen to first.
    is_behind: bool,
    /// What was asked, and not answered yet.
    unanswered: Option<Unanswered>,
    /// Where the component was found, as if what is unanswered had been done.
    guess: Option<RunPosition>,
    /// Where the run is, in words, after it has gone on without this client, or may have.
    apart: Option<String>,
    /// The number and the text of a request to drive that was not answered: it may have had its effect.
    knock: Option<(String, Vec<u8>)>,
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
        let line = Connection::open_cancellable(component, link, timeouts, cancelled)?;
        let token = line.come_alive(&id)?;
        let (ticket, owners, position, journal) = Default::default();
        let (is_real_time, beats, is_behind) = (false, 0, false);
        let (unanswered, guess, apart, knock) = (None, None, None, None);
        let mut client = Self {
            line,
            id,
            _token: token,
            ticket,
            owners,
            position,
            journal,
            is_real_time,
            beats,
            is_behind,
            unanswered,
            guess,
            apart,
            knock,
        };
        let run_id = run_id.map(str::to_string);
        let ask = AttachRequest { client: client.id.clone(), run_id, ticket: None };
        let attached = client.ask_to_drive(&ask)?;
        (client.ticket, client.owners) = (attached.ticket, attached.owner_count);
        (client.position, client.beats) = (attached.position, client.line.beats());
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
        &self.line
    }

    /// What the component says of itself.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn describe(&self) -> Result<ComponentDescription, Error> {
        self.line.describe()
    }

    /// What the component is doing.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn status(&self) -> Result<StatusReport, Error> {
        self.line.status()
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
        self.check_together()?;
        let asked = Unanswered::Window(kind, Arc::clone(&request));
        self.settle_other(&asked)?;
        self.unanswered = Some(asked);
        let result = self.returning(Leads::On, |client| client.deliver(kind, &request));
        let reply = result.map_err(|error| self.without(error))?;
        (self.unanswered, self.guess) = (None, None);
        self.journal.take(request, &self.position, &reply);
        self.go_to(&reply);
        if let Some(status) = self.line.last_status()
            && status.position.run_id == self.position.run_id
        {
            self.journal.keep_after(status.durable_seq);
        }
        Ok(reply)
    }

    /// Whether a request may have had its effect although its answer is lost: the same one again is safe.
    pub fn is_waiting(&self) -> bool {
        self.unanswered.is_some()
    }

    fn go_to(&mut self, reply: &AdvanceReply) {
        self.position.seq = reply.seq;
        self.position.now_ns = core_ns(reply.t1_ns);
        self.position.hash = reply.hash.to_string();
    }

    fn deliver(&self, kind: WindowKind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let verb = RequestKind::Window(kind).word();
        let timeouts = &self.line.timeouts;
        let allowed = match request.deadline_ms {
            0 => timeouts.window,
            ms => Duration::from_millis(ms.into()) + timeouts.deadline_margin,
        };
        let bytes = to_cdr(request).map_err(|e| Error::unwritten(verb, e))?;
        let ask = Ask {
            request: verb,
            key: self.line.keys().control(verb),
            payload: Some((bytes, cdr::<AdvanceRequest>())),
            pass: self.ticket.clone(),
        };
        let answer = self.line.call(&ask, allowed)?;
        let reply: AdvanceReply = from_cdr(&answer).map_err(|e| Error::answer(verb, e))?;
        if (reply.seq, &reply.run_id) == (request.seq, &request.run_id) {
            return Ok(reply);
        }
        let found = format!("window {} of run {}", reply.seq, reply.run_id);
        let what =
            format!("expected window {} of run {}, found {found}", request.seq, request.run_id);
        Err(Error::answer(verb, what))
    }
}
