//! Errors of messages.

/// Error of a message that cannot be decoded, encoded or used: its place, the expected and the found value.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: expected {expected}, found {found}")]
pub struct MessageError {
    /// Type and path of the field, such as `ballast_msgs/msg/BodyMotion.knots[2].pose`.
    pub place: String,
    /// Values that are accepted.
    pub expected: String,
    /// Value of the message.
    pub found: String,
}

impl MessageError {
    /// Creates an error at a place.
    pub fn new(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self { place: place.into(), expected: expected.into(), found: found.to_string() }
    }

    /// Prefixes the place with the enclosing field or type.
    pub(crate) fn inside(mut self, whole: &str) -> Self {
        let joint =
            if self.place.is_empty() || self.place.starts_with(['[', ',']) { "" } else { "." };
        self.place = format!("{whole}{joint}{}", self.place);
        self
    }
}

// Errors of serde have no place; the caller adds it.
impl serde::de::Error for MessageError {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self::new("", "a value of this type", message)
    }

    fn invalid_value(found: serde::de::Unexpected, expected: &dyn serde::de::Expected) -> Self {
        Self::new("", expected.to_string(), found)
    }

    fn invalid_type(found: serde::de::Unexpected, expected: &dyn serde::de::Expected) -> Self {
        Self::new("", expected.to_string(), found)
    }
}

impl serde::ser::Error for MessageError {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self::new("", "a value that can be written", message)
    }
}
