//! The door: what can be answered at once is, what must not come in does not, the rest waits for the
//! computing thread.
//!
//! Contract: runs on threads of the transport and never waits for the computing one. EmptyRequest is decoded
//! before its size is known to be allowed; who does not drive can only make `attach` wait.

use super::answer::{self, Answer};
use super::requests::quitting;
use super::shared::{Room, Shared};
use crate::keys::{SCHEMA, last};
use crate::{Error, Keys, MAX_MESSAGE_BYTES};
use ballast_protocol::from_json_called;
use ballast_protocol::lockstep::{AttachRequest, ErrorCode, RequestError, RequestKind};
use ballast_protocol::schema::EmptyRequest;
use std::sync::Arc;
use std::sync::mpsc::{SendError, Sender};
use zenoh::query::Query;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// Largest request that is no window, bytes.
const LARGEST_CONTROL: usize = 64 << 10;
/// Longest ticket and number of a request together.
const LONGEST_PASS: usize = 200;
/// Least length of a number that nobody guesses.
const SECRET: usize = 16;

/// What a caller shows: the owner's ticket, and a number of its own for the request, by which a retry is
/// known.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Pass {
    pub ticket: String,
    pub number: String,
}

impl Pass {
    /// From the attachment `TICKET` or `TICKET;NUMBER`, or from the parameters `ticket` and `number`.
    fn of(query: &Query) -> Result<Self, RequestError> {
        let size = query.attachment().map_or(0, zenoh::bytes::ZBytes::len);
        if size > LONGEST_PASS || query.parameters().as_str().len() > LONGEST_PASS {
            let expected = format!("at most {LONGEST_PASS} bytes");
            return Err(RequestError::expected(ErrorCode::TooLarge, "ticket", expected, "more"));
        }
        let attached =
            query.attachment().and_then(|a| a.try_to_string().ok().map(|t| t.into_owned()));
        let Some(text) = attached else {
            let parameter = |name| query.parameters().get(name).unwrap_or_default().to_string();
            return Ok(Self { ticket: parameter("ticket"), number: parameter("number") });
        };
        let (ticket, number) = text.split_once(';').unwrap_or((&text, ""));
        Ok(Self { ticket: ticket.into(), number: number.into() })
    }

    /// Whether the same request again may be told what was answered to it. Who asks to drive has nothing but its number to
    /// show, and the answer is the ticket.
    pub fn is_known_again(&self, verb: RequestKind) -> bool {
        let least = if verb == RequestKind::Attach { SECRET } else { 1 };
        self.number.len() >= least
    }
}

/// A request that waits for the computing thread.
pub(super) struct Request {
    pub query: Query,
    pub verb: RequestKind,
    pub pass: Pass,
    pub room: Room,
}

/// What wakes the computing thread.
pub(super) enum Call {
    Request(Box<Request>),
    /// Samples of motion are waiting.
    Input,
}

/// Declares the requests of a component, and what is told about its clients.
pub(super) fn open(
    session: &Session,
    keys: &Keys,
    shared: &Arc<Shared>,
    sender: Sender<Call>,
) -> Result<(), Error> {
    let zenoh = |e: zenoh::Error| Error::link("zenoh", e);
    let (at, to) = (Arc::clone(shared), keys.clone());
    let control = session.declare_queryable(keys.control_any()).complete(true);
    let control = control.callback(move |query| enter(&at, &to, &sender, query));
    control.background().wait().map_err(zenoh)?;
    let (at, key) = (Arc::clone(shared), keys.describe());
    let describe = session.declare_queryable(keys.describe()).complete(true);
    let describe = describe.callback(move |query: Query| {
        let told = at.check_rate().and_then(|()| match query.parameters().contains_key(SCHEMA) {
            true => Ok(Answer::json(&ballast_protocol::schema::control_plane())),
            false => at.description().map(Answer::text),
        });
        answer::send(&query, key.clone(), told);
    });
    describe.background().wait().map_err(zenoh)?;
    let at = Arc::clone(shared);
    let clients = session.liveliness().declare_subscriber(keys.owner_any()).history(true);
    let clients = clients.callback(move |sample: Sample| {
        let client = last(sample.key_expr().as_str());
        match sample.kind() {
            SampleKind::Put => at.client_is_alive(client.into()),
            SampleKind::Delete => at.client_is_gone(client),
        }
    });
    clients.background().wait().map_err(zenoh)?;
    Ok(())
}

fn enter(shared: &Arc<Shared>, keys: &Keys, sender: &Sender<Call>, query: Query) {
    let word = last(query.key_expr().as_str()).to_string();
    let key = keys.control(&word);
    let bytes = query.payload().map_or(0, zenoh::bytes::ZBytes::len);
    match check(shared, &word, &query, bytes) {
        Ok(RequestKind::Status) => answer::send(&query, key, Ok(Answer::json(&shared.status()))),
        Ok(RequestKind::Param) if is_empty(&query) => {
            answer::send(&query, key, shared.parameters().map(Answer::text));
        }
        Ok(verb) => {
            let admitted = Pass::of(&query).and_then(|pass| Ok((pass, shared.admit(verb, bytes)?)));
            match admitted {
                Ok((pass, room)) => {
                    // A window may have days to go.
                    if matches!(verb, RequestKind::Detach | RequestKind::Shutdown) {
                        shared.set_leaving(Some(&pass.ticket));
                    }
                    let request = Call::Request(Box::new(Request { query, verb, pass, room }));
                    if let Err(SendError(Call::Request(refused))) = sender.send(request) {
                        answer::send(&refused.query, key, Err(quitting()));
                    }
                }
                Err(fault) => answer::send(&query, key, Err(fault)),
            }
        }
        Err(fault) => answer::send(&query, key, Err(fault)),
    }
}

fn check(
    shared: &Shared,
    word: &str,
    query: &Query,
    bytes: usize,
) -> Result<RequestKind, RequestError> {
    let is_owner = Pass::of(query).is_ok_and(|pass| shared.check_owner(&pass.ticket).is_ok());
    if !is_owner {
        shared.check_rate()?;
    }
    let verb = RequestKind::of(word).ok_or_else(|| unknown(word))?;
    let most =
        if matches!(verb, RequestKind::Window(_)) { MAX_MESSAGE_BYTES } else { LARGEST_CONTROL };
    if bytes > most {
        let expected = format!("at most {most} bytes");
        return Err(RequestError::expected(ErrorCode::TooLarge, word, expected, bytes));
    }
    match verb {
        RequestKind::Status => {}
        RequestKind::Param if is_empty(query) => {}
        RequestKind::Attach => {
            let ask: AttachRequest = object(query)?;
            // The same request again gets the answer of the first; the computing thread knows.
            let is_known = Pass::of(query)?.is_known_again(verb);
            if let Err(busy) = shared.check_free(ask.ticket.as_deref())
                && !(is_known && busy.owner.as_ref() == Some(&ask.client))
            {
                return Err(busy);
            }
        }
        _ => {
            shared.check_owner(&Pass::of(query)?.ticket)?;
            // They end a window in work: not for what is refused then.
            if matches!(verb, RequestKind::Detach | RequestKind::Shutdown) {
                object::<EmptyRequest>(query)?;
            }
        }
    }
    Ok(verb)
}

fn unknown(word: &str) -> RequestError {
    let expected = format!("one of {}", RequestKind::ALL.map(RequestKind::word).join(", "));
    let found: String = word.chars().take(50).collect();
    RequestError::expected(ErrorCode::UnknownRequest, "ctl", expected, format!("{found:?}"))
}

/// Whether a request has no content: it asks for what is set, and sets nothing.
fn is_empty(query: &Query) -> bool {
    object::<EmptyRequest>(query).is_ok()
}

/// A JSON object from the payload; none is an empty one.
pub(super) fn object<T: serde::de::DeserializeOwned>(query: &Query) -> Result<T, RequestError> {
    let bytes = query.payload().map(|p| p.to_bytes()).filter(|bytes| !bytes.is_empty());
    let bytes = bytes.unwrap_or_else(|| b"{}".as_slice().into());
    let word = last(query.key_expr().as_str());
    Ok(from_json_called(word, &bytes)?)
}
