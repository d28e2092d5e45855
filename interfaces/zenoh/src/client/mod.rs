//! Steps a component from another process.
//!
//! Contract: a request that is not answered is asked again, and has its effect once. A client whose
//! connection was cut becomes the owner again by itself; when the component comes back from an older
//! checkpoint, the windows since then are asked for again, and their state hashes compared. One that finds the run
//! elsewhere than it left it goes on only from a kept state or from the beginning. Every call ends: with the answer, with
//! what the component refuses, with *diverged*, or with *slow* or *peer lost*.

mod journal;
mod line;
mod presence;

pub use line::{Line, Patience};

use crate::wire::cdr;
use crate::{Error, Link, random};
use ballast_protocol::description::Description;
use ballast_protocol::lockstep::{
    Attach, Attached, Code, Init, Named, Place, SetParameters, StatusReport, WindowKind,
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
    /// The component may have lost sight of this client, or is not where it was left: to be seen to first.
    is_behind: bool,
    /// What was asked, and not answered yet.
    unanswered: Option<Unanswered>,
    /// Where the component was found, as if what is unanswered had been done.
    guess: Option<Place>,
    /// Where the run was found after it had gone on without this client.
    apart: Option<Place>,
}

/// A request that may have had its effect although its answer is lost.
#[derive(Clone, PartialEq)]
enum Unanswered {
    Window(WindowKind, AdvanceRequest),
    Parameters(SetParameters),
}

/// Where a request leads.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Leads {
    /// On from where the run was left.
    On,
    /// To a kept state, wherever the run is now.
    Back,
    /// To a run of its own.
    Anew,
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
        let (runs_freely, is_behind) = (false, false);
        let (unanswered, guess, apart) = (None, None, None);
        let mut client = Self {
            line,
            id,
            _token: token,
            ticket,
            place,
            journal,
            runs_freely,
            is_behind,
            unanswered,
            guess,
            apart,
        };
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

    /// Becomes the owner again after the component or the line was away, and brings the component to where it was left.
    fn come_back(&mut self, leads: Leads) -> Result<(), Error> {
        let ask = Attach {
            client: self.id.clone(),
            resume: (leads != Leads::Anew).then(|| self.place.run_id.clone()),
            ticket: Some(self.ticket.clone()),
        };
        let attached = self.ask_to_drive(&ask)?;
        self.ticket = attached.ticket;
        if std::mem::take(&mut self.runs_freely) {
            self.begin_at(attached.place);
        } else if leads == Leads::On {
            if self.apart.is_none() {
                self.catch_up(&attached.place)?;
            }
            self.is_behind = false;
        }
        // Otherwise it is, until the request has led elsewhere.
        Ok(())
    }

    fn catch_up(&mut self, found: &Place) -> Result<(), Error> {
        if (found.seq, &found.hash) == (self.place.seq, &self.place.hash) {
            return Ok(());
        }
        // It was done, its answer lost: it will be asked for again.
        let is_done = match &self.unanswered {
            Some(Unanswered::Window(_, request)) => found.seq == request.seq,
            Some(Unanswered::Parameters(_)) => found.seq == self.place.seq,
            None => false,
        };
        if is_done {
            self.guess = Some(found.clone());
            return Ok(());
        }
        let Some(windows) = self.journal.after(found) else {
            return Err(self.part(found.clone()));
        };
        let mut hash = found.hash.clone();
        for request in windows {
            // What took too long at first must not end elsewhere now.
            let request = AdvanceRequest { deadline_ms: 0, ..request };
            hash = self.deliver(WindowKind::Advance, &request)?.hash.to_string();
        }
        if hash == self.place.hash {
            return Ok(());
        }
        Err(self.part(Place { seq: self.place.seq, hash, ..found.clone() }))
    }

    /// The run has gone on to `found` without this client, which has nothing to go on from any more.
    fn part(&mut self, found: Place) -> Error {
        let error = self.diverged(&found);
        (self.apart, self.is_behind) = (Some(found), false);
        (self.unanswered, self.guess) = (None, None);
        error
    }

    fn check_together(&self) -> Result<(), Error> {
        self.apart.as_ref().map_or(Ok(()), |found| Err(self.diverged(found)))
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
        self.send(WindowKind::Advance, &request)
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
        self.send(WindowKind::Redo, &request)
    }

    /// Sends a window's request as it is; for those who number their windows themselves, or set deadlines.
    ///
    /// # Errors
    /// As for [`Client::advance_to`].
    pub fn send(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
    ) -> Result<AdvanceReply, Error> {
        self.check_together()?;
        let asked = Unanswered::Window(kind, request.clone());
        if matches!(self.unanswered, Some(Unanswered::Parameters(_))) {
            self.settle()?;
        }
        self.unanswered = Some(asked);
        let result = self.returning(Leads::On, |client| client.deliver(kind, request));
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

    /// Asks again for what was not answered, for a request that comes after it.
    fn settle(&mut self) -> Result<(), Error> {
        let settled = match self.unanswered.clone() {
            None => return Ok(()),
            Some(Unanswered::Window(kind, request)) => self.send(kind, &request).map(drop),
            Some(Unanswered::Parameters(ask)) => self.set_parameters(&ask).map(drop),
        };
        match settled {
            // It was refused: nothing has changed, and that is all that matters now.
            Err(error) if error.fault().is_some() && self.unanswered.is_none() => Ok(()),
            settled => settled,
        }
    }

    /// Whether a request may have had its effect although its answer is lost: the same one again is safe.
    pub fn is_waiting(&self) -> bool {
        self.unanswered.is_some()
    }

    /// What becomes of a request that was not answered as it should be.
    fn without(&mut self, error: Error) -> Error {
        let Some(fault) = error.fault() else { return error };
        // It was not the request that was refused.
        if self.is_behind {
            return error;
        }
        self.unanswered = None;
        match self.guess.take() {
            // What was found there was not this client's doing.
            Some(found) if fault.code == Code::OutOfSequence => self.part(found),
            _ => error,
        }
    }

    fn go_to(&mut self, reply: &AdvanceReply) {
        self.place.seq = reply.seq;
        self.place.now_ns = u64::try_from(reply.t1_ns).unwrap_or(0);
        self.place.hash = reply.hash.to_string();
    }

    fn deliver(&self, kind: WindowKind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let verb = match kind {
            WindowKind::Advance => "advance",
            WindowKind::Redo => "redo",
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
    fn returning<T>(
        &mut self,
        leads: Leads,
        mut act: impl FnMut(&Self) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let mut returns = 0;
        loop {
            let come_back = if self.is_behind { self.come_back(leads) } else { Ok(()) };
            let error = match come_back.and_then(|()| act(self)) {
                Ok(done) => return Ok(done),
                Err(error) => error,
            };
            let is_lost = error.fault().is_some_and(|f| f.code == Code::NotOwner);
            if !is_lost || returns == MOST_RETURNS {
                return Err(error);
            }
            returns += 1;
            self.is_behind = true;
        }
    }

    /// Keeps the state under a name, over there; it is lost when the component ends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn save(&mut self, name: &str) -> Result<&Place, Error> {
        self.check_together()?;
        self.settle()?;
        self.place = self.named("save", Leads::On, name)?;
        Ok(&self.place)
    }

    /// Goes back to a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn restore(&mut self, name: &str) -> Result<&Place, Error> {
        let place = self.named("restore", Leads::Back, name)?;
        // The windows before it do not lead here.
        Ok(self.begin_at(place))
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn drop_state(&mut self, name: &str) -> Result<&Place, Error> {
        // Whatever the run is at, it is no other for it.
        let _: Place = self.named("drop", Leads::On, name)?;
        Ok(&self.place)
    }

    /// Starts a run of its own from the beginning.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn reset(&mut self) -> Result<&Place, Error> {
        let place = self.json("reset", Leads::Anew, b"{}".to_vec())?;
        Ok(self.begin_at(place))
    }

    /// Prepares the bed over there, with other choices than the case's where they are given, and starts a run in
    /// it. Waits as long as for a window.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn init(&mut self, ask: &Init) -> Result<&Place, Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let allowed = self.line.patience.window;
        let bytes = self.returning(Leads::Anew, |c| c.once("init", text.clone(), allowed))?;
        Ok(self.begin_at(read("init", &bytes)?))
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn set_parameters(&mut self, ask: &SetParameters) -> Result<&Place, Error> {
        self.check_together()?;
        let asked = Unanswered::Parameters(ask.clone());
        if self.unanswered.as_ref().is_some_and(|unanswered| *unanswered != asked) {
            self.settle()?;
        }
        self.unanswered = Some(asked);
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let place = self.json("param", Leads::On, text).map_err(|error| self.without(error))?;
        Ok(self.begin_at(place))
    }

    /// Lets time run by itself from now on; bodies then follow what [`Client::put_motion`] sends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn run_freely(&mut self, ask: &FreeRunning) -> Result<&Place, Error> {
        self.check_together()?;
        self.settle()?;
        // Time may run although the answer is lost.
        self.runs_freely = true;
        let free_running = Some(Some(ask.clone()));
        let ask = SetParameters { free_running, ..SetParameters::default() };
        if let Err(error) = self.set_parameters(&ask) {
            self.runs_freely = error.fault().is_none();
            return Err(error);
        }
        Ok(&self.place)
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
    fn begin_at(&mut self, place: Place) -> &Place {
        self.place = place;
        self.journal.clear();
        (self.unanswered, self.guess, self.apart) = (None, None, None);
        self.is_behind = false;
        &self.place
    }

    /// Leaves; the run stays where it is.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn detach(mut self) -> Result<Place, Error> {
        self.json("detach", Leads::On, b"{}".to_vec())
    }

    /// Ends the component.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn shut_down(mut self) -> Result<Place, Error> {
        self.json("shutdown", Leads::On, b"{}".to_vec())
    }

    fn named<T: DeserializeOwned>(
        &mut self,
        verb: &str,
        leads: Leads,
        name: &str,
    ) -> Result<T, Error> {
        self.json(verb, leads, serde_json::to_vec(&Named { name: name.into() }).unwrap_or_default())
    }

    fn json<T: DeserializeOwned>(
        &mut self,
        verb: &str,
        leads: Leads,
        text: Vec<u8>,
    ) -> Result<T, Error> {
        let allowed = self.line.patience.control;
        let bytes = self.returning(leads, |client| client.once(verb, text.clone(), allowed))?;
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
