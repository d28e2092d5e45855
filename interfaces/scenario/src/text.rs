//! The text of a file, as far as it may go.

use std::io::Read;

/// Most bytes of a case file, or of a plan of a sweep: a thousand times a long one.
pub const LONGEST_CASE: u64 = 8 << 20;

/// Why there is no text.
#[derive(Debug, thiserror::Error)]
pub enum NoText {
    #[error("cannot be read: {0}")]
    Unreadable(std::io::Error),
    #[error("larger than {0} bytes; is it the right file?")]
    TooLong(u64),
    #[error("line {0}: expected text in UTF-8, found other bytes")]
    Bytes(usize),
}

/// Reads a text of at most `limit` bytes; memory does not depend on how much there is.
///
/// # Errors
/// See [`NoText`].
pub fn read_text(source: impl Read, limit: u64) -> Result<String, NoText> {
    let mut bytes = Vec::new();
    let read = source.take(limit.saturating_add(1)).read_to_end(&mut bytes);
    if read.map_err(NoText::Unreadable)? as u64 > limit {
        return Err(NoText::TooLong(limit));
    }
    String::from_utf8(bytes).map_err(|e| {
        let good = &e.as_bytes()[..e.utf8_error().valid_up_to()];
        NoText::Bytes(1 + good.iter().filter(|b| **b == b'\n').count())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_long_a_text_is_refused_and_what_is_none() {
        assert_eq!(read_text(&b"0123456789"[..], 10).unwrap(), "0123456789");
        assert!(matches!(read_text(&b"0123456789"[..], 9), Err(NoText::TooLong(9))));
        // Of what never ends, no more than that is read.
        assert!(matches!(read_text(std::io::repeat(b'a'), 9), Err(NoText::TooLong(9))));
        assert!(matches!(read_text(&b"a\n\xff"[..], 9), Err(NoText::Bytes(2))));
    }
}
