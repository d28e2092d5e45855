//! Execution of requests, on the computing thread.

use super::reply::{self, EncodedReply};
use super::reply_cache::RequestId;
use super::request::{QueuedRequest, decode_object, new_ticket, shutting_down};
use super::{Service, find_token};
use crate::{Error, wire};
use ballast_protocol::lockstep::{
    AttachRequest, ErrorCode, InitRequest, ParameterUpdate, RequestError, RequestKind, RunPosition,
    StateName, WindowKind, WindowProgress,
};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Message, SolverParameters};
use ballast_protocol::schema::EmptyRequest;
use ballast_protocol::{from_cdr, from_json};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;
use zenoh::query::Query;

/// Timeout of the query for a client's token.
const TOKEN_TIMEOUT: Duration = Duration::from_millis(500);

/// Returns true if the payload of a query is CDR.
fn is_cdr(query: &Query) -> bool {
    query.encoding().is_some_and(wire::is_cdr)
}

fn decode_message<T: Message>(query: &Query) -> Result<T, RequestError> {
    let bytes = query.payload().map(|p| p.to_bytes()).unwrap_or_default();
    Ok(if is_cdr(query) { from_cdr(&bytes)? } else { from_json(&bytes)? })
}

impl Service<'_> {
    /// Executes a request and replies to it.
    pub fn handle(&mut self, request: QueuedRequest) -> Result<(), Error> {
        let QueuedRequest { query, kind: verb, credentials, slot: _slot } = request;
        let key = self.keys.control(verb.name());
        if let RequestKind::Window(kind) = verb {
            self.window(kind, &query, key, &credentials.ticket);
        } else {
            let numbered = RequestId::of(verb, &credentials, &query);
            let result = self.replies.find(numbered.as_ref()).unwrap_or_else(|| {
                let result = self.control(verb, &query, &credentials.ticket);
                self.replies.insert(numbered, &result);
                result
            });
            if matches!(verb, RequestKind::Detach | RequestKind::Shutdown) {
                self.shared.set_leaving(None);
            }
            // Published before the reply: a client may send another request at once.
            self.publish_status();
            if matches!(verb, RequestKind::Reset | RequestKind::Init) && result.is_ok() {
                self.declare_alive()?;
            }
            reply::send(&query, key, result);
        }
        Ok(())
    }

    /// Refuses a queued request while the component shuts down.
    pub fn refuse(&self, request: &QueuedRequest) {
        reply::send(&request.query, self.keys.control(request.kind.name()), Err(shutting_down()));
    }

    fn window(&mut self, kind: WindowKind, query: &Query, key: String, ticket: &str) {
        let request = match decode_message::<AdvanceRequest>(query) {
            Ok(request) => request,
            Err(fault) => return reply::send(query, key, Err(fault)),
        };
        let before = self.lockstep.computed_windows();
        let was_durable = self.lockstep.durable_seq() == request.seq;
        let result = match self.check_not_real_time() {
            Ok(()) => self.compute(kind, &request, ticket),
            Err(fault) => Err(fault),
        };
        let answered = result
            .as_ref()
            .map_err(Clone::clone)
            .and_then(|reply| EncodedReply::message::<AdvanceReply>(reply, is_cdr(query)));
        // A redo replaces the window of a checkpoint: a new one is written before the reply.
        if kind == WindowKind::Redo && was_durable {
            self.publish(kind, &request, &result, before);
            return reply::send(query, key, answered);
        }
        reply::send(query, key, answered);
        self.publish(kind, &request, &result, before);
    }

    /// Computes a window and publishes its progress.
    pub(super) fn compute(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        ticket: &str,
    ) -> Result<AdvanceReply, RequestError> {
        let shared = Arc::clone(&self.shared);
        let clock = &move || shared.now_ns();
        let (shared, hooks) = (Arc::clone(&self.shared), &mut *self.hooks);
        // Also called by worker threads, with the hooks, while the window is computed.
        let mut poll = move |progress: &WindowProgress| {
            shared.set_progress(progress);
            if hooks.is_stopped() || shared.is_owner_lost() || shared.is_owner_leaving() {
                return ControlFlow::Break(());
            }
            ControlFlow::Continue(())
        };
        // Before the first step, which may take long: a client that sees an idle component repeats its request.
        let steps = self.lockstep.steps(request);
        self.shared.set_progress(&WindowProgress {
            seq: request.seq,
            steps,
            ..WindowProgress::default()
        });
        let result = self.lockstep.window(kind, request, ticket, clock, &mut poll);
        self.publish_status();
        result.map_err(|fault| match fault.code {
            ErrorCode::Cancelled if self.hooks.is_stopped() => shutting_down(),
            ErrorCode::Cancelled if self.shared.is_owner_leaving() => {
                RequestError::new(ErrorCode::NotOwner, "window rolled back: its owner detached")
            }
            // The ticket is invalid from now on.
            ErrorCode::Cancelled => {
                RequestError::new(ErrorCode::NotOwner, "window rolled back: its owner disconnected")
            }
            _ => fault,
        })
    }

    /// Publishes a window unless its reply was a stored one; `before` windows had been computed.
    pub(super) fn publish(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        result: &Result<AdvanceReply, RequestError>,
        before: u64,
    ) {
        if let Ok(reply) = result
            && self.lockstep.computed_windows() != before
        {
            self.publishers.publish_window(kind, reply);
            self.update_viewer(reply.status.is_kept().then_some(reply));
            if self.hooks.window_computed(&self.lockstep, kind, request, reply) {
                self.lockstep.note_durable();
                self.publish_status();
            }
        }
    }

    fn control(
        &mut self,
        verb: RequestKind,
        query: &Query,
        ticket: &str,
    ) -> Result<EncodedReply, RequestError> {
        let now = self.shared.now_ms();
        if matches!(verb, RequestKind::Init | RequestKind::Reset | RequestKind::Restore) {
            self.check_not_real_time()?;
        }
        let place = match verb {
            RequestKind::Attach => return self.attach(query, now),
            RequestKind::Init => self.init(&decode_object(query)?, ticket)?,
            RequestKind::Param => self.set_parameters(&decode_object(query)?, ticket)?,
            RequestKind::Reset => {
                decode_object::<EmptyRequest>(query)?;
                let place = self.lockstep.reset(new_ticket()?, ticket, now)?;
                self.state_replaced(&format!("reset, run {}", place.run_id));
                place
            }
            RequestKind::Save => self.lockstep.save(&decode_object::<StateName>(query)?, ticket)?,
            RequestKind::Restore => {
                let name: StateName = decode_object(query)?;
                let place = self.lockstep.restore(&name, ticket)?;
                self.state_replaced(&format!("restored {:?}, {} ns", name.name, place.now_ns));
                place
            }
            RequestKind::Drop => {
                self.lockstep.drop_state(&decode_object::<StateName>(query)?, ticket)?
            }
            RequestKind::Detach => {
                let place = self.lockstep.detach(ticket)?;
                self.stop_real_time("the owner detached");
                self.log("the owner detached; the run is paused");
                self.write_checkpoint();
                place
            }
            RequestKind::Shutdown => self.lockstep.shut_down(ticket)?,
            RequestKind::Window(_) | RequestKind::Status => {
                let message = format!("{}: not a queued request", verb.name());
                return Err(RequestError::new(ErrorCode::UnknownRequest, message));
            }
        };
        Ok(EncodedReply::json(&place))
    }

    fn state_replaced(&mut self, text: &str) {
        self.log(text);
        self.publish_description();
        let now_ns = self.lockstep.component().now_ns();
        self.publishers.publish_replaced_state(self.lockstep.state_hash(), now_ns);
        self.hooks.state_replaced(&self.lockstep);
        self.update_viewer(None);
        self.write_checkpoint();
    }

    /// Sets parameters, and starts or stops the real-time mode.
    fn set_parameters(
        &mut self,
        ask: &ParameterUpdate,
        ticket: &str,
    ) -> Result<RunPosition, RequestError> {
        // Both are checked before either takes effect.
        let pacer = self.new_pacer(ask, ticket)?;
        let place = self.lockstep.set_parameters(ask, ticket)?;
        match (pacer, &ask.real_time) {
            (Some(pacer), _) => {
                self.inputs.take();
                self.pacer = Some(pacer);
                self.log("real-time mode started");
            }
            (None, Some(None)) => self.stop_real_time("requested by the owner"),
            (None, _) => {}
        }
        if ask.max_iterations.is_some() || ask.tolerance.is_some() || ask.max_penetration.is_some()
        {
            let set = self.lockstep.component().parameters().into();
            let SolverParameters { max_iterations, tolerance, max_penetration } = set;
            self.log(&format!(
                "parameters: max_iterations {max_iterations}, tolerance {tolerance}, max_penetration {max_penetration} m (0: none)"
            ));
        }
        self.publish_description();
        // A checkpoint, so that a resumed run does not recompute earlier windows with the new parameters.
        self.hooks.parameters_changed();
        self.write_checkpoint();
        Ok(place)
    }

    /// Prepares a component and publishes that state meanwhile.
    fn init(&mut self, ask: &InitRequest, ticket: &str) -> Result<RunPosition, RequestError> {
        self.lockstep.check_init(ticket)?;
        self.shared.set_preparing();
        let component = self.hooks.prepare(ask)?;
        let place = self.lockstep.begin_run(component, new_ticket()?, self.shared.now_ms());
        self.state_replaced(&format!("bed prepared, run {}", place.run_id));
        Ok(self.lockstep.position())
    }

    fn attach(&mut self, query: &Query, now: u64) -> Result<EncodedReply, RequestError> {
        let ask: AttachRequest = decode_object(query)?;
        if !self.shared.is_live(&ask.client) {
            // The token may arrive after the request. An invalid name has none.
            let token = find_token(self.session, self.keys.owner(&ask.client), TOKEN_TIMEOUT);
            if !token.is_ok_and(|token| token.is_some()) {
                let expected = "a client with a liveliness token `owner/CLIENT`";
                let found: String = ask.client.chars().take(50).collect();
                return Err(RequestError::expected(
                    ErrorCode::NoLivelinessToken,
                    "attach",
                    expected,
                    found,
                ));
            }
            self.shared.owner_candidate_appeared(ask.client.clone());
        }
        let attached = self.lockstep.attach(&ask, new_ticket()?, now)?;
        self.log(&format!("{:?} attached", ask.client));
        Ok(EncodedReply::json(&attached))
    }
}
