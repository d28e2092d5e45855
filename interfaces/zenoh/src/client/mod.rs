//! Steps a component from another process.
//!
//! Contract: a request that is not answered is asked again, and has its effect once. A client whose
//! connection was cut becomes the owner again by itself; when the component comes back from an older
//! checkpoint, the windows since then are asked for again, and their state hashes compared. Every call ends:
//! with the answer, with what the component refuses, or with *slow* or *peer lost*.

mod journal;
mod line;
mod presence;

pub use line::{Line, Patience};

use crate::server::{Description, cdr};
use crate::{Error, Link, random};
use ballast_protocol::lockstep::{
    Attach, Attached, Code, Init, Kind, Named, Place, SetParameters, StatusReport,
};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyInput, Knot, LoadInput, ns};
use ballast_protocol::pacer::FreeRunning;
use ballast_protocol::{from_cdr, to_cdr};
use journal::Journal;
use line::{Ask, read};
use serde::de::DeserializeOwned;
use std::time::Duration;
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;

/// How often a call becomes the owner again before it gives up.
const MOST_RETURNS: u32 = 5;

/// The owner of a component.
pub struct Client {
    line: Line,
    id: String,
    _token: LivelinessToken,
    ticket: String,
    place: Place,
    journal: Journal,
    /// Time was let run by itself: where it is, nobody knows beforehand.
    runs_freely: bool,
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
        // A name of its own for every connection: the token of one that is gone says so.
        let id = format!("{name}-{}", &random()?[..8]);
        let line = Line::open(component, link, patience)?;
        let token = line.come_alive(&id)?;
        let (ticket, place, journal) = Default::default();
        let mut client =
            Self { line, id, _token: token, ticket, place, journal, runs_freely: false };
        let resume = resume.map(str::to_string);
        let ask = Attach { client: client.id.clone(), resume, ticket: None };
        let attached = client.ask_to_drive(&ask)?;
        (client.ticket, client.place) = (attached.ticket, attached.place);
        Ok(client)
    }

    fn ask_to_drive(&self, ask: &Attach) -> Result<Attached, Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let bytes = self.once("attach", text, self.line.patience.control)?;
        read("attach", &bytes)
    }

    /// Becomes the owner again, of the same run, after the component or the line was away; calls do this by
    /// themselves.
    ///
    /// # Errors
    /// As for [`Client::attach`]; [`Error::Diverged`]: the run was continued by someone else, or lost more
    /// than can be computed again.
    pub fn attach_again(&mut self) -> Result<(), Error> {
        let ask = Attach {
            client: self.id.clone(),
            resume: Some(self.place.run_id.clone()),
            ticket: Some(self.ticket.clone()),
        };
        let attached = self.ask_to_drive(&ask)?;
        self.ticket = attached.ticket;
        if std::mem::take(&mut self.runs_freely) {
            self.begin_at(attached.place)?;
            return Ok(());
        }
        self.catch_up(&attached.place)
    }

    /// Brings the component to where it was left.
    fn catch_up(&self, found: &Place) -> Result<(), Error> {
        if found.seq == self.place.seq && found.hash == self.place.hash {
            return Ok(());
        }
        // The window was computed, its answer lost: it will be asked for again.
        if found.seq == self.place.seq + 1 {
            return Ok(());
        }
        let Some(windows) = self.journal.after(found) else {
            return Err(self.diverged(found));
        };
        let mut hash = found.hash.clone();
        for request in windows {
            // What took too long at first must not end elsewhere now.
            let request = AdvanceRequest { deadline_ms: 0, ..request };
            hash = self.deliver(Kind::Advance, &request)?.hash.to_string();
        }
        if hash == self.place.hash {
            return Ok(());
        }
        Err(self.diverged(&Place { seq: self.place.seq, hash, ..found.clone() }))
    }

    fn diverged(&self, found: &Place) -> Error {
        let text = |p: &Place| format!("window {} at {} ns, state {}", p.seq, p.now_ns, p.hash);
        Error::Diverged {
            component: self.line.keys().name().into(),
            run_id: self.place.run_id.clone(),
            expected: text(&self.place),
            found: text(found),
        }
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
        AdvanceRequest {
            run_id: self.place.run_id.clone(),
            seq: self.place.seq + 1,
            t0_ns: ns(self.place.now_ns),
            t1_ns: ns(t1_ns),
            ..AdvanceRequest::default()
        }
    }

    /// The request of the last window, whose ends are given, again.
    pub fn again(&self, [t0_ns, t1_ns]: [u64; 2]) -> AdvanceRequest {
        AdvanceRequest { seq: self.place.seq, t0_ns: ns(t0_ns), ..self.next(t1_ns) }
    }

    /// Computes the next window, to `t1_ns`.
    ///
    /// # Errors
    /// What the component refuses; [`Error::Slow`], [`Error::PeerLost`]: the same call may be made again.
    pub fn advance_to(
        &mut self,
        t1_ns: u64,
        motions: Vec<BodyInput>,
        loads: Vec<LoadInput>,
    ) -> Result<AdvanceReply, Error> {
        let request = AdvanceRequest { motions, loads, ..self.next(t1_ns) };
        self.send(Kind::Advance, &request)
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
        self.send(Kind::Redo, &request)
    }

    /// Sends a window's request as it is; for those who number their windows themselves, or set deadlines.
    ///
    /// # Errors
    /// As for [`Client::advance_to`].
    pub fn send(&mut self, kind: Kind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let reply = self.returning(|client| client.deliver(kind, request))?;
        self.journal.take(request, &self.place, &reply);
        self.go_to(&reply);
        if let Some(status) = self.line.last_status()
            && status.place.run_id == self.place.run_id
        {
            self.journal.keep_after(status.durable_seq);
        }
        Ok(reply)
    }

    fn go_to(&mut self, reply: &AdvanceReply) {
        self.place.seq = reply.seq;
        self.place.now_ns = u64::try_from(reply.t1_ns).unwrap_or(0);
        self.place.hash = reply.hash.to_string();
    }

    fn deliver(&self, kind: Kind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let verb = match kind {
            Kind::Advance => "advance",
            Kind::Redo => "redo",
        };
        let patience = &self.line.patience;
        let allowed = match request.deadline_ms {
            0 => patience.window,
            ms => Duration::from_millis(ms.into()) + patience.margin,
        };
        let ask = Ask {
            request: verb,
            key: self.line.keys().control(verb),
            payload: Some((to_cdr(request)?, cdr::<AdvanceRequest>())),
            pass: self.ticket.clone(),
        };
        let reply: AdvanceReply = from_cdr(&self.line.call(&ask, allowed)?)?;
        if (reply.seq, &reply.run_id) == (request.seq, &request.run_id) {
            return Ok(reply);
        }
        let found = format!("window {} of run {}", reply.seq, reply.run_id);
        let what =
            format!("expected window {} of run {}, found {found}", request.seq, request.run_id);
        Err(Error::Answer { request: verb.into(), what })
    }

    /// Does what only the owner can, becoming it again if the component has lost sight of this client.
    fn returning<T>(&mut self, mut act: impl FnMut(&Self) -> Result<T, Error>) -> Result<T, Error> {
        let mut returns = 0;
        loop {
            let error = match act(self) {
                Ok(done) => return Ok(done),
                Err(error) => error,
            };
            let is_lost = error.fault().is_some_and(|f| f.code == Code::NotOwner);
            if !is_lost || returns == MOST_RETURNS {
                return Err(error);
            }
            returns += 1;
            match self.attach_again() {
                // Lost again in the middle of it: once more.
                Err(Error::Refused(f)) if f.code == Code::NotOwner => {}
                result => result?,
            }
        }
    }

    /// Keeps the state under a name, over there; it is lost when the component ends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn save(&mut self, name: &str) -> Result<&Place, Error> {
        self.named("save", name)
    }

    /// Goes back to a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn restore(&mut self, name: &str) -> Result<&Place, Error> {
        self.named("restore", name)
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn drop_state(&mut self, name: &str) -> Result<&Place, Error> {
        self.named("drop", name)
    }

    /// Starts a run of its own from the beginning.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn reset(&mut self) -> Result<&Place, Error> {
        let place = self.json("reset", b"{}".to_vec())?;
        self.begin_at(place)
    }

    /// Prepares the bed over there, with other choices than the case's where they are given, and starts a run in
    /// it. Waits as long as for a window.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn init(&mut self, ask: &Init) -> Result<&Place, Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let allowed = self.line.patience.window;
        let bytes = self.returning(|client| client.once("init", text.clone(), allowed))?;
        self.begin_at(read("init", &bytes)?)
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn set_parameters(&mut self, ask: &SetParameters) -> Result<&Place, Error> {
        let place = self.json("param", serde_json::to_vec(ask).unwrap_or_default())?;
        self.begin_at(place)
    }

    /// Lets time run by itself from now on; bodies then follow what [`Client::put_motion`] sends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn run_freely(&mut self, ask: &FreeRunning) -> Result<&Place, Error> {
        self.runs_freely = true;
        let free_running = Some(Some(ask.clone()));
        self.set_parameters(&SetParameters { free_running, ..SetParameters::default() })
    }

    /// Time runs by itself no more: where it has come to.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn stop_running(&mut self) -> Result<&Place, Error> {
        let ask = SetParameters { free_running: Some(None), ..SetParameters::default() };
        self.set_parameters(&ask)?;
        self.runs_freely = false;
        Ok(&self.place)
    }

    /// Sends a sample of a body's motion, for time that runs by itself; its time is of a clock of the caller's own.
    /// It is not answered.
    ///
    /// # Errors
    /// The session breaks down.
    pub fn put_motion(&self, body: &str, sample: &Knot) -> Result<(), Error> {
        self.line.put(self.line.keys().input(body), to_cdr(sample)?, cdr::<Knot>(), &self.ticket)
    }

    /// Goes on at a place that the windows so far do not lead to.
    fn begin_at(&mut self, place: Place) -> Result<&Place, Error> {
        self.place = place;
        self.journal.clear();
        Ok(&self.place)
    }

    /// Leaves; the run stays where it is.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn detach(mut self) -> Result<Place, Error> {
        self.json("detach", b"{}".to_vec())
    }

    /// Ends the component.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn shut_down(mut self) -> Result<Place, Error> {
        self.json("shutdown", b"{}".to_vec())
    }

    fn named(&mut self, verb: &str, name: &str) -> Result<&Place, Error> {
        let text = serde_json::to_vec(&Named { name: name.into() }).unwrap_or_default();
        self.place = self.json(verb, text)?;
        if verb == "restore" {
            // The windows before it do not lead here.
            self.journal.clear();
        }
        Ok(&self.place)
    }

    fn json<T: DeserializeOwned>(&mut self, verb: &str, text: Vec<u8>) -> Result<T, Error> {
        let allowed = self.line.patience.control;
        let bytes = self.returning(|client| client.once(verb, text.clone(), allowed))?;
        read(verb, &bytes)
    }

    /// A request with a number of its own.
    fn once(&self, verb: &str, text: Vec<u8>, allowed: Duration) -> Result<Vec<u8>, Error> {
        let ask = Ask {
            request: verb,
            key: self.line.keys().control(verb),
            payload: Some((text, Encoding::APPLICATION_JSON)),
            pass: format!("{};{}", self.ticket, random()?),
        };
        self.line.call(&ask, allowed)
    }
}
