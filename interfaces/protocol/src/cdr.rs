//! Messages as CDR, version 1 (XCDR1), the encoding of ROS 2.
//!
//! Reads and writes: bytes. Contract: four bytes of encapsulation header, then the fields in order,
//! numbers aligned to their size relative to the first byte after the header, strings and sequences
//! with a 32-bit length in front, strings with a closing zero that counts. Encodes little endian and decodes both
//! orders. Decoding never reserves more memory than the message can fill.

mod reader;
mod writer;

use crate::MessageError;
use crate::messages::Message;

/// Encapsulation headers: plain CDR, big and little endian.
const BIG: [u8; 2] = [0, 0];
const LITTLE: [u8; 2] = [0, 1];

/// Encodes a message as CDR with its encapsulation header.
///
/// # Errors
/// A text that contains a zero byte, or a list with more than 2³² entries.
pub fn to_cdr<T: Message>(message: &T) -> Result<Vec<u8>, MessageError> {
    let mut writer = writer::CdrWriter::new();
    message.serialize(&mut writer).map_err(|e| e.inside(T::NAME))?;
    Ok(writer.finish())
}

/// Decodes a message from CDR with its encapsulation header.
///
/// Up to three zero bytes may follow to fill the last word, as some writers do.
///
/// # Errors
/// Bytes that are no message of this type: another encapsulation, a wrong length, text that is not UTF-8, or a
/// value outside an enumeration. The error names the field and its byte.
pub fn from_cdr<T: Message>(bytes: &[u8]) -> Result<T, MessageError> {
    decode(bytes).map_err(|e| e.inside(T::NAME))
}

fn decode<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, MessageError> {
    let Some((header, body)) = bytes.split_first_chunk::<4>() else {
        let found = format!("{} bytes", bytes.len());
        return Err(MessageError::new("", "an encapsulation header of 4 bytes", found));
    };
    let little = match [header[0], header[1]] {
        LITTLE => true,
        BIG => false,
        other => {
            let expected = "the header of plain CDR, 00 00 or 00 01";
            return Err(MessageError::new(
                "",
                expected,
                format!("{:02x} {:02x}", other[0], other[1]),
            ));
        }
    };
    let mut reader = reader::CdrReader::new(body, little);
    let message = T::deserialize(&mut reader).map_err(|e| reader.with_path(e))?;
    reader.expect_end()?;
    Ok(message)
}

#[cfg(test)]
mod tests;
