//! CDR encoder for serde, limited to the types of ROS 2 messages.

use super::LITTLE;
use crate::MessageError;
use serde::Serialize;
use serde::ser::{Impossible, SerializeSeq, SerializeStruct, SerializeTuple, Serializer};

pub(super) struct CdrWriter {
    out: Vec<u8>,
}

/// Length of the encapsulation header, which alignment ignores.
const HEADER_BYTES: usize = 4;

impl CdrWriter {
    pub fn new() -> Self {
        let mut out = vec![0; HEADER_BYTES];
        out[..2].copy_from_slice(&LITTLE);
        Self { out }
    }

    pub fn finish(self) -> Vec<u8> {
        self.out
    }

    fn number<const N: usize>(&mut self, bytes: [u8; N]) -> Result<(), MessageError> {
        let end = (self.out.len() - HEADER_BYTES).next_multiple_of(N) + HEADER_BYTES;
        self.out.resize(end, 0);
        self.out.extend_from_slice(&bytes);
        Ok(())
    }

    fn length(&mut self, length: usize) -> Result<(), MessageError> {
        let length = u32::try_from(length)
            .map_err(|_| MessageError::new("", format!("at most {} entries", u32::MAX), length))?;
        self.number(length.to_le_bytes())
    }
}

/// Returns the error of a type that ROS 2 messages cannot express.
fn unsupported<T>(what: &str) -> Result<T, MessageError> {
    Err(MessageError::new("", "a type of ROS 2 messages", what))
}

type Unsupported = Impossible<(), MessageError>;

impl Serializer for &mut CdrWriter {
    type Ok = ();
    type Error = MessageError;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Unsupported;
    type SerializeTupleVariant = Unsupported;
    type SerializeMap = Unsupported;
    type SerializeStruct = Self;
    type SerializeStructVariant = Unsupported;

    fn is_human_readable(&self) -> bool {
        false
    }

    fn serialize_bool(self, v: bool) -> Result<(), MessageError> {
        self.number([u8::from(v)])
    }
    fn serialize_i8(self, v: i8) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_i16(self, v: i16) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_i32(self, v: i32) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_i64(self, v: i64) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_u8(self, v: u8) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_u16(self, v: u16) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_u32(self, v: u32) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_u64(self, v: u64) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_f32(self, v: f32) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }
    fn serialize_f64(self, v: f64) -> Result<(), MessageError> {
        self.number(v.to_le_bytes())
    }

    fn serialize_str(self, v: &str) -> Result<(), MessageError> {
        if let Some(at) = v.bytes().position(|b| b == 0) {
            return Err(MessageError::new("", "a text without zeros", format!("one at byte {at}")));
        }
        self.length(v.len().saturating_add(1))?;
        self.out.extend_from_slice(v.as_bytes());
        self.out.push(0);
        Ok(())
    }

    fn serialize_bytes(self, v: &[u8]) -> Result<(), MessageError> {
        self.length(v.len())?;
        self.out.extend_from_slice(v);
        Ok(())
    }

    fn serialize_seq(self, length: Option<usize>) -> Result<Self, MessageError> {
        let Some(length) = length else { return unsupported("a sequence of unknown length") };
        self.length(length)?;
        Ok(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self, MessageError> {
        Ok(self)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, MessageError> {
        Ok(self)
    }

    fn serialize_newtype_struct<T: ?Sized + Serialize>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<(), MessageError> {
        value.serialize(self)
    }

    fn serialize_char(self, _: char) -> Result<(), MessageError> {
        unsupported("a character")
    }
    fn serialize_none(self) -> Result<(), MessageError> {
        unsupported("an option")
    }
    fn serialize_some<T: ?Sized + Serialize>(self, _: &T) -> Result<(), MessageError> {
        unsupported("an option")
    }
    fn serialize_unit(self) -> Result<(), MessageError> {
        unsupported("nothing")
    }
    fn serialize_unit_struct(self, name: &'static str) -> Result<(), MessageError> {
        unsupported(name)
    }
    fn serialize_unit_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
    ) -> Result<(), MessageError> {
        unsupported(name)
    }
    fn serialize_newtype_variant<T: ?Sized + Serialize>(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: &T,
    ) -> Result<(), MessageError> {
        unsupported(name)
    }
    fn serialize_tuple_struct(
        self,
        name: &'static str,
        _: usize,
    ) -> Result<Unsupported, MessageError> {
        unsupported(name)
    }
    fn serialize_tuple_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Unsupported, MessageError> {
        unsupported(name)
    }
    fn serialize_map(self, _: Option<usize>) -> Result<Unsupported, MessageError> {
        unsupported("a map")
    }
    fn serialize_struct_variant(
        self,
        name: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Unsupported, MessageError> {
        unsupported(name)
    }
}

impl SerializeSeq for &mut CdrWriter {
    type Ok = ();
    type Error = MessageError;

    fn serialize_element<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), MessageError> {
        value.serialize(&mut **self)
    }
    fn end(self) -> Result<(), MessageError> {
        Ok(())
    }
}

impl SerializeTuple for &mut CdrWriter {
    type Ok = ();
    type Error = MessageError;

    fn serialize_element<T: ?Sized + Serialize>(&mut self, value: &T) -> Result<(), MessageError> {
        value.serialize(&mut **self)
    }
    fn end(self) -> Result<(), MessageError> {
        Ok(())
    }
}

impl SerializeStruct for &mut CdrWriter {
    type Ok = ();
    type Error = MessageError;

    fn serialize_field<T: ?Sized + Serialize>(
        &mut self,
        name: &'static str,
        value: &T,
    ) -> Result<(), MessageError> {
        value.serialize(&mut **self).map_err(|e| e.inside(name))
    }
    fn end(self) -> Result<(), MessageError> {
        Ok(())
    }
}
