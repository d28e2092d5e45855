//! Queued requests and their credentials.

use super::status::QueueSlot;
use crate::keys::last_segment;
use crate::random;
use ballast_protocol::from_json_named;
use ballast_protocol::lockstep::{ErrorCode, RequestError, RequestKind};
use zenoh::query::Query;

/// Maximum length of ticket and request number together, bytes.
const MAX_CREDENTIALS_BYTES: usize = 200;
/// Minimum length of a request number that cannot be guessed.
const MIN_SECRET_LENGTH: usize = 16;

/// Credentials of a request: the owner's ticket, and a number chosen by the client that identifies a retry.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Credentials {
    pub ticket: String,
    pub number: String,
}

impl Credentials {
    /// Reads the attachment `TICKET` or `TICKET;NUMBER`, or the parameters `ticket` and `number`.
    pub fn of(query: &Query) -> Result<Self, RequestError> {
        let size = query.attachment().map_or(0, zenoh::bytes::ZBytes::len);
        if size > MAX_CREDENTIALS_BYTES || query.parameters().as_str().len() > MAX_CREDENTIALS_BYTES
        {
            let expected = format!("at most {MAX_CREDENTIALS_BYTES} bytes");
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

    /// Returns true if the number may identify a retry.
    ///
    /// The reply to `attach` is the ticket, so that its number must be a secret.
    pub fn identifies_retry(&self, kind: RequestKind) -> bool {
        let min_length = if kind == RequestKind::Attach { MIN_SECRET_LENGTH } else { 1 };
        self.number.len() >= min_length
    }
}

/// Request in the queue of the computing thread.
pub(super) struct QueuedRequest {
    pub query: Query,
    pub kind: RequestKind,
    pub credentials: Credentials,
    pub slot: QueueSlot,
}

/// Event that wakes the computing thread.
pub(super) enum ServerEvent {
    Request(Box<QueuedRequest>),
    /// Motion samples are queued.
    Samples,
}

/// Decodes the payload as a JSON object; no payload is an empty object.
pub(super) fn decode_object<T: serde::de::DeserializeOwned>(
    query: &Query,
) -> Result<T, RequestError> {
    let bytes = query.payload().map(|p| p.to_bytes()).filter(|bytes| !bytes.is_empty());
    let bytes = bytes.unwrap_or_else(|| b"{}".as_slice().into());
    let word = last_segment(query.key_expr().as_str());
    Ok(from_json_named(word, &bytes)?)
}

/// Returns the error of a request that arrives while the component shuts down.
pub(super) fn shutting_down() -> RequestError {
    RequestError::new(ErrorCode::ShuttingDown, "the component is shutting down")
}

/// Returns a new ticket or run identifier.
pub(super) fn new_ticket() -> Result<String, RequestError> {
    random().map_err(|e| RequestError::new(ErrorCode::ErrorState, e.to_string()))
}
