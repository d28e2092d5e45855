//! Cache of replies by request number: a retry gets the same reply and has no second effect.
//!
//! Windows are not cached here; lockstep identifies them by their content.

use super::reply::EncodedReply;
use super::request::Credentials;
use ballast_protocol::lockstep::{RequestError, RequestKind};
use std::collections::VecDeque;
use zenoh::query::Query;

/// Maximum number of cached replies; a client sends one request at a time.
const MAX_REPLIES: usize = 16;

/// Identity of a request: kind, credentials and content.
#[derive(PartialEq)]
pub(super) struct RequestId {
    verb: RequestKind,
    credentials: Credentials,
    content: Vec<u8>,
}

impl RequestId {
    /// Returns the identity of a request with a number.
    pub fn of(verb: RequestKind, credentials: &Credentials, query: &Query) -> Option<Self> {
        let content = || query.payload().map_or(Vec::new(), |p| p.to_bytes().into_owned());
        credentials.identifies_retry(verb).then(|| Self {
            verb,
            credentials: credentials.clone(),
            content: content(),
        })
    }
}

/// Replies to recent requests.
#[derive(Default)]
pub(super) struct ReplyCache {
    replies: VecDeque<(RequestId, Result<EncodedReply, RequestError>)>,
}

impl ReplyCache {
    pub fn find(&self, asked: Option<&RequestId>) -> Option<Result<EncodedReply, RequestError>> {
        let asked = asked?;
        let known = self.replies.iter().find(|(known, _)| known == asked);
        known.map(|(_, answer)| answer.clone())
    }

    pub fn insert(
        &mut self,
        asked: Option<RequestId>,
        answer: &Result<EncodedReply, RequestError>,
    ) {
        let Some(asked) = asked else { return };
        if matches!(asked.verb, RequestKind::Attach | RequestKind::Detach) && answer.is_ok() {
            self.clear();
        }
        // A former owner is refused on admission, and a refused client takes no entry.
        if asked.verb == RequestKind::Detach || asked.verb == RequestKind::Attach && answer.is_err()
        {
            return;
        }
        if self.replies.len() >= MAX_REPLIES {
            self.replies.pop_front();
        }
        self.replies.push_back((asked, answer.clone()));
    }

    /// Removes all replies, which do not hold for another owner.
    pub fn clear(&mut self) {
        self.replies.clear();
    }
}
