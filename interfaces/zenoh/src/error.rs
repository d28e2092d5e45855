//! Errors of clients.

use ballast_protocol::MessageError;
use ballast_protocol::lockstep::RequestError;

/// Error of a request to a component.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The name of the component is invalid.
    #[error("key: expected {expected}, found {found:?}")]
    InvalidName {
        /// Values that are accepted.
        expected: &'static str,
        /// Value found.
        found: String,
    },
    /// The transport failed, or its configuration is invalid.
    #[error("{place}: {reason}")]
    Transport {
        /// Endpoint, file or setting.
        place: String,
        /// Message of the transport.
        reason: String,
    },
    /// The component has refused the request; nothing has changed there.
    #[error(transparent)]
    Rejected(#[from] RequestError),
    /// The component is alive, but has not replied within the timeout. Repeating the request is safe.
    #[error(
        "{request}: no reply within {waited_s:.1} s, although {component} is alive: {activity}"
    )]
    Timeout {
        /// Name of the request.
        request: String,
        /// Name of the component.
        component: String,
        /// Time since the request, s.
        waited_s: f64,
        /// Last known activity of the component.
        activity: String,
    },
    /// The component is disconnected: it has no liveliness token and publishes no heartbeat.
    #[error("{request}: {component} is disconnected: no heartbeat for {silent_s:.1} s{hint}")]
    Disconnected {
        /// Name of the request.
        request: String,
        /// Name of the component.
        component: String,
        /// Time without heartbeat, s.
        silent_s: f64,
        /// Hint at the cause; may be empty.
        hint: &'static str,
    },
    /// The caller has cancelled the wait; repeating the request is safe, as after [`Error::Timeout`].
    #[error("{request}: cancelled after {waited_s:.1} s; {component} continues with it")]
    Cancelled {
        /// Name of the request.
        request: String,
        /// Name of the component.
        component: String,
        /// Time since the request, s.
        waited_s: f64,
    },
    /// Another client has changed the run, or it has lost windows that cannot be repeated.
    ///
    /// Every call that continues the run fails until a state is restored or a new run is started.
    #[error("{component}, run {run_id}: expected {expected}, found {found}")]
    Diverged {
        /// Name of the component.
        component: String,
        /// Identifier of the run.
        run_id: String,
        /// Values that are accepted.
        expected: String,
        /// Value found.
        found: String,
    },
    /// The reply cannot be decoded.
    #[error("reply to {request}: {what}")]
    BadReply {
        /// Name of the request.
        request: String,
        /// Description of the error.
        what: String,
    },
}

impl Error {
    pub(crate) fn transport(place: impl Into<String>, reason: impl ToString) -> Self {
        Self::Transport { place: place.into(), reason: without_sources(&reason.to_string()) }
    }

    /// Creates the error of an undecodable reply.
    pub fn bad_reply(request: &str, what: impl ToString) -> Self {
        Self::BadReply { request: request.into(), what: what.to_string() }
    }

    /// Creates the error of a request that cannot be encoded and was not sent.
    pub(crate) fn unencodable(request: &str, fault: MessageError) -> Self {
        RequestError { message: format!("{request}: {fault}"), ..fault.into() }.into()
    }

    /// Returns the code of the error; for a rejected request, the code of the component.
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

    /// Returns the error of the component, if it rejected the request.
    pub fn request_error(&self) -> Option<&RequestError> {
        match self {
            Self::Rejected(fault) => Some(fault),
            _ => None,
        }
    }
}

/// Removes the source locations of Zenoh, `at FILE.rs:LINE.`, from a message.
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
