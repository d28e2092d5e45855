//! Bounded reading of text files.

use std::io::Read;

/// Maximum size of a case file or sweep plan, bytes: a thousand times a long one.
pub const MAX_CASE_BYTES: u64 = 8 << 20;

/// Error of reading a text.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// Failure of the source.
    #[error("cannot be read: {0}")]
    Io(std::io::Error),
    /// Text beyond the limit in bytes.
    #[error("larger than {0} bytes; is it the right file?")]
    TooLarge(u64),
    /// Line, from 1, with bytes that are not UTF-8.
    #[error("line {0}: expected text in UTF-8, found other bytes")]
    NotUtf8(usize),
    /// Text in another encoding of Unicode.
    #[error("line 1: expected text in UTF-8, found {0}; save the file as UTF-8")]
    OtherEncoding(&'static str),
}

/// Reads a text of at most `limit` bytes, and no more than that from `source`.
///
/// # Errors
/// See [`ReadError`].
pub fn read_text(source: impl Read, limit: u64) -> Result<String, ReadError> {
    let mut bytes = Vec::new();
    let read = source.take(limit.saturating_add(1)).read_to_end(&mut bytes);
    if read.map_err(ReadError::Io)? as u64 > limit {
        return Err(ReadError::TooLarge(limit));
    }
    if let Some(encoding) = wide_encoding(&bytes) {
        return Err(ReadError::OtherEncoding(encoding));
    }
    String::from_utf8(bytes).map_err(|e| {
        let valid = &e.as_bytes()[..e.utf8_error().valid_up_to()];
        ReadError::NotUtf8(1 + valid.iter().filter(|b| **b == b'\n').count())
    })
}

/// Returns the name of an encoding of several bytes per character, from a byte order mark or the zeros around the first
/// character.
fn wide_encoding(bytes: &[u8]) -> Option<&'static str> {
    let start: Vec<u8> = bytes.iter().copied().take(4).collect();
    let is_zero: Vec<bool> = start.iter().map(|byte| *byte == 0).collect();
    Some(match (&start[..], &is_zero[..]) {
        ([0xff, 0xfe, 0, 0], _) | ([0, 0, 0xfe, 0xff], _) => "UTF-32",
        (_, [false, true, true, true] | [true, true, true, false]) => "UTF-32",
        ([0xff, 0xfe, ..], _) | (_, [false, true, ..]) => "UTF-16 (little-endian)",
        ([0xfe, 0xff, ..], _) | (_, [true, false, ..]) => "UTF-16 (big-endian)",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_texts_and_other_bytes_are_refused() {
        assert_eq!(read_text(&b"0123456789"[..], 10).unwrap(), "0123456789");
        assert!(matches!(read_text(&b"0123456789"[..], 9), Err(ReadError::TooLarge(9))));
        // An endless source is read up to the limit.
        assert!(matches!(read_text(std::io::repeat(b'a'), 9), Err(ReadError::TooLarge(9))));
        assert!(matches!(read_text(&b"a\n\xff"[..], 9), Err(ReadError::NotUtf8(2))));
    }

    #[test]
    fn other_encodings_are_named() {
        let text = "name = \"a\"";
        let units = || text.encode_utf16();
        for (mark, order, name) in [
            (true, u16::to_le_bytes as fn(u16) -> [u8; 2], "UTF-16 (little-endian)"),
            (true, u16::to_be_bytes, "UTF-16 (big-endian)"),
            (false, u16::to_le_bytes, "UTF-16 (little-endian)"),
            (false, u16::to_be_bytes, "UTF-16 (big-endian)"),
        ] {
            let mark = mark.then_some(0xfeff);
            let bytes: Vec<u8> = mark.into_iter().chain(units()).flat_map(order).collect();
            let error = read_text(&bytes[..], 99).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("save the file as UTF-8"), "{error}");
        }
        let bytes: Vec<u8> = text.chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
        assert!(read_text(&bytes[..], 99).unwrap_err().to_string().contains("UTF-32"));
        assert_eq!(read_text("\u{feff}a".as_bytes(), 9).unwrap(), "\u{feff}a");
    }
}
