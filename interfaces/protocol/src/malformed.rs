//! What is wrong with a message.

/// A message that cannot be read, written or used: where in it, what was expected, what was found.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: expected {expected}, found {found}")]
pub struct MessageError {
    /// Type and path of the field, `ballast_msgs/msg/BodyMotion.knots[2].pose`.
    pub place: String,
    pub expected: String,
    pub found: String,
}

impl MessageError {
    pub fn new(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self { place: place.into(), expected: expected.into(), found: found.to_string() }
    }

    /// Puts what the place is part of in front of it.
    pub(crate) fn inside(mut self, whole: &str) -> Self {
        let joint =
            if self.place.is_empty() || self.place.starts_with(['[', ',']) { "" } else { "." };
        self.place = format!("{whole}{joint}{}", self.place);
        self
    }
}

/// How serde's own complaints arrive: without a place, which the caller adds.
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
