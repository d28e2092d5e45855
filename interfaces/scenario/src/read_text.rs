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
    String::from_utf8(bytes).map_err(|e| {
        let valid = &e.as_bytes()[..e.utf8_error().valid_up_to()];
        ReadError::NotUtf8(1 + valid.iter().filter(|b| **b == b'\n').count())
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
}
