//! How messages are marked on the wire.

use ballast_protocol::messages::Message;
use zenoh::bytes::Encoding;

/// The start of the encoding of CDR messages; their type follows.
const CDR: &str = "application/cdr";

/// How a message of this type is marked when it is CDR.
pub(crate) fn cdr<T: Message>() -> Encoding {
    Encoding::from(format!("{CDR};{}", T::NAME))
}

/// Whether a message that is marked like this is CDR.
pub(crate) fn is_cdr(encoding: &Encoding) -> bool {
    encoding.to_string().starts_with(CDR)
}
