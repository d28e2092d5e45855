//! Encodings of messages in Zenoh.

use ballast_protocol::messages::Message;
use zenoh::bytes::Encoding;

/// Prefix of the encoding of CDR messages; the type follows.
const CDR: &str = "application/cdr";

/// Returns the encoding of a CDR message of this type.
pub(crate) fn cdr<T: Message>() -> Encoding {
    Encoding::from(format!("{CDR};{}", T::NAME))
}

/// Returns true if an encoding is CDR.
pub(crate) fn is_cdr(encoding: &Encoding) -> bool {
    encoding.to_string().starts_with(CDR)
}
