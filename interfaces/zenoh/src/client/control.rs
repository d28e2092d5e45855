//! Requests other than windows.

use super::Client;
use super::connection::{OutgoingRequest, decode};
use super::pending::{Effect, PendingRequest};
use crate::wire::cdr;
use crate::{Error, random};
use ballast_protocol::lockstep::{
    AttachReply, AttachRequest, InitRequest, ParameterUpdate, RequestKind, RunPosition, StateName,
};
use ballast_protocol::messages::MotionKnot;
use ballast_protocol::real_time::RealTimeMode;
use ballast_protocol::schema::EmptyRequest;
use ballast_protocol::to_cdr;
use serde::Serialize;
use serde::de::DeserializeOwned;
use zenoh::bytes::Encoding;

impl Client {
    /// Requests ownership; reuses the number of an unanswered identical request.
    ///
    /// That request may have made this client the owner, with a ticket that only its reply contains.
    pub(super) fn send_attach(&mut self, ask: &AttachRequest) -> Result<AttachReply, Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let credentials = match self.pending_attach.take() {
            Some((credentials, before)) if before == text => credentials,
            _ => self.new_credentials()?,
        };
        let attached = self.send_numbered(RequestKind::Attach, text.clone(), credentials.clone());
        if attached.as_ref().is_err_and(|error| error.request_error().is_none()) {
            self.pending_attach = Some((credentials, text));
        }
        attached
    }

    /// Saves the state under a name, until the component ends.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn save(&mut self, name: &str) -> Result<&RunPosition, Error> {
        self.ensure_in_sync()?;
        self.resolve_pending()?;
        self.position = self.ask(RequestKind::Save, Effect::Continues, &named(name))?;
        Ok(&self.position)
    }

    /// Restores a saved state.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply. Without a reply, later calls that continue the run fail with
    /// [`Error::Diverged`] until this one, [`Client::reset`] or [`Client::init`] succeeds.
    pub fn restore(&mut self, name: &str) -> Result<&RunPosition, Error> {
        self.replace_run(RequestKind::Restore, Effect::Restores, &named(name))
    }

    /// Deletes a saved state.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn drop_state(&mut self, name: &str) -> Result<&RunPosition, Error> {
        // The position of the run does not change.
        self.ask(RequestKind::Drop, Effect::Continues, &named(name))?;
        Ok(&self.position)
    }

    /// Starts a new run from the initial state.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply, see [`Client::restore`].
    pub fn reset(&mut self) -> Result<&RunPosition, Error> {
        self.replace_run(RequestKind::Reset, Effect::StartsRun, &EmptyRequest {})
    }

    /// Prepares a bed and starts a run in it, with the timeout of a window.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply, see [`Client::restore`].
    pub fn init(&mut self, ask: &InitRequest) -> Result<&RunPosition, Error> {
        self.replace_run(RequestKind::Init, Effect::StartsRun, ask)
    }

    /// Sets parameters for all later windows and for a redo of the last one.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn set_parameters(&mut self, ask: &ParameterUpdate) -> Result<&RunPosition, Error> {
        self.ensure_in_sync()?;
        let asked = PendingRequest::Parameters(ask.clone());
        self.resolve_other_pending(&asked)?;
        // A request without content would only return the parameters.
        if *ask == ParameterUpdate::default() {
            return Ok(&self.position);
        }
        self.pending = Some(asked);
        let position = self
            .ask(RequestKind::Param, Effect::Continues, ask)
            .map_err(|error| self.resolve_error(error))?;
        if let Some(run) = &ask.real_time {
            self.is_real_time = run.is_some();
        }
        Ok(self.continue_at(position))
    }

    /// Starts the real-time mode, in which bodies follow the samples of [`Client::put_motion`].
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn start_real_time(&mut self, ask: &RealTimeMode) -> Result<&RunPosition, Error> {
        self.ensure_in_sync()?;
        self.resolve_pending()?;
        // The mode may be active although the reply is lost.
        self.is_real_time = true;
        let real_time = Some(Some(ask.clone()));
        let ask = ParameterUpdate { real_time, ..ParameterUpdate::default() };
        if let Err(error) = self.set_parameters(&ask) {
            self.is_real_time = error.request_error().is_none() && self.diverged_at.is_none();
            return Err(error);
        }
        Ok(&self.position)
    }

    /// Stops the real-time mode and returns the position of the run.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn stop_real_time(&mut self) -> Result<&RunPosition, Error> {
        let ask = ParameterUpdate { real_time: Some(None), ..ParameterUpdate::default() };
        self.set_parameters(&ask)
    }

    /// Sends a motion sample of a body in real-time mode, with a time of the caller's clock.
    ///
    /// There is no reply; the heartbeat of the component shows whether this client is still the owner.
    ///
    /// # Errors
    /// The session fails, the component is disconnected, or this client is no longer the owner.
    pub fn put_motion(&self, body: &str, sample: &MotionKnot) -> Result<(), Error> {
        let bytes = to_cdr(sample).map_err(|e| Error::unencodable("motion", e))?;
        self.connection.put(
            "motion",
            self.connection.keys().input(body),
            bytes,
            cdr::<MotionKnot>(),
            &self.ticket,
        )?;
        self.connection.ensure_owner("motion", &self.id, &self.ticket, self.heartbeats)
    }

    /// Ends the ownership; the run stays at its position.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn detach(mut self) -> Result<RunPosition, Error> {
        self.ask(RequestKind::Detach, Effect::Continues, &EmptyRequest {})
    }

    /// Shuts the component down.
    ///
    /// # Errors
    /// [`Error::Rejected`], or no reply.
    pub fn shut_down(mut self) -> Result<RunPosition, Error> {
        self.ask(RequestKind::Shutdown, Effect::Continues, &EmptyRequest {})
    }

    /// Sends a request that replaces the state or the run.
    fn replace_run(
        &mut self,
        verb: RequestKind,
        effect: Effect,
        what: &impl Serialize,
    ) -> Result<&RunPosition, Error> {
        match self.ask(verb, effect, what) {
            Ok(position) => Ok(self.continue_paused_at(position)),
            Err(error) => {
                if error.request_error().is_none() {
                    self.set_possibly_diverged(verb);
                }
                Err(error)
            }
        }
    }

    /// Sends a request and returns the position of the run.
    fn ask(
        &mut self,
        verb: RequestKind,
        effect: Effect,
        what: &impl Serialize,
    ) -> Result<RunPosition, Error> {
        let text = serde_json::to_vec(what).unwrap_or_default();
        self.with_ownership(effect, |client| {
            client.send_numbered(verb, text.clone(), client.new_credentials()?)
        })
    }

    /// Returns the ticket with a new request number.
    fn new_credentials(&self) -> Result<String, Error> {
        Ok(format!("{};{}", self.ticket, random()?))
    }

    /// Sends a request with a number, which identifies its retries.
    fn send_numbered<T: DeserializeOwned>(
        &self,
        verb: RequestKind,
        text: Vec<u8>,
        credentials: String,
    ) -> Result<T, Error> {
        let timeouts = &self.connection.timeouts;
        // Preparing a bed has the timeout of a window.
        let timeout = if verb == RequestKind::Init { timeouts.window } else { timeouts.control };
        let ask = OutgoingRequest {
            request: verb.name(),
            key: self.connection.keys().control(verb.name()),
            payload: Some((text, Encoding::APPLICATION_JSON)),
            credentials,
        };
        decode(verb.name(), &self.connection.call(&ask, timeout)?)
    }
}

fn named(name: &str) -> StateName {
    StateName { name: name.into() }
}
