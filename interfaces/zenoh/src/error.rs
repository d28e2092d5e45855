//! What a client of a component is told when a request is not answered as it should be.

use ballast_protocol::MessageError;
use ballast_protocol::lockstep::RequestError;

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A component's name.
    #[error("key: expected {expected}, found {found:?}")]
    InvalidName { expected: &'static str, found: String },
    /// How to reach each other.
    #[error("{place}: {reason}")]
    Transport { place: String, reason: String },
    /// The component has refused the request; nothing has changed there.
    #[error(transparent)]
    Rejected(#[from] RequestError),
    /// The component is there, but has not answered within the time allowed. The request may be sent again:
    /// what was done is not done twice.
    #[error("{request}: no answer within {waited_s:.1} s, though {component} is there: {doing}")]
    Timeout { request: String, component: String, waited_s: f64, doing: String },
    /// The component is not there: neither alive nor telling what it does.
    #[error("{request}: {component} is not there: not alive, and silent for {silent_s:.1} s{hint}")]
    Disconnected { request: String, component: String, silent_s: f64, hint: &'static str },
    /// The caller has given up waiting; the request may be sent again, as after [`Error::Timeout`].
    #[error("{request}: given up after {waited_s:.1} s; {component} goes on with it")]
    Cancelled { request: String, component: String, waited_s: f64 },
    /// The run was continued by someone else, or lost more than can be computed again: so says every call that would go
    /// on from where it was left, until a kept state is restored or a run begun.
    #[error("{component}, run {run_id}: expected {expected}, found {found}")]
    Diverged { component: String, run_id: String, expected: String, found: String },
    /// An answer that is none.
    #[error("answer to {request}: {what}")]
    BadReply { request: String, what: String },
}

impl Error {
    pub(crate) fn link(place: impl Into<String>, reason: impl ToString) -> Self {
        Self::Transport { place: place.into(), reason: without_sources(&reason.to_string()) }
    }

    /// An answer that cannot be used.
    pub fn answer(request: &str, what: impl ToString) -> Self {
        Self::BadReply { request: request.into(), what: what.to_string() }
    }

    /// A request of one's own that cannot be written: nothing was asked, as if it had been refused.
    pub(crate) fn unwritten(request: &str, fault: MessageError) -> Self {
        RequestError { message: format!("{request}: {fault}"), ..fault.into() }.into()
    }

    /// Short name of the kind, as codes of refusals are.
    pub fn code(&self) -> String {
        match self {
            Self::InvalidName { .. } => "invalid_name".into(),
            Self::Transport { .. } => "transport".into(),
            Self::Rejected(fault) => fault.code.to_string(),
            Self::Timeout { .. } => "timeout".into(),
            Self::Disconnected { .. } => "disconnected".into(),
            Self::Cancelled { .. } => "cancelled".into(),
            Self::Diverged { .. } => "diverged".into(),
            Self::BadReply { .. } => "bad_reply".into(),
        }
    }

    /// The component's refusal, if it is one.
    pub fn request_error(&self) -> Option<&RequestError> {
        match self {
            Self::Rejected(fault) => Some(fault),
            _ => None,
        }
    }
}

/// A reason without the places in Zenoh's source code, which it names as `at FILE.rs:LINE.`.
fn without_sources(text: &str) -> String {
    let mut parts = text.split(" at ");
    let mut reason = parts.next().unwrap_or_default().to_string();
    for part in parts {
        let (word, rest) = part.split_once(' ').unwrap_or((part, ""));
        match word.contains(".rs:") {
            true if rest.is_empty() => {}
            true => reason += &format!(" {rest}"),
            false => reason += &format!(" at {part}"),
        }
    }
    reason
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_name_no_source_code() {
        for (zenoh, ours) in [
            ("no such name at /a/zenoh-1/src/lib.rs:62.", "no such name"),
            ("in use at /a/l.rs:1. - Caused by: bad at /a/m.rs:22.", "in use - Caused by: bad"),
            ("found at noon", "found at noon"),
        ] {
            assert_eq!(without_sources(zenoh), ours);
        }
    }
}
