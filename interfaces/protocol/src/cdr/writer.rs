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

/// Returns the error of a method for a type that ROS 2 messages cannot express.
fn unsupported<T>(method: &str) -> Result<T, MessageError> {
    let kind = method.trim_start_matches("serialize_").replace('_', " ");
    Err(MessageError::new("", "a type of ROS 2 messages", kind))
}

macro_rules! numbers {
    ($($method:ident $type:ty),*) => {$(
        fn $method(self, v: $type) -> Result<(), MessageError> {
            self.number(v.to_le_bytes())
        }
    )*};
}

macro_rules! unsupported {
    ($($method:ident($($argument:ty),*) -> $ok:ty),*) => {$(
        fn $method(self, $(_: $argument),*) -> Result<$ok, MessageError> {
            unsupported(stringify!($method))
        }
    )*};
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
    numbers!(
        serialize_i8 i8, serialize_i16 i16, serialize_i32 i32, serialize_i64 i64, serialize_u8 u8,
        serialize_u16 u16, serialize_u32 u32, serialize_u64 u64, serialize_f32 f32, serialize_f64 f64
    );

    unsupported!(
        serialize_char(char) -> (), serialize_none() -> (), serialize_unit() -> (),
        serialize_unit_struct(&'static str) -> (),
        serialize_unit_variant(&'static str, u32, &'static str) -> (),
        serialize_tuple_struct(&'static str, usize) -> Unsupported,
        serialize_tuple_variant(&'static str, u32, &'static str, usize) -> Unsupported,
        serialize_map(Option<usize>) -> Unsupported,
        serialize_struct_variant(&'static str, u32, &'static str, usize) -> Unsupported
    );

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
        let Some(length) = length else { return unsupported("sequence of unknown length") };
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

    fn serialize_some<T: ?Sized + Serialize>(self, _: &T) -> Result<(), MessageError> {
        unsupported("serialize_some")
    }

    fn serialize_newtype_variant<T: ?Sized + Serialize>(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: &T,
    ) -> Result<(), MessageError> {
        unsupported("serialize_newtype_variant")
    }
}

macro_rules! elements {
    ($($access:ident),*) => {$(
        impl $access for &mut CdrWriter {
            type Ok = ();
            type Error = MessageError;

            fn serialize_element<T: ?Sized + Serialize>(
                &mut self,
                value: &T,
            ) -> Result<(), MessageError> {
                value.serialize(&mut **self)
            }
            fn end(self) -> Result<(), MessageError> {
                Ok(())
            }
        }
    )*};
}

elements!(SerializeSeq, SerializeTuple);

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
