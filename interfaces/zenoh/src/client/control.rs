//! Requests that are no windows.

use super::Client;
use super::line::{Ask, read};
use super::unanswered::{Leads, Unanswered};
use crate::wire::cdr;
use crate::{Error, random};
use ballast_protocol::lockstep::{
    AttachReply, AttachRequest, InitRequest, ParameterUpdate, RequestKind, RunPosition, StateName,
};
use ballast_protocol::messages::MotionKnot;
use ballast_protocol::pacer::RealTimeMode;
use ballast_protocol::schema::EmptyRequest;
use ballast_protocol::to_cdr;
use serde::Serialize;
use serde::de::DeserializeOwned;
use zenoh::bytes::Encoding;

impl Client {
    /// Asks to become the owner, with the number of the same request before where that was not answered: it may have
    /// made this client the owner, under a ticket that only its answer tells.
    pub(super) fn ask_to_drive(&mut self, ask: &AttachRequest) -> Result<AttachReply, Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let pass = match self.knock.take() {
            Some((pass, before)) if before == text => pass,
            _ => self.pass()?,
        };
        let attached = self.once(RequestKind::Attach, text.clone(), pass.clone());
        if attached.as_ref().is_err_and(|error| error.request_error().is_none()) {
            self.knock = Some((pass, text));
        }
        attached
    }

    /// Keeps the state under a name, over there; it is lost when the component ends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn save(&mut self, name: &str) -> Result<&RunPosition, Error> {
        self.check_together()?;
        self.settle()?;
        self.position = self.ask(RequestKind::Save, Leads::On, &named(name))?;
        Ok(&self.position)
    }

    /// Goes back to a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer: then the run may be there or not, and every call that would go on from
    /// where it was is *diverged*, until this one, [`Client::reset`] or [`Client::init`] is answered.
    pub fn restore(&mut self, name: &str) -> Result<&RunPosition, Error> {
        self.lead(RequestKind::Restore, Leads::Back, &named(name))
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn drop_state(&mut self, name: &str) -> Result<&RunPosition, Error> {
        // Whatever the run is at, it is no other for it.
        self.ask(RequestKind::Drop, Leads::On, &named(name))?;
        Ok(&self.position)
    }

    /// Starts a run of its own from the beginning.
    ///
    /// # Errors
    /// What the component refuses; no answer, with which it is as after [`Client::restore`].
    pub fn reset(&mut self) -> Result<&RunPosition, Error> {
        self.lead(RequestKind::Reset, Leads::Anew, &EmptyRequest {})
    }

    /// Prepares the bed over there, with other choices than the case's where they are given, and starts a run in
    /// it. Waits as long as for a window.
    ///
    /// # Errors
    /// What the component refuses; no answer, with which it is as after [`Client::restore`].
    pub fn init(&mut self, ask: &InitRequest) -> Result<&RunPosition, Error> {
        self.lead(RequestKind::Init, Leads::Anew, ask)
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn set_parameters(&mut self, ask: &ParameterUpdate) -> Result<&RunPosition, Error> {
        self.check_together()?;
        let asked = Unanswered::SolverParameters(ask.clone());
        self.settle_other(&asked)?;
        // Without content it would be a question.
        if *ask == ParameterUpdate::default() {
            return Ok(&self.position);
        }
        self.unanswered = Some(asked);
        let position =
            self.ask(RequestKind::Param, Leads::On, ask).map_err(|error| self.without(error))?;
        if let Some(run) = &ask.real_time {
            self.is_real_time = run.is_some();
        }
        Ok(self.begin_at(position))
    }

    /// Lets time run by itself from now on; bodies then follow what [`Client::put_motion`] sends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn start_real_time(&mut self, ask: &RealTimeMode) -> Result<&RunPosition, Error> {
        self.check_together()?;
        self.settle()?;
        // Time may run although the answer is lost.
        self.is_real_time = true;
        let real_time = Some(Some(ask.clone()));
        let ask = ParameterUpdate { real_time, ..ParameterUpdate::default() };
        if let Err(error) = self.set_parameters(&ask) {
            self.is_real_time = error.request_error().is_none() && self.apart.is_none();
            return Err(error);
        }
        Ok(&self.position)
    }

    /// Time runs by itself no more: where it has come to.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn stop_real_time(&mut self) -> Result<&RunPosition, Error> {
        let ask = ParameterUpdate { real_time: Some(None), ..ParameterUpdate::default() };
        self.set_parameters(&ask)
    }

    /// Sends a sample of a body's motion, for time that runs by itself; its time is of a clock of the caller's own.
    /// It is not answered: whether anybody heeds it is known by what the component tells of itself twice a second.
    ///
    /// # Errors
    /// The session breaks down; the component is not there, or has told that this client does not drive any more.
    pub fn put_motion(&self, body: &str, sample: &MotionKnot) -> Result<(), Error> {
        let bytes = to_cdr(sample).map_err(|e| Error::unwritten("motion", e))?;
        self.line.put(self.line.keys().input(body), bytes, cdr::<MotionKnot>(), &self.ticket)?;
        self.line.expect_heed("motion", &self.id, &self.ticket, self.beats)
    }

    /// Leaves; the run stays where it is.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn detach(mut self) -> Result<RunPosition, Error> {
        self.ask(RequestKind::Detach, Leads::On, &EmptyRequest {})
    }

    /// Ends the component.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn shut_down(mut self) -> Result<RunPosition, Error> {
        self.ask(RequestKind::Shutdown, Leads::On, &EmptyRequest {})
    }

    /// Asks for what leads elsewhere than the windows so far.
    fn lead(
        &mut self,
        verb: RequestKind,
        leads: Leads,
        what: &impl Serialize,
    ) -> Result<&RunPosition, Error> {
        match self.ask(verb, leads, what) {
            Ok(position) => Ok(self.begin_anew(position)),
            Err(error) => {
                if error.request_error().is_none() {
                    self.may_be_elsewhere(verb);
                }
                Err(error)
            }
        }
    }

    /// Asks for what leads to a position.
    fn ask(
        &mut self,
        verb: RequestKind,
        leads: Leads,
        what: &impl Serialize,
    ) -> Result<RunPosition, Error> {
        let text = serde_json::to_vec(what).unwrap_or_default();
        self.returning(leads, |client| client.once(verb, text.clone(), client.pass()?))
    }

    /// The ticket, and a number of the request's own.
    fn pass(&self) -> Result<String, Error> {
        Ok(format!("{};{}", self.ticket, random()?))
    }

    /// A request with its number.
    fn once<T: DeserializeOwned>(
        &self,
        verb: RequestKind,
        text: Vec<u8>,
        pass: String,
    ) -> Result<T, Error> {
        let timeouts = &self.line.timeouts;
        // A bed is prepared in the time of a window.
        let allowed = if verb == RequestKind::Init { timeouts.window } else { timeouts.control };
        let ask = Ask {
            request: verb.word(),
            key: self.line.keys().control(verb.word()),
            payload: Some((text, Encoding::APPLICATION_JSON)),
            pass,
        };
        read(verb.word(), &self.line.call(&ask, allowed)?)
    }
}

fn named(name: &str) -> StateName {
    StateName { name: name.into() }
}
