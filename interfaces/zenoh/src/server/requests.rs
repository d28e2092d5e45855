//! One request, on the computing thread: what it asks, what is answered.

use super::Service;
use super::answer::{self, Answer, CDR};
use super::gate::{Request, Verb, object};
use crate::{Error, random};
use ballast_protocol::lockstep::{Attach, Code, Fault, Kind, Named, Pace, Progress};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Message};
use ballast_protocol::{from_cdr, from_json};
use std::sync::Arc;
use std::time::Duration;
use zenoh::Wait;
use zenoh::query::Query;

/// How long a client's token is looked for.
const LOOK: Duration = Duration::from_millis(500);

/// Whether the query's payload is CDR.
fn is_cdr(query: &Query) -> bool {
    query.encoding().is_some_and(|e| e.to_string().starts_with(CDR))
}

fn message<T: Message>(query: &Query) -> Result<T, Fault> {
    let bytes = query.payload().map(|p| p.to_bytes()).unwrap_or_default();
    Ok(if is_cdr(query) { from_cdr(&bytes)? } else { from_json(&bytes)? })
}

fn fresh() -> Result<String, Fault> {
    random().map_err(|e| Fault::new(Code::InError, e.to_string()))
}

impl Service<'_> {
    /// Does what a request asks and answers it.
    pub fn request(&mut self, request: Request) -> Result<(), Error> {
        let Request { query, verb, pass, bytes } = request;
        let key = self.keys.control(verb.word());
        if let Verb::Window(kind) = verb {
            self.window(kind, &query, key, &pass.ticket);
        } else {
            let result = self.answered.find(&pass.number).unwrap_or_else(|| {
                let result = self.control(verb, &query, &pass.ticket);
                self.answered.keep(&pass.number, &result);
                result
            });
            // Shown before it is answered: who has the answer may ask for something else at once.
            self.shared.show(&self.lockstep);
            if matches!(verb, Verb::Reset | Verb::Init) && result.is_ok() {
                self.come_alive()?;
            }
            answer::send(&query, key, result);
        }
        self.shared.dismiss(bytes);
        Ok(())
    }

    /// Refuses what was not begun when the component quits.
    pub fn refuse(&self, request: &Request) {
        let fault = Fault::new(Code::Quitting, "the component is being shut down");
        answer::send(&request.query, self.keys.control(request.verb.word()), Err(fault));
        self.shared.dismiss(request.bytes);
    }

    fn window(&mut self, kind: Kind, query: &Query, key: String, ticket: &str) {
        let request = match message::<AdvanceRequest>(query) {
            Ok(request) => request,
            Err(fault) => return answer::send(query, key, Err(fault)),
        };
        let shared = Arc::clone(&self.shared);
        let clock = move || shared.now_ms();
        let due = (request.deadline_ms > 0).then(|| clock() + u64::from(request.deadline_ms));
        let (shared, host) = (Arc::clone(&self.shared), &mut *self.host);
        let mut watch = |progress: &Progress| {
            shared.show_progress(progress);
            if host.is_stopped() {
                Pace::Abandon
            } else if due.is_some_and(|due| clock() >= due) {
                Pace::TimeIsUp
            } else {
                Pace::GoOn
            }
        };
        // From the first moment on: a first step may take long, and who sees it idle asks again.
        let ahead = u64::try_from(request.t1_ns.saturating_sub(request.t0_ns)).unwrap_or(0);
        let steps = ahead / self.lockstep.component().model().stepping.step_ns;
        self.shared.show_progress(&Progress { seq: request.seq, steps, ..Progress::default() });
        let before = self.lockstep.answered_count();
        let result = self.lockstep.window(kind, &request, ticket, &clock, &mut watch);
        self.shared.show(&self.lockstep);
        let answered = result
            .as_ref()
            .map_err(Clone::clone)
            .and_then(|reply| Answer::message::<AdvanceReply>(reply, is_cdr(query)));
        answer::send(query, key, answered);
        if let Ok(reply) = result
            && self.lockstep.answered_count() != before
        {
            self.outlets.window(&reply);
            if self.host.computed(&self.lockstep, kind, &request, &reply) {
                self.lockstep.is_durable();
                self.shared.show(&self.lockstep);
            }
        }
    }

    fn control(&mut self, verb: Verb, query: &Query, ticket: &str) -> Result<Answer, Fault> {
        let now = self.shared.now_ms();
        let place = match verb {
            Verb::Attach => return self.attach(query, now),
            Verb::Init | Verb::Reset => {
                object::<Nothing>(query)?;
                let place = self.lockstep.reset(fresh()?, ticket, now)?;
                self.taken_elsewhere(&format!("begins again, as run {}", place.run_id));
                place
            }
            Verb::Save => self.lockstep.save(&object::<Named>(query)?, ticket)?,
            Verb::Restore => {
                let name: Named = object(query)?;
                let place = self.lockstep.restore(&name, ticket)?;
                self.taken_elsewhere(&format!("restored {:?}, {} ns", name.name, place.now_ns));
                place
            }
            Verb::Drop => self.lockstep.drop_state(&object::<Named>(query)?, ticket)?,
            Verb::Detach => {
                let place = self.lockstep.detach(ticket)?;
                self.say("the owner has left; the run holds");
                self.keep();
                place
            }
            Verb::Shutdown => self.lockstep.shut_down(ticket)?,
            Verb::Window(_) | Verb::Status | Verb::Param => {
                let message = format!("{}: is answered elsewhere", verb.word());
                return Err(Fault::new(Code::UnknownRequest, message));
            }
        };
        Ok(Answer::json(&place))
    }

    fn taken_elsewhere(&mut self, text: &str) {
        self.say(text);
        self.describe();
        self.host.taken_elsewhere(&self.lockstep);
        self.keep();
    }

    fn attach(&mut self, query: &Query, now: u64) -> Result<Answer, Fault> {
        let ask: Attach = object(query)?;
        if !self.shared.is_live(&ask.client) {
            // The token may come right behind the request. A name that cannot be a key has none.
            let liveliness = self.session.liveliness();
            let alive = liveliness.get(self.keys.owner(&ask.client)).timeout(LOOK).wait();
            if !alive.is_ok_and(|replies| replies.recv().is_ok_and(|r| r.result().is_ok())) {
                let expected = "a client with a liveliness token `owner/CLIENT`";
                let found: String = ask.client.chars().take(50).collect();
                return Err(Fault::expected(Code::NotAlive, "attach", expected, found));
            }
            self.shared.client_is_alive(ask.client.clone());
        }
        let attached = self.lockstep.attach(&ask, fresh()?, now)?;
        self.say(&format!("{:?} drives", ask.client));
        self.describe();
        Ok(Answer::json(&attached))
    }
}

/// A request without content.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Nothing {}
