//! Request admission, on the transport's threads.
//!
//! Answers read-only requests immediately, rejects invalid ones, and queues the rest for the computing thread, for
//! which it never waits. Payload sizes are checked before decoding. Only the owner can queue requests; other clients
//! can queue `attach`.

use super::reply::{self, EncodedReply};
use super::request::{Credentials, QueuedRequest, ServerEvent, decode_object, shutting_down};
use super::status::SharedStatus;
use crate::keys::{SCHEMA, last_segment};
use crate::{Error, Keys, MAX_MESSAGE_BYTES};
use ballast_protocol::lockstep::{AttachRequest, ErrorCode, RequestError, RequestKind};
use ballast_protocol::schema::EmptyRequest;
use std::sync::Arc;
use std::sync::mpsc::{SendError, Sender};
use zenoh::query::Query;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// Maximum size of a request other than a window, bytes.
const MAX_CONTROL_BYTES: usize = 64 << 10;

/// Declares the request keys of a component and subscribes to the liveliness of clients.
pub(super) fn declare(
    session: &Session,
    keys: &Keys,
    shared: &Arc<SharedStatus>,
    sender: Sender<ServerEvent>,
) -> Result<(), Error> {
    let zenoh = |e: zenoh::Error| Error::transport("zenoh", e);
    let (at, to) = (Arc::clone(shared), keys.clone());
    let control = session.declare_queryable(keys.control_any()).complete(true);
    let control = control.callback(move |query| admit(&at, &to, &sender, query));
    control.background().wait().map_err(zenoh)?;
    let (at, key) = (Arc::clone(shared), keys.describe());
    let describe = session.declare_queryable(keys.describe()).complete(true);
    let describe = describe.callback(move |query: Query| {
        let result = at.check_rate().and_then(|()| match query.parameters().contains_key(SCHEMA) {
            true => Ok(EncodedReply::json(&ballast_protocol::schema::control_plane_schema())),
            false => at.description().map(EncodedReply::text),
        });
        reply::send(&query, key.clone(), result);
    });
    describe.background().wait().map_err(zenoh)?;
    let at = Arc::clone(shared);
    let clients = session.liveliness().declare_subscriber(keys.owner_any()).history(true);
    let clients = clients.callback(move |sample: Sample| {
        let client = last_segment(sample.key_expr().as_str());
        match sample.kind() {
            SampleKind::Put => at.client_appeared(client.into()),
            SampleKind::Delete => at.client_vanished(client),
        }
    });
    clients.background().wait().map_err(zenoh)?;
    Ok(())
}

fn admit(shared: &Arc<SharedStatus>, keys: &Keys, sender: &Sender<ServerEvent>, query: Query) {
    let word = last_segment(query.key_expr().as_str()).to_string();
    let key = keys.control(&word);
    let bytes = query.payload().map_or(0, zenoh::bytes::ZBytes::len);
    match check(shared, &word, &query, bytes) {
        Ok(RequestKind::Status) => {
            reply::send(&query, key, Ok(EncodedReply::json(&shared.status())))
        }
        Ok(RequestKind::Param) if is_empty(&query) => {
            reply::send(&query, key, shared.parameters().map(EncodedReply::text));
        }
        Ok(verb) => {
            let admitted = Credentials::of(&query)
                .and_then(|credentials| Ok((credentials, shared.admit(verb, bytes)?)));
            match admitted {
                Ok((credentials, slot)) => {
                    // A running window may take days.
                    if matches!(verb, RequestKind::Detach | RequestKind::Shutdown) {
                        shared.set_leaving(Some(&credentials.ticket));
                    }
                    let request = ServerEvent::Request(Box::new(QueuedRequest {
                        query,
                        kind: verb,
                        credentials,
                        slot,
                    }));
                    if let Err(SendError(ServerEvent::Request(refused))) = sender.send(request) {
                        reply::send(&refused.query, key, Err(shutting_down()));
                    }
                }
                Err(fault) => reply::send(&query, key, Err(fault)),
            }
        }
        Err(fault) => reply::send(&query, key, Err(fault)),
    }
}

fn check(
    shared: &SharedStatus,
    word: &str,
    query: &Query,
    bytes: usize,
) -> Result<RequestKind, RequestError> {
    let is_owner = Credentials::of(query)
        .is_ok_and(|credentials| shared.check_owner(&credentials.ticket).is_ok());
    if !is_owner {
        shared.check_rate()?;
    }
    let verb = RequestKind::from_name(word).ok_or_else(|| unknown(word))?;
    let max_bytes =
        if matches!(verb, RequestKind::Window(_)) { MAX_MESSAGE_BYTES } else { MAX_CONTROL_BYTES };
    if bytes > max_bytes {
        let expected = format!("at most {max_bytes} bytes");
        return Err(RequestError::expected(ErrorCode::TooLarge, word, expected, bytes));
    }
    match verb {
        RequestKind::Status => {}
        RequestKind::Param if is_empty(query) => {}
        RequestKind::Attach => {
            let ask: AttachRequest = decode_object(query)?;
            // A retry gets the stored reply from the computing thread.
            let is_known = Credentials::of(query)?.identifies_retry(verb);
            if let Err(busy) = shared.check_free(ask.ticket.as_deref())
                && !(is_known && busy.owner.as_ref() == Some(&ask.client))
            {
                return Err(busy);
            }
        }
        _ => {
            shared.check_owner(&Credentials::of(query)?.ticket)?;
            // Both cancel a running window, so that invalid ones are refused here.
            if matches!(verb, RequestKind::Detach | RequestKind::Shutdown) {
                decode_object::<EmptyRequest>(query)?;
            }
        }
    }
    Ok(verb)
}

fn unknown(word: &str) -> RequestError {
    let expected = format!("one of {}", RequestKind::ALL.map(RequestKind::name).join(", "));
    let found: String = word.chars().take(50).collect();
    RequestError::expected(ErrorCode::UnknownRequest, "ctl", expected, format!("{found:?}"))
}

/// Returns true if a request has no content.
fn is_empty(query: &Query) -> bool {
    decode_object::<EmptyRequest>(query).is_ok()
}
