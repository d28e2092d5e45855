//! Encoded replies.

use crate::wire::cdr;
use ballast_protocol::lockstep::RequestError;
use ballast_protocol::messages::Message;
use ballast_protocol::to_cdr;
use serde::Serialize;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::query::Query;

/// Bytes of a reply and their encoding.
#[derive(Debug, Clone)]
pub(super) struct EncodedReply {
    bytes: Vec<u8>,
    encoding: Encoding,
}

impl EncodedReply {
    pub fn json(value: &impl Serialize) -> Self {
        Self::text(serde_json::to_string(value).unwrap_or_default())
    }

    pub fn text(text: String) -> Self {
        Self { bytes: text.into_bytes(), encoding: Encoding::APPLICATION_JSON }
    }

    /// Encodes a message like its request, in CDR or JSON.
    pub fn message<T: Message>(message: &T, is_cdr: bool) -> Result<Self, RequestError> {
        if !is_cdr {
            return Ok(Self::json(message));
        }
        Ok(Self { bytes: to_cdr(message)?, encoding: cdr::<T>() })
    }
}

/// Sends a reply under `key`. A client that has disconnected repeats its request later.
pub(super) fn send(query: &Query, key: String, result: Result<EncodedReply, RequestError>) {
    let _ = match result {
        Ok(answer) => query.reply(key, answer.bytes).encoding(answer.encoding).express(true).wait(),
        Err(fault) => {
            let text = serde_json::to_string(&fault).unwrap_or_default();
            query.reply_err(text).encoding(Encoding::APPLICATION_JSON).wait()
        }
    };
}
