//! Messages as JSON: the control plane, scripts, and people.
//!
//! Enums are words, hashes are hexadecimal, a number that is not finite is `null`.

use crate::Malformed;
use crate::messages::Message;

/// A message as JSON text.
///
/// # Errors
/// None for messages of this crate; the signature is that of [`crate::to_cdr`].
pub fn to_json<T: Message>(message: &T) -> Result<String, Malformed> {
    serde_json::to_string(message)
        .map_err(|e| Malformed::new(T::NAME, "a value that can be written", e))
}

/// A message from JSON text.
///
/// # Errors
/// What is no message of this type, with the path of the field, and line and column.
pub fn from_json<T: Message>(text: &[u8]) -> Result<T, Malformed> {
    let mut reader = serde_json::Deserializer::from_slice(text);
    let message: T = serde_path_to_error::deserialize(&mut reader).map_err(|e| {
        let path = e.path().to_string();
        let place = if path == "." { String::new() } else { path };
        Malformed::new(place, "a value of this type", e.inner()).inside(T::NAME)
    })?;
    reader.end().map_err(|e| Malformed::new(T::NAME, "the end of the text", e))?;
    Ok(message)
}
