//! Why a request was not accepted: a code for programs, a sentence for people, numbers where they help.

use crate::MessageError;
use ballast::component::Refusal;
use ballast::error::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A request that was refused. The state is untouched.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, thiserror::Error)]
#[error("{message}")]
pub struct RequestError {
    pub code: ErrorCode,
    pub message: String,
    /// The number that a window must have now.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub expected_seq: Option<u64>,
    /// Simulated time, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub now_ns: Option<u64>,
    /// Who drives, and for how long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub since_ms: Option<u64>,
    /// The message in parts, where it has any.
    #[serde(flatten)]
    pub details: Option<Box<ErrorDetails>>,
}

/// What is wrong with a request.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ErrorDetails {
    /// The field, or the body whose input it is.
    pub place: String,
    pub expected: String,
    pub found: String,
    /// The times next to it at which a window may end, ns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nearest_ns: Option<[u64; 2]>,
}

/// What kind of refusal it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ErrorCode {
    /// The bytes are no such message.
    MessageError,
    /// The message is larger than this component accepts.
    TooLarge,
    /// No request of this name.
    UnknownRequest,
    /// More requests wait than this component keeps.
    TooManyRequests,
    /// Someone else drives.
    Busy,
    /// The bed is being prepared; there is nothing to ask about yet.
    Preparing,
    /// The bed has not been prepared yet: `init` does it.
    Unconfigured,
    /// A parameter that cannot be used.
    ParameterInvalid,
    /// Time runs by itself; stop it first.
    RealTimeActive,
    /// The bed could not be prepared.
    InitFailed,
    /// The client has no liveliness token, so its loss would not be noticed.
    NoLivelinessToken,
    /// The ticket is not that of the owner.
    NotOwner,
    /// This component has another run.
    WrongRun,
    /// Neither the next window nor the last one again.
    OutOfSequence,
    /// No state was kept under this name.
    UnknownState,
    /// No more states can be kept.
    TooManyStates,
    /// The window was taken back, as if it had never been asked for: nobody waited for it any more.
    Cancelled,
    /// Something failed inside; only restore, reset and detach are possible.
    ErrorState,
    /// The component is being shut down.
    ShuttingDown,
    /// No step of this grid.
    TimeGrid,
    InputGap,
    InputJump,
    InputInvalid,
    UnknownBody,
    NothingToRedo,
    StateInvalid,
}

/// The word in messages.
impl std::fmt::Display for ErrorCode {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.serialize(f)
    }
}

impl RequestError {
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

    /// The usual form: what, where, expected and found.
    pub fn expected(
        code: ErrorCode,
        place: &str,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        let (expected, found) = (expected.to_string(), found.to_string());
        let message = format!("{place}: expected {expected}, found {found}");
        let place = place.to_string();
        let finding = ErrorDetails { place, expected, found, nearest_ns: None };
        Self { details: Some(Box::new(finding)), ..Self::new(code, message) }
    }

    /// A ticket that is not that of the owner, or while there is none.
    pub fn not_owner(ticket: &str, owner: Option<&str>) -> Self {
        let expected = match owner {
            Some(owner) => format!("that of the owner, {owner:?}"),
            None => "that of an owner; nobody drives, attach first".to_string(),
        };
        let found = if ticket.is_empty() { "none" } else { "another" };
        let fault = Self::expected(ErrorCode::NotOwner, "ticket", expected, found);
        Self { owner: owner.map(String::from), ..fault }
    }
}

/// What a panic panic_message.
pub fn panic_message(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    format!("the program failed inside: {}", text.unwrap_or("no reason given"))
}

impl From<MessageError> for RequestError {
    fn from(e: MessageError) -> Self {
        Self::expected(ErrorCode::MessageError, &e.place, e.expected, e.found)
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
        let finding = match refusal {
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
            Refusal::Core(error) => parts(error),
            Refusal::NothingToRedo | Refusal::Cancelled => None,
        };
        Self { details: finding.map(Box::new), ..Self::new(code, message) }
    }
}

/// The parts of what the core says.
fn parts(error: Error) -> Option<ErrorDetails> {
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
