//! Answers, and how they are sent.

use crate::wire::cdr;
use ballast_protocol::lockstep::RequestError;
use ballast_protocol::messages::Message;
use ballast_protocol::to_cdr;
use serde::Serialize;
use zenoh::Wait;
use zenoh::bytes::Encoding;
use zenoh::query::Query;

/// Bytes of an answer, and how they are to be read.
#[derive(Debug, Clone)]
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
    pub fn message<T: Message>(message: &T, is_cdr: bool) -> Result<Self, RequestError> {
        if !is_cdr {
            return Ok(Self::json(message));
        }
        Ok(Self { bytes: to_cdr(message)?, encoding: cdr::<T>() })
    }
}

/// Sends the answer under `key`. A caller that is gone meanwhile asks again when it is back.
pub(super) fn send(query: &Query, key: String, result: Result<Answer, RequestError>) {
    let _ = match result {
        Ok(answer) => query.reply(key, answer.bytes).encoding(answer.encoding).express(true).wait(),
        Err(fault) => {
            let text = serde_json::to_string(&fault).unwrap_or_default();
            query.reply_err(text).encoding(Encoding::APPLICATION_JSON).wait()
        }
    };
}
