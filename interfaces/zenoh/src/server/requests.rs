//! One request: what it asks, what is answered.

use super::{Event, Host, Server};
use crate::Error;
use crate::keys::last;
use crate::link::LARGEST_MESSAGE;
use ballast_protocol::lockstep::{Attach, Code, Fault, Kind, Named};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Message};
use ballast_protocol::{from_cdr, from_json, to_cdr};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::sync::Arc;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::query::Query;

/// The start of the encoding of CDR messages; their type follows.
pub(crate) const CDR: &str = "application/cdr";

/// Bytes of an answer, and how they are to be read.
pub(super) struct Answer {
    bytes: Vec<u8>,
    encoding: Encoding,
}

impl Answer {
    pub fn json(value: &impl Serialize) -> Self {
        Self::text(serde_json::to_string(value).unwrap_or_default())
    }

    pub fn text(text: String) -> Self {
        Self { bytes: text.into_bytes(), encoding: Encoding::APPLICATION_JSON }
    }

    /// A message in the encoding of the request.
    fn message<T: Message>(message: &T, is_cdr: bool) -> Result<Self, Fault> {
        if !is_cdr {
            return Ok(Self::json(message));
        }
        let encoding = Encoding::from(format!("{CDR};{}", T::NAME));
        Ok(Self { bytes: to_cdr(message)?, encoding })
    }
}

/// Sends the answer. A caller that is gone meanwhile asks again when it is back.
pub(super) fn answer(query: &Query, result: Result<Answer, Fault>) {
    let key = query.key_expr().clone();
    let _ = match result {
        Ok(answer) => query.reply(key, answer.bytes).encoding(answer.encoding).wait(),
        Err(fault) => {
            let text = serde_json::to_string(&fault).unwrap_or_default();
            query.reply_err(text).encoding(Encoding::APPLICATION_JSON).wait()
        }
    };
}

/// Refuses a request for which there is no room.
pub(super) fn refuse_waiting(event: Event, most: usize) {
    if let Event::Request(query) = event {
        let message = format!("requests that wait: expected at most {most}, found one more");
        answer(&query, Err(Fault::new(Code::TooManyRequests, message)));
    }
}

/// Whether the query's payload is CDR.
fn is_cdr(query: &Query) -> bool {
    query.encoding().is_some_and(|e| e.to_string().starts_with(CDR))
}

/// The owner's ticket: the attachment, or the parameter `ticket`.
fn ticket(query: &Query) -> String {
    let attached = query.attachment().and_then(|a| a.try_to_string().ok().map(|t| t.into_owned()));
    attached.unwrap_or_else(|| query.parameters().get("ticket").unwrap_or_default().to_string())
}

/// Bytes of the payload; none is an empty object.
fn payload(query: &Query) -> Result<Vec<u8>, Fault> {
    let size = query.payload().map_or(0, zenoh::bytes::ZBytes::len);
    if size > LARGEST_MESSAGE {
        let expected = format!("at most {LARGEST_MESSAGE} bytes");
        return Err(Fault::expected(Code::TooLarge, "message", expected, size));
    }
    Ok(query.payload().map_or_else(|| b"{}".to_vec(), |p| p.to_bytes().into_owned()))
}

fn object<T: DeserializeOwned>(query: &Query) -> Result<T, Fault> {
    let bytes = payload(query)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| Fault::new(Code::Malformed, format!("{}: {e}", query.key_expr())))
}

fn message<T: Message>(query: &Query) -> Result<T, Fault> {
    let bytes = payload(query)?;
    Ok(if is_cdr(query) { from_cdr(&bytes)? } else { from_json(&bytes)? })
}

/// 128 random bits, as hexadecimal digits.
fn fresh() -> Result<String, Fault> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)
        .map_err(|e| Fault::new(Code::InError, format!("the system gives no random numbers: {e}")))?;
    Ok(format!("{:032x}", u128::from_be_bytes(bytes)))
}

impl Server {
    /// Does what a query asks and answers it.
    pub(super) fn request(&mut self, query: &Query, host: &mut dyn Host) -> Result<(), Error> {
        let verb = last(query.key_expr().as_str()).to_string();
        let result = match verb.as_str() {
            "attach" => self.attach(query),
            "advance" => self.window(Kind::Advance, query, host),
            "redo" => self.window(Kind::Redo, query, host),
            _ => self.other(&verb, query, host),
        };
        self.show();
        answer(query, result);
        if verb == "reset" { self.come_alive() } else { Ok(()) }
    }

    fn attach(&mut self, query: &Query) -> Result<Answer, Fault> {
        let ask: Attach = object(query)?;
        if !self.live.contains(&ask.client) {
            // The token may come right behind the request.
            let alive = self.session.liveliness().get(self.keys.owner(&ask.client)).wait();
            if !alive.is_ok_and(|replies| replies.recv().is_ok_and(|r| r.result().is_ok())) {
                let expected = "a client with a liveliness token `owner/CLIENT`";
                return Err(Fault::expected(Code::NotAlive, "attach", expected, ask.client));
            }
            self.live.insert(ask.client.clone());
        }
        let now = self.now_ms();
        Ok(Answer::json(&self.lockstep.attach(&ask, fresh()?, now)?))
    }

    fn window(&mut self, kind: Kind, query: &Query, host: &mut dyn Host) -> Result<Answer, Fault> {
        let request: AdvanceRequest = message(query)?;
        let (start, shared) = (self.start, Arc::clone(&self.shared));
        let clock = move || start.elapsed().as_millis() as u64;
        let due = (request.deadline_ms > 0).then(|| clock() + u64::from(request.deadline_ms));
        let mut watch = |progress: &ballast_protocol::lockstep::Progress| {
            Self::show_progress(&shared, progress);
            due.is_some_and(|due| clock() >= due)
        };
        let before = self.lockstep.answered_count();
        let reply =
            self.lockstep.window(kind, &request, &ticket(query), &clock, &mut watch)?;
        if self.lockstep.answered_count() != before {
            self.tell(&reply);
            host.computed(&self.lockstep, &request, &reply);
        }
        Answer::message::<AdvanceReply>(&reply, is_cdr(query))
    }

    fn other(&mut self, verb: &str, query: &Query, host: &mut dyn Host) -> Result<Answer, Fault> {
        let (ticket, now) = (ticket(query), self.now_ms());
        let place = match verb {
            "reset" => self.lockstep.reset(fresh()?, &ticket, now)?,
            "save" => self.lockstep.save(&object::<Named>(query)?, &ticket)?,
            "restore" => self.lockstep.restore(&object::<Named>(query)?, &ticket)?,
            "drop" => self.lockstep.drop_state(&object::<Named>(query)?, &ticket)?,
            "detach" => {
                let place = self.lockstep.detach(&ticket)?;
                self.keep(host);
                place
            }
            "shutdown" => self.lockstep.shut_down(&ticket)?,
            _ => {
                let known = "one of advance, attach, detach, drop, redo, reset, restore, save, \
                             shutdown, status";
                return Err(Fault::expected(Code::UnknownRequest, "ctl", known, format!("{verb:?}")));
            }
        };
        Ok(Answer::json(&place))
    }
}
