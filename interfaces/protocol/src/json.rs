//! Messages as JSON: the control plane, scripts, and people.
//!
//! Enums are words, hashes are hexadecimal, a number that is not finite is `null`.

use crate::Malformed;
use crate::messages::Message;
use serde::de::DeserializeOwned;

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
    from_json_called(T::NAME, text)
}

/// What is no message of its own, such as a request of the control plane, from JSON text; `name` begins the place of what is
/// wrong.
///
/// # Errors
/// As [`from_json`].
pub fn from_json_called<T: DeserializeOwned>(name: &str, text: &[u8]) -> Result<T, Malformed> {
    let mut reader = serde_json::Deserializer::from_slice(text);
    let message: T = serde_path_to_error::deserialize(&mut reader).map_err(|e| {
        // `.` is the whole; `?` is where the text ends within a field.
        let path = e.path().to_string();
        let place = path.trim_end_matches('?').trim_end_matches('.');
        in_parts(place.to_string(), e.inner()).inside(name)
    })?;
    reader.end().map_err(|e| Malformed::new(name, "the end of the text", e))?;
    Ok(message)
}

/// What serde says in one sentence, as expected and found.
fn in_parts(place: String, error: &serde_json::Error) -> Malformed {
    let text = error.to_string();
    let (said, at) =
        text.rsplit_once(" at line ").map_or((&text[..], None), |(s, at)| (s, Some(at)));
    let kinds = [
        "invalid type: ",
        "invalid value: ",
        "invalid length ",
        "unknown field ",
        "unknown variant ",
    ];
    let differs = kinds.iter().find_map(|kind| said.strip_prefix(kind)?.rsplit_once(", expected "));
    let (expected, found) = match (said.strip_prefix("missing field "), differs) {
        (Some(field), _) => (format!("the field {field}"), "none"),
        (_, Some((found, expected))) => (in_words(expected).to_string(), found),
        _ if error.is_data() => ("a value of this type".to_string(), said),
        _ => ("JSON".to_string(), said),
    };
    let found = match at.and_then(|at| at.split_once(" column ")) {
        Some((line, column)) => format!("{found} (line {line}, column {column})"),
        None => found.to_string(),
    };
    Malformed::new(place, expected, found)
}

/// Types of numbers in words that partners in other languages know.
fn in_words(expected: &str) -> &str {
    match expected {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number from 0 on",
        "i8" | "i16" | "i32" | "i64" => "a whole number",
        "f32" | "f64" => "a number",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::{Attach, SetParameters};

    #[test]
    fn what_is_wrong_is_told_in_parts() {
        let attach = |text: &str| {
            from_json_called::<Attach>("attach", text.as_bytes()).unwrap_err().to_string()
        };
        let param = |text: &str| {
            from_json_called::<SetParameters>("param", text.as_bytes()).unwrap_err().to_string()
        };
        for (told, expected) in [
            (attach("{}"), "attach: expected the field `client`, found none (line 1, column 2)"),
            (
                attach(r#"{"client": 3}"#),
                "attach.client: expected a string, found integer `3` (line 1, column 12)",
            ),
            (
                attach(r#"{"clint": "a"}"#),
                "attach.clint: expected one of `client`, `resume`, `ticket`, found `clint` (line 1, column 8)",
            ),
            (
                attach("[]"),
                "attach: expected struct Attach with 3 elements, found 0 (line 1, column 2)",
            ),
            (
                param(r#"{"iterations": -1}"#),
                "param.iterations: expected a whole number from 0 on, found integer `-1` (line 1, column 17)",
            ),
            (
                param(r#"{"tolerance": "1e-4"}"#),
                "param.tolerance: expected a number, found string \"1e-4\" (line 1, column 20)",
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
            assert_eq!(told, expected);
        }
    }
}
