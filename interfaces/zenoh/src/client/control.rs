//! Requests that are no windows.

use super::Client;
use super::line::{Ask, read};
use super::unanswered::{Leads, Unanswered};
use crate::wire::cdr;
use crate::{Error, random};
use ballast_protocol::lockstep::{Attach, Attached, Init, Named, Place, SetParameters, Verb};
use ballast_protocol::messages::Knot;
use ballast_protocol::pacer::FreeRunning;
use ballast_protocol::schema::Nothing;
use ballast_protocol::to_cdr;
use serde::Serialize;
use serde::de::DeserializeOwned;
use zenoh::bytes::Encoding;

impl Client {
    /// Asks to become the owner, with the number of the same request before where that was not answered: it may have
    /// made this client the owner, under a ticket that only its answer tells.
    pub(super) fn ask_to_drive(&mut self, ask: &Attach) -> Result<Attached, Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let pass = match self.knock.take() {
            Some((pass, before)) if before == text => pass,
            _ => self.pass()?,
        };
        let attached = self.once(Verb::Attach, text.clone(), pass.clone());
        if attached.as_ref().is_err_and(|error| error.fault().is_none()) {
            self.knock = Some((pass, text));
        }
        attached
    }

    /// Keeps the state under a name, over there; it is lost when the component ends.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn save(&mut self, name: &str) -> Result<&Place, Error> {
        self.check_together()?;
        self.settle()?;
        self.place = self.ask(Verb::Save, Leads::On, &named(name))?;
        Ok(&self.place)
    }

    /// Goes back to a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer: then the run may be there or not, and every call that would go on from
    /// where it was is *diverged*, until this one, [`Client::reset`] or [`Client::init`] is answered.
    pub fn restore(&mut self, name: &str) -> Result<&Place, Error> {
        self.lead(Verb::Restore, Leads::Back, &named(name))
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn drop_state(&mut self, name: &str) -> Result<&Place, Error> {
        // Whatever the run is at, it is no other for it.
        self.ask(Verb::Drop, Leads::On, &named(name))?;
        Ok(&self.place)
    }

    /// Starts a run of its own from the beginning.
    ///
    /// # Errors
    /// What the component refuses; no answer, with which it is as after [`Client::restore`].
    pub fn reset(&mut self) -> Result<&Place, Error> {
        self.lead(Verb::Reset, Leads::Anew, &Nothing {})
    }

    /// Prepares the bed over there, with other choices than the case's where they are given, and starts a run in
    /// it. Waits as long as for a window.
    ///
    /// # Errors
    /// What the component refuses; no answer, with which it is as after [`Client::restore`].
    pub fn init(&mut self, ask: &Init) -> Result<&Place, Error> {
        self.lead(Verb::Init, Leads::Anew, ask)
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn set_parameters(&mut self, ask: &SetParameters) -> Result<&Place, Error> {
        self.check_together()?;
        let asked = Unanswered::Parameters(ask.clone());
        self.settle_other(&asked)?;
        // Without content it would be a question.
        if *ask == SetParameters::default() {
            return Ok(&self.place);
        }
        self.unanswered = Some(asked);
        let place = self.ask(Verb::Param, Leads::On, ask).map_err(|error| self.without(error))?;
        if let Some(run) = &ask.free_running {
            self.runs_freely = run.is_some();
        }
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
            self.runs_freely = error.fault().is_none() && self.apart.is_none();
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
        self.set_parameters(&ask)
    }

    /// Sends a sample of a body's motion, for time that runs by itself; its time is of a clock of the caller's own.
    /// It is not answered: whether anybody heeds it is known by what the component tells of itself twice a second.
    ///
    /// # Errors
    /// The session breaks down; the component is not there, or has told that this client does not drive any more.
    pub fn put_motion(&self, body: &str, sample: &Knot) -> Result<(), Error> {
        let bytes = to_cdr(sample).map_err(|e| Error::unwritten("motion", e))?;
        self.line.put(self.line.keys().input(body), bytes, cdr::<Knot>(), &self.ticket)?;
        self.line.expect_heed("motion", &self.id, &self.ticket, self.beats)
    }

    /// Leaves; the run stays where it is.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn detach(mut self) -> Result<Place, Error> {
        self.ask(Verb::Detach, Leads::On, &Nothing {})
    }

    /// Ends the component.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn shut_down(mut self) -> Result<Place, Error> {
        self.ask(Verb::Shutdown, Leads::On, &Nothing {})
    }

    /// Asks for what leads elsewhere than the windows so far.
    fn lead(&mut self, verb: Verb, leads: Leads, what: &impl Serialize) -> Result<&Place, Error> {
        match self.ask(verb, leads, what) {
            Ok(place) => Ok(self.begin_anew(place)),
            Err(error) => {
                if error.fault().is_none() {
                    self.may_be_elsewhere(verb);
                }
                Err(error)
            }
        }
    }

    /// Asks for what leads to a place.
    fn ask(&mut self, verb: Verb, leads: Leads, what: &impl Serialize) -> Result<Place, Error> {
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
        verb: Verb,
        text: Vec<u8>,
        pass: String,
    ) -> Result<T, Error> {
        let patience = &self.line.patience;
        // A bed is prepared in the time of a window.
        let allowed = if verb == Verb::Init { patience.window } else { patience.control };
        let ask = Ask {
            request: verb.word(),
            key: self.line.keys().control(verb.word()),
            payload: Some((text, Encoding::APPLICATION_JSON)),
            pass,
        };
        read(verb.word(), &self.line.call(&ask, allowed)?)
    }
}

fn named(name: &str) -> Named {
    Named { name: name.into() }
}
