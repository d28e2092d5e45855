//! JSON encoding of messages.
//!
//! Enumerations are words, hashes are hexadecimal, and non-finite numbers are `null`.

use crate::MessageError;
use crate::messages::Message;
use serde::de::DeserializeOwned;

/// Encodes a message as JSON text.
///
/// # Errors
/// None for messages of this crate; the signature is that of [`crate::to_cdr`].
pub fn to_json<T: Message>(message: &T) -> Result<String, MessageError> {
    serde_json::to_string(message)
        .map_err(|e| MessageError::new(T::NAME, "a value that can be written", e))
}

/// Decodes a message from JSON text.
///
/// # Errors
/// Text that is no message of this type; the error names the field, line and column.
pub fn from_json<T: Message>(text: &[u8]) -> Result<T, MessageError> {
    from_json_named(T::NAME, text)
}

/// Decodes any type, such as a request of the control plane, from JSON text; `name` begins the place of an error.
///
/// # Errors
/// Text that is no value of this type, see [`from_json`].
pub fn from_json_named<T: DeserializeOwned>(name: &str, text: &[u8]) -> Result<T, MessageError> {
    // Serde also accepts lists of values by position, which the schema forbids.
    let first = text.iter().find(|byte| !byte.is_ascii_whitespace());
    if first == Some(&b'[') {
        let found: String = String::from_utf8_lossy(text).trim_start().chars().take(20).collect();
        return Err(MessageError::new(name, "a JSON object", found));
    }
    let mut reader = serde_json::Deserializer::from_slice(text);
    let message: T = serde_path_to_error::deserialize(&mut reader).map_err(|e| {
        // `.` is the whole; `?` is where the text ends within a field.
        let path = e.path().to_string();
        let place = path.trim_end_matches('?').trim_end_matches('.');
        split_error(place.to_string(), e.inner(), text).inside(name)
    })?;
    reader.end().map_err(|e| MessageError::new(name, "the end of the text", e))?;
    Ok(message)
}

/// Splits an error of serde about `text` into place, expected and found.
fn split_error(place: String, error: &serde_json::Error, text: &[u8]) -> MessageError {
    let sentence = error.to_string();
    let (message, at) =
        sentence.rsplit_once(" at line ").map_or((&sentence[..], None), |(s, at)| (s, Some(at)));
    let kinds = [
        "invalid type: ",
        "invalid value: ",
        "invalid length ",
        "unknown field ",
        "unknown variant ",
    ];
    let differs =
        kinds.iter().find_map(|kind| message.strip_prefix(kind)?.rsplit_once(", expected "));
    let (expected, found) = match (message.strip_prefix("missing field "), differs) {
        (Some(field), _) => (format!("the field {field}"), "none".to_string()),
        (_, Some((found, expected))) => (describe_type(expected), found.to_string()),
        _ if error.is_data() => ("a value of this type".to_string(), message.to_string()),
        _ => match token_at(text, error.line(), error.column()) {
            // Programs write these for numbers that JSON cannot express.
            word if message == "number out of range" || is_non_finite_literal(&word) => {
                ("a finite number".to_string(), word)
            }
            word if message == "expected value" && !word.is_empty() => ("JSON".to_string(), word),
            _ => ("JSON".to_string(), message.to_string()),
        },
    };
    let found = match at.and_then(|at| at.split_once(" column ")) {
        Some((line, column)) => format!("{found} (line {line}, column {column})"),
        None => found,
    };
    MessageError::new(place, expected, found)
}

/// Returns the token of `text` at or before a line and column (from 1), at most 20 characters.
fn token_at(text: &[u8], line: usize, column: usize) -> String {
    let line = text.split(|byte| *byte == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
    let ends = |byte: &u8| byte.is_ascii_whitespace() || b",:{}[]\"".contains(byte);
    let at = column.saturating_sub(1).min(line.len());
    let before = line[..at].iter().rev().take_while(|byte| !ends(byte)).count();
    let word = line[at - before..].iter().take_while(|byte| !ends(byte)).take(20);
    String::from_utf8_lossy(&word.copied().collect::<Vec<_>>()).into_owned()
}

fn is_non_finite_literal(word: &str) -> bool {
    let word = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
    matches!(&word[..], "nan" | "inf" | "infinity")
}

/// Describes a number type of Rust for users of other languages.
fn describe_type(expected: &str) -> String {
    let whole = |low: i128, high: u128| format!("a whole number from {low} to {high}");
    match expected {
        "u8" => whole(0, u8::MAX.into()),
        "u16" => whole(0, u16::MAX.into()),
        "u32" => whole(0, u32::MAX.into()),
        "u64" | "usize" => whole(0, u64::MAX.into()),
        "i8" => whole(i8::MIN.into(), i8::MAX as u128),
        "i16" => whole(i16::MIN.into(), i16::MAX as u128),
        "i32" => whole(i32::MIN.into(), i32::MAX as u128),
        "i64" => whole(i64::MIN.into(), i64::MAX as u128),
        "f32" | "f64" => "a number".into(),
        other => other.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::{AttachRequest, ParameterUpdate};

    #[test]
    fn what_is_wrong_is_told_split_error() {
        let attach = |text: &str| {
            from_json_named::<AttachRequest>("attach", text.as_bytes()).unwrap_err().to_string()
        };
        let param = |text: &str| {
            from_json_named::<ParameterUpdate>("param", text.as_bytes()).unwrap_err().to_string()
        };
        for (error, expected) in [
            (attach("{}"), "attach: expected the field `client`, found none (line 1, column 2)"),
            (
                attach(r#"{"client": 3}"#),
                "attach.client: expected a string, found integer `3` (line 1, column 12)",
            ),
            (
                attach(r#"{"clint": "a"}"#),
                "attach.clint: expected one of `client`, `run_id`, `ticket`, found `clint` (line 1, column 8)",
            ),
            (attach(r#"["a"]"#), r#"attach: expected a JSON object, found ["a"]"#),
            (
                param(r#"{"max_iterations": -1}"#),
                "param.max_iterations: expected a whole number from 0 to 4294967295, found integer `-1` (line 1, column 21)",
            ),
            (
                param(r#"{"tolerance": "1e-4"}"#),
                "param.tolerance: expected a number, found string \"1e-4\" (line 1, column 20)",
            ),
            (
                param(r#"{"tolerance": -Infinity}"#),
                "param.tolerance: expected a finite number, found -Infinity (line 1, column 16)",
            ),
            (
                param("{\n\"tolerance\": NaN }"),
                "param.tolerance: expected a finite number, found NaN (line 2, column 14)",
            ),
            (
                param(r#"{"tolerance": 1e999}"#),
                "param.tolerance: expected a finite number, found 1e999 (line 1, column 19)",
            ),
            (
                param(r#"{"tolerance": soft}"#),
                "param.tolerance: expected JSON, found soft (line 1, column 15)",
            ),
            (
                param("{} {}"),
                "param: expected the end of the text, found trailing characters at line 1 column 4",
            ),
            (
                param("{\"tolerance\": 1"),
                "param: expected JSON, found EOF while parsing an object (line 1, column 15)",
            ),
        ] {
            assert_eq!(error, expected);
        }
    }
}
