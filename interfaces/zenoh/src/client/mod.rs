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

pub use line::{Line, Patience};

use crate::wire::cdr;
use crate::{Error, Link, random};
use ballast_protocol::description::Description;
use ballast_protocol::lockstep::{Attach, Place, StatusReport, Verb, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyInput, LoadInput, core_ns};
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
    line: Line,
    id: String,
    _token: LivelinessToken,
    ticket: String,
    /// How many had driven when this client became the owner.
    owners: u64,
    place: Place,
    journal: Journal,
    /// Time was let run by itself: where it is, nobody knows beforehand.
    runs_freely: bool,
    /// How many times the component had told what it does when this client last became its owner.
    beats: u64,
    /// The component may have lost sight of this client, or is not where it was left: to be seen to first.
    is_behind: bool,
    /// What was asked, and not answered yet.
    unanswered: Option<Unanswered>,
    /// Where the component was found, as if what is unanswered had been done.
    guess: Option<Place>,
    /// Where the run is, in words, after it has gone on without this client, or may have.
    apart: Option<String>,
    /// The number and the text of a request to drive that was not answered: it may have had its effect.
    knock: Option<(String, Vec<u8>)>,
}

impl Client {
    /// Connects to the component `site/id` and becomes its owner. `name` is what others are told; letters,
    /// digits, `-`, `_`, `.`. With `resume`, only if it has this run.
    ///
    /// # Errors
    /// A name or a link that cannot be used; nobody there; someone else drives; another run.
    pub fn attach(
        component: &str,
        link: &Link,
        name: &str,
        resume: Option<&str>,
        patience: Patience,
    ) -> Result<Self, Error> {
        Self::attach_until(component, link, name, resume, patience, Arc::default())
    }

    /// The same; this and every later call ends within a moment once `is_given_up` is set ([`Line::is_given_up`]).
    ///
    /// # Errors
    /// As for [`Client::attach`]; [`Error::Abandoned`].
    pub fn attach_until(
        component: &str,
        link: &Link,
        name: &str,
        resume: Option<&str>,
        patience: Patience,
        is_given_up: Arc<AtomicBool>,
    ) -> Result<Self, Error> {
        // A name of its own for every connection: the token of one that is gone says so.
        let id = format!("{name}-{}", &random()?[..8]);
        let line = Line::open_until(component, link, patience, is_given_up)?;
        let token = line.come_alive(&id)?;
        let (ticket, owners, place, journal) = Default::default();
        let (runs_freely, beats, is_behind) = (false, 0, false);
        let (unanswered, guess, apart, knock) = (None, None, None, None);
        let mut client = Self {
            line,
            id,
            _token: token,
            ticket,
            owners,
            place,
            journal,
            runs_freely,
            beats,
            is_behind,
            unanswered,
            guess,
            apart,
            knock,
        };
        let resume = resume.map(str::to_string);
        let ask = Attach { client: client.id.clone(), resume, ticket: None };
        let attached = client.ask_to_drive(&ask)?;
        (client.ticket, client.owners) = (attached.ticket, attached.owners);
        (client.place, client.beats) = (attached.place, client.line.beats());
        Ok(client)
    }

    /// Where the run stands.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// The name under which this client drives.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The line, for looking, and for giving up.
    pub fn line(&self) -> &Line {
        &self.line
    }

    /// What the component says of itself.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn describe(&self) -> Result<Description, Error> {
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
        let Place { run_id, seq, now_ns, .. } = &self.place;
        AdvanceRequest::of(run_id, seq + 1, [*now_ns, t1_ns])
    }

    /// The request of the last window, whose ends are given, again.
    pub fn again(&self, ends: [u64; 2]) -> AdvanceRequest {
        AdvanceRequest::of(&self.place.run_id, self.place.seq, ends)
    }

    /// Computes the next window, to `t1_ns`.
    ///
    /// # Errors
    /// What the component refuses; [`Error::Slow`], [`Error::PeerLost`]: the same call may be made again. Another one
    /// waits for the answer to this first, and is refused as out of sequence where the window has been computed:
    /// [`Client::place`] tells where the run is then.
    pub fn advance_to(
        &mut self,
        t1_ns: u64,
        motions: Vec<BodyInput>,
        loads: Vec<LoadInput>,
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
        motions: Vec<BodyInput>,
        loads: Vec<LoadInput>,
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
        self.journal.take(request, &self.place, &reply);
        self.go_to(&reply);
        if let Some(status) = self.line.last_status()
            && status.place.run_id == self.place.run_id
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
        self.place.seq = reply.seq;
        self.place.now_ns = core_ns(reply.t1_ns);
        self.place.hash = reply.hash.to_string();
    }

    fn deliver(&self, kind: WindowKind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let verb = Verb::Window(kind).word();
        let patience = &self.line.patience;
        let allowed = match request.deadline_ms {
            0 => patience.window,
            ms => Duration::from_millis(ms.into()) + patience.margin,
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
