//! One request, on the computing thread: what it asks, what is answered.

use super::answer::{self, Answer};
use super::gate::{Request, object};
use super::memory::Numbered;
use super::{Service, find_token};
use crate::{Error, random, wire};
use ballast_protocol::lockstep::{
    AttachRequest, ErrorCode, InitRequest, ParameterUpdate, RequestError, RequestKind, RunPosition,
    StateName, WindowControl, WindowKind, WindowProgress,
};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Message, SolverParameters};
use ballast_protocol::schema::EmptyRequest;
use ballast_protocol::{from_cdr, from_json};
use std::sync::Arc;
use std::time::Duration;
use zenoh::query::Query;

/// How long a client's token is looked for.
const LOOK: Duration = Duration::from_millis(500);

/// Whether the query's payload is CDR.
fn is_cdr(query: &Query) -> bool {
    query.encoding().is_some_and(wire::is_cdr)
}

fn message<T: Message>(query: &Query) -> Result<T, RequestError> {
    let bytes = query.payload().map(|p| p.to_bytes()).unwrap_or_default();
    Ok(if is_cdr(query) { from_cdr(&bytes)? } else { from_json(&bytes)? })
}

/// What is not begun any more when the component ends.
pub(super) fn quitting() -> RequestError {
    RequestError::new(ErrorCode::ShuttingDown, "the component is being shut down")
}

fn fresh() -> Result<String, RequestError> {
    random().map_err(|e| RequestError::new(ErrorCode::ErrorState, e.to_string()))
}

impl Service<'_> {
    /// Does what a request asks and answers it.
    pub fn request(&mut self, request: Request) -> Result<(), Error> {
        let Request { query, verb, pass, room: _room } = request;
        let key = self.keys.control(verb.word());
        if let RequestKind::Window(kind) = verb {
            self.window(kind, &query, key, &pass.ticket);
        } else {
            let numbered = Numbered::of(verb, &pass, &query);
            let result = self.answered.find(numbered.as_ref()).unwrap_or_else(|| {
                let result = self.control(verb, &query, &pass.ticket);
                self.answered.keep(numbered, &result);
                result
            });
            if matches!(verb, RequestKind::Detach | RequestKind::Shutdown) {
                self.shared.set_leaving(None);
            }
            // Shown before it is answered: who has the answer may ask for something else at once.
            self.show();
            if matches!(verb, RequestKind::Reset | RequestKind::Init) && result.is_ok() {
                self.come_alive()?;
            }
            answer::send(&query, key, result);
        }
        Ok(())
    }

    /// Refuses what was not begun when the component quits.
    pub fn refuse(&self, request: &Request) {
        answer::send(&request.query, self.keys.control(request.verb.word()), Err(quitting()));
    }

    fn window(&mut self, kind: WindowKind, query: &Query, key: String, ticket: &str) {
        let request = match message::<AdvanceRequest>(query) {
            Ok(request) => request,
            Err(fault) => return answer::send(query, key, Err(fault)),
        };
        let before = self.lockstep.computed_windows();
        let was_durable = self.lockstep.durable_seq() == request.seq;
        let result = match self.check_stands() {
            Ok(()) => self.compute(kind, &request, ticket),
            Err(fault) => Err(fault),
        };
        let answered = result
            .as_ref()
            .map_err(Clone::clone)
            .and_then(|reply| Answer::message::<AdvanceReply>(reply, is_cdr(query)));
        // What a checkpoint holds otherwise is kept before anyone goes on from it.
        if kind == WindowKind::Redo && was_durable {
            self.tell(kind, &request, &result, before);
            return answer::send(query, key, answered);
        }
        answer::send(query, key, answered);
        self.tell(kind, &request, &result, before);
    }

    /// Computes a window, everyone being told how far it is.
    pub(super) fn compute(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        ticket: &str,
    ) -> Result<AdvanceReply, RequestError> {
        let shared = Arc::clone(&self.shared);
        let clock = &move || shared.now_ns();
        let allowed = Duration::from_millis(request.deadline_ms.into()).as_nanos() as u64;
        let due = (allowed > 0).then(|| clock() + allowed);
        let (shared, host) = (Arc::clone(&self.shared), &mut *self.host);
        // Also on the threads that compute: the host goes with it, for as long as the window lasts.
        let mut watch = move |progress: &WindowProgress| {
            shared.show_progress(progress);
            if host.is_stopped() || shared.is_forsaken() || shared.is_left() {
                WindowControl::Cancel
            } else if due.is_some_and(|due| clock() >= due) {
                WindowControl::DeadlineExceeded
            } else {
                WindowControl::Continue
            }
        };
        // From the first moment on: a first step may take long, and who sees it idle asks again.
        let steps = self.lockstep.steps(request);
        self.shared.show_progress(&WindowProgress {
            seq: request.seq,
            steps,
            ..WindowProgress::default()
        });
        let result = self.lockstep.window(kind, request, ticket, clock, &mut watch);
        self.show();
        result.map_err(|fault| match fault.code {
            ErrorCode::Cancelled if self.host.is_stopped() => quitting(),
            ErrorCode::Cancelled if self.shared.is_left() => {
                RequestError::new(ErrorCode::NotOwner, "window: taken back, its owner leaves")
            }
            // What its ticket is worth from now on.
            ErrorCode::Cancelled => {
                RequestError::new(ErrorCode::NotOwner, "window: taken back, its owner is gone")
            }
            _ => fault,
        })
    }

    /// Tells everyone of a window, unless it was answered from memory: `before` windows had been computed.
    pub(super) fn tell(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        result: &Result<AdvanceReply, RequestError>,
        before: u64,
    ) {
        if let Ok(reply) = result
            && self.lockstep.computed_windows() != before
        {
            self.outlets.window(kind, reply);
            self.picture(reply.status.is_kept().then_some(reply));
            if self.host.computed(&self.lockstep, kind, request, reply) {
                self.lockstep.note_durable();
                self.show();
            }
        }
    }

    fn control(
        &mut self,
        verb: RequestKind,
        query: &Query,
        ticket: &str,
    ) -> Result<Answer, RequestError> {
        let now = self.shared.now_ms();
        if matches!(verb, RequestKind::Init | RequestKind::Reset | RequestKind::Restore) {
            self.check_stands()?;
        }
        let place = match verb {
            RequestKind::Attach => return self.attach(query, now),
            RequestKind::Init => self.init(&object(query)?, ticket)?,
            RequestKind::Param => self.set(&object(query)?, ticket)?,
            RequestKind::Reset => {
                object::<EmptyRequest>(query)?;
                let place = self.lockstep.reset(fresh()?, ticket, now)?;
                self.run_replaced(&format!("begins again, as run {}", place.run_id));
                place
            }
            RequestKind::Save => self.lockstep.save(&object::<StateName>(query)?, ticket)?,
            RequestKind::Restore => {
                let name: StateName = object(query)?;
                let place = self.lockstep.restore(&name, ticket)?;
                self.run_replaced(&format!("restored {:?}, {} ns", name.name, place.now_ns));
                place
            }
            RequestKind::Drop => self.lockstep.drop_state(&object::<StateName>(query)?, ticket)?,
            RequestKind::Detach => {
                let place = self.lockstep.detach(ticket)?;
                self.stop_real_time("the owner has left");
                self.say("the owner has left; the run holds");
                self.keep();
                place
            }
            RequestKind::Shutdown => self.lockstep.shut_down(ticket)?,
            RequestKind::Window(_) | RequestKind::Status => {
                let message = format!("{}: is answered elsewhere", verb.word());
                return Err(RequestError::new(ErrorCode::UnknownRequest, message));
            }
        };
        Ok(Answer::json(&place))
    }

    fn run_replaced(&mut self, text: &str) {
        self.say(text);
        self.describe();
        let now_ns = self.lockstep.component().now_ns();
        self.outlets.elsewhere(self.lockstep.hash_now(), now_ns);
        self.host.run_replaced(&self.lockstep);
        self.picture(None);
        self.keep();
    }

    /// Sets parameters, or lets time run by itself.
    fn set(&mut self, ask: &ParameterUpdate, ticket: &str) -> Result<RunPosition, RequestError> {
        // All of it or nothing.
        let pacer = self.pacer(ask, ticket)?;
        let place = self.lockstep.set_parameters(ask, ticket)?;
        match (pacer, &ask.real_time) {
            (Some(pacer), _) => {
                self.inputs.take();
                self.pacer = Some(pacer);
                self.say("time runs by itself");
            }
            (None, Some(None)) => self.stop_real_time("its owner stops it"),
            (None, _) => {}
        }
        if ask.max_iterations.is_some() || ask.tolerance.is_some() || ask.max_penetration.is_some()
        {
            let set = self.lockstep.component().parameters().into();
            let SolverParameters { max_iterations, tolerance, max_penetration } = set;
            self.say(&format!(
                "parameters: max_iterations {max_iterations}, tolerance {tolerance}, max_penetration {max_penetration} m (0: none)"
            ));
        }
        self.describe();
        // So that windows before it need not be computed again with what holds now.
        self.host.changed();
        self.keep();
        Ok(place)
    }

    /// Prepares a component anew; everyone is told so meanwhile.
    fn init(&mut self, ask: &InitRequest, ticket: &str) -> Result<RunPosition, RequestError> {
        self.lockstep.check_init(ticket)?;
        self.shared.show_settling();
        let component = self.host.init(ask)?;
        let place = self.lockstep.begin(component, fresh()?, self.shared.now_ms());
        self.run_replaced(&format!("is prepared, as run {}", place.run_id));
        Ok(self.lockstep.position())
    }

    fn attach(&mut self, query: &Query, now: u64) -> Result<Answer, RequestError> {
        let ask: AttachRequest = object(query)?;
        if !self.shared.is_live(&ask.client) {
            // The token may come right behind the request. A name that cannot be a key has none.
            let token = find_token(self.session, self.keys.owner(&ask.client), LOOK);
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
            self.shared.driver_is_alive(ask.client.clone());
        }
        let attached = self.lockstep.attach(&ask, fresh()?, now)?;
        self.say(&format!("{:?} drives", ask.client));
        Ok(Answer::json(&attached))
    }
}
