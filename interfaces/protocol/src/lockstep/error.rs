//! Errors of requests: a code for programs, a message for people, and the numbers that help to correct the request.

use crate::MessageError;
use ballast::component::Refusal;
use ballast::error::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum length of the name of a client or a saved state, bytes.
pub const MAX_NAME_BYTES: usize = 200;

/// Error of a request that was refused; the state is unchanged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{message}")]
pub struct RequestError {
    /// Kind of the error.
    pub code: ErrorCode,
    /// Sentence for people.
    pub message: String,
    /// Number that the window must have.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_seq: Option<u64>,
    /// Simulated time of the component, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub now_ns: Option<u64>,
    /// Name of the owner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<String>,
    /// Duration of the ownership, wall ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub since_ms: Option<u64>,
    /// Parts of the message, for messages of the form `place: expected, found`.
    #[serde(flatten)]
    pub details: Option<Box<ErrorDetails>>,
}

/// Parts of an error message: place, expected and found.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorDetails {
    /// Name of the field, or of the body whose input is wrong.
    pub place: String,
    /// Values that are accepted.
    pub expected: String,
    /// Value of the request.
    pub found: String,
    /// Nearest times before and after at which a window may end, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nearest_ns: Option<[u64; 2]>,
}

/// Kind of a request error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ErrorCode {
    /// The payload cannot be decoded as this request.
    Malformed,
    /// The payload exceeds the size limit of the component.
    TooLarge,
    /// No request has this name.
    UnknownRequest,
    /// The queue of the component is full, or requests arrive too fast.
    TooManyRequests,
    /// Another client is the owner.
    Busy,
    /// The bed is being prepared.
    Preparing,
    /// No bed has been prepared; request `init` first.
    Unconfigured,
    /// A parameter has an invalid value.
    ParameterInvalid,
    /// The real-time mode is active; stop it first.
    RealTimeActive,
    /// The bed could not be prepared.
    InitFailed,
    /// The client has no liveliness token, so its disconnection would not be noticed.
    NoLivelinessToken,
    /// The ticket is not that of the owner.
    NotOwner,
    /// The component has another run.
    WrongRun,
    /// The window is neither the next one nor a repetition of the last one.
    OutOfSequence,
    /// No saved state has this name.
    UnknownState,
    /// The store of saved states is full.
    TooManyStates,
    /// The window was cancelled and rolled back, because no client waited for it.
    Cancelled,
    /// An internal error has occurred; only `restore`, `reset` and `detach` are possible.
    ErrorState,
    /// The component is shutting down.
    ShuttingDown,
    /// A time is not on the grid of time steps.
    TimeGrid,
    /// A motion or load does not cover the window.
    InputGap,
    /// A motion does not continue the previous one.
    InputJump,
    /// A motion or load has an invalid value.
    InputInvalid,
    /// No driven body has this name.
    UnknownBody,
    /// No window has been computed that could be redone.
    NothingToRedo,
    /// The state does not fit the model.
    StateInvalid,
}

impl std::fmt::Display for ErrorCode {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.serialize(f)
    }
}

impl RequestError {
    /// Creates an error without details.
    pub fn new(code: ErrorCode, message: impl Into<String>) -> Self {
        Self {
            code,
            message: message.into(),
            expected_seq: None,
            now_ns: None,
            owner: None,
            since_ms: None,
            details: None,
        }
    }

    /// Creates an error of the form `place: expected, found`.
    pub fn expected(
        code: ErrorCode,
        place: &str,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        let [expected, found] = [expected.to_string(), found.to_string()];
        let message = format!("{place}: expected {expected}, found {found}");
        let details = ErrorDetails { place: place.into(), expected, found, nearest_ns: None };
        Self { details: Some(Box::new(details)), ..Self::new(code, message) }
    }

    /// Creates the error of a ticket that is not that of the owner.
    pub fn not_owner(ticket: &str, owner: Option<&str>) -> Self {
        let expected = match owner {
            Some(owner) => format!("that of the owner, {owner:?}"),
            None => "that of an owner; there is none, attach first".to_string(),
        };
        let found = if ticket.is_empty() { "none" } else { "another" };
        let error = Self::expected(ErrorCode::NotOwner, "ticket", expected, found);
        Self { owner: owner.map(String::from), ..error }
    }

    /// Creates the error of a client that attaches while `owner` is attached; `remark` ends the message.
    pub fn busy(owner: &str, since_ms: u64, remark: &str) -> Self {
        let seconds = since_ms as f64 * 1e-3;
        let message = format!("owned by {owner:?} for {seconds:.1} s{remark}");
        let error = Self::new(ErrorCode::Busy, message);
        Self { owner: Some(owner.into()), since_ms: Some(since_ms), ..error }
    }
}

/// Returns the message of a panic payload.
pub fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    format!("internal error: {}", text.unwrap_or("no message"))
}

/// Returns an error unless `name` can name a client or a saved state.
pub(super) fn check_name(place: &str, name: &str) -> Result<(), RequestError> {
    let is_valid = !name.is_empty()
        && name.len() <= MAX_NAME_BYTES
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b));
    if is_valid {
        return Ok(());
    }
    let expected = format!("1 to {MAX_NAME_BYTES} letters, digits, '-', '_' or '.'");
    let found: String = name.chars().take(50).collect();
    Err(RequestError::expected(ErrorCode::Malformed, place, expected, format!("{found:?}")))
}

impl From<MessageError> for RequestError {
    fn from(e: MessageError) -> Self {
        Self::expected(ErrorCode::Malformed, &e.place, e.expected, e.found)
    }
}

impl From<Refusal> for RequestError {
    fn from(refusal: Refusal) -> Self {
        let code = match refusal {
            Refusal::Time { .. } => ErrorCode::TimeGrid,
            Refusal::Gap { .. } => ErrorCode::InputGap,
            Refusal::Jump { .. } => ErrorCode::InputJump,
            Refusal::Input { .. } => ErrorCode::InputInvalid,
            Refusal::UnknownBody { .. } => ErrorCode::UnknownBody,
            Refusal::NothingToRedo => ErrorCode::NothingToRedo,
            Refusal::Cancelled => ErrorCode::Cancelled,
            Refusal::Core(_) => ErrorCode::StateInvalid,
        };
        let message = refusal.to_string();
        let details = match refusal {
            Refusal::Time { now_ns, step_ns, nearest_ns, found_ns } => Some(ErrorDetails {
                place: "t1_ns".into(),
                expected: format!("a whole number of steps of {step_ns} ns after {now_ns} ns"),
                found: format!("{found_ns} ns"),
                nearest_ns: Some(nearest_ns),
            }),
            Refusal::Gap { body, expected, found }
            | Refusal::Jump { body, expected, found }
            | Refusal::Input { body, expected, found } => {
                Some(ErrorDetails { place: body, expected, found, nearest_ns: None })
            }
            Refusal::UnknownBody { known, found } => Some(ErrorDetails {
                place: "body".into(),
                expected: format!("one of {known:?}"),
                found,
                nearest_ns: None,
            }),
            Refusal::Core(error) => core_details(error),
            Refusal::NothingToRedo | Refusal::Cancelled => None,
        };
        Self { details: details.map(Box::new), ..Self::new(code, message) }
    }
}

/// Returns the parts of an error of the core.
fn core_details(error: Error) -> Option<ErrorDetails> {
    let (place, expected, found) = match error {
        Error::Geometry { expected, found } => ("polyhedron".into(), expected.into(), found),
        Error::Model { place, expected, found }
        | Error::State { place, expected, found }
        | Error::Input { place, expected, found }
        | Error::Step { place, expected, found, .. } => (place, expected, found),
        Error::Stopped(_) => return None,
    };
    Some(ErrorDetails { place, expected, found, nearest_ns: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_of_the_core_keeps_its_code() {
        let text = String::new;
        for refusal in [
            Refusal::Time { now_ns: 0, step_ns: 2, nearest_ns: [2, 4], found_ns: 3 },
            Refusal::Gap { body: text(), expected: text(), found: text() },
            Refusal::Jump { body: text(), expected: text(), found: text() },
            Refusal::Input { body: text(), expected: text(), found: text() },
            Refusal::UnknownBody { known: Vec::new(), found: text() },
            Refusal::NothingToRedo,
            Refusal::Cancelled,
            Refusal::Core(Error::Geometry { expected: "", found: text() }),
        ] {
            let code = refusal.code();
            assert_eq!(RequestError::from(refusal).code.to_string(), code);
        }
    }
}
