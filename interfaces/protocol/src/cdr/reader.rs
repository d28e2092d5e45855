//! CDR decoder for serde, limited to the types of ROS 2 messages.

use crate::MessageError;
use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};

pub(super) struct CdrReader<'a> {
    /// Bytes after the encapsulation header.
    bytes: &'a [u8],
    at: usize,
    little: bool,
    /// Path of the current field; kept on errors, so that they name their place.
    path: Vec<FieldPathSegment>,
}

#[derive(Debug, Clone, Copy)]
enum FieldPathSegment {
    Field(&'static str),
    Item(usize),
}

impl<'a> CdrReader<'a> {
    pub fn new(bytes: &'a [u8], little: bool) -> Self {
        Self { bytes, at: 0, little, path: Vec::new() }
    }

    /// Returns an error unless all bytes have been read.
    pub fn expect_end(&self) -> Result<(), MessageError> {
        let rest = &self.bytes[self.at..];
        let fills_a_word = rest.len() < 4 && self.bytes.len().is_multiple_of(4);
        if rest.is_empty() || (fills_a_word && rest.iter().all(|b| *b == 0)) {
            return Ok(());
        }
        Err(self.error("the end of the message", format!("{} more bytes", rest.len())))
    }

    /// Adds the current path to an error without a place.
    pub fn with_path(&self, error: MessageError) -> MessageError {
        if !error.place.is_empty() {
            return error;
        }
        MessageError { place: self.position_text(), ..error }
    }

    fn position_text(&self) -> String {
        let mut text = String::new();
        for step in &self.path {
            match step {
                FieldPathSegment::Field(name) if text.is_empty() => text += name,
                FieldPathSegment::Field(name) => text += &format!(".{name}"),
                FieldPathSegment::Item(index) => text += &format!("[{index}]"),
            }
        }
        format!("{text}, byte {}", self.at + 4)
    }

    fn error(&self, expected: impl Into<String>, found: impl ToString) -> MessageError {
        MessageError::new(self.position_text(), expected, found)
    }

    fn remaining(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], MessageError> {
        match self.bytes[self.at..].get(..count) {
            Some(bytes) => {
                self.at += count;
                Ok(bytes)
            }
            None => {
                Err(self
                    .error(format!("{count} more bytes"), format!("{} bytes", self.remaining())))
            }
        }
    }

    /// Reads an aligned number and returns its bytes, lowest first.
    fn read_number<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        self.take(self.at.next_multiple_of(N) - self.at)?;
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if !self.little {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// Reads a length and checks it against the remaining bytes: every entry takes at least one.
    fn read_length(&mut self) -> Result<usize, MessageError> {
        let length = u32::from_le_bytes(self.read_number()?) as usize;
        if length <= self.remaining() {
            return Ok(length);
        }
        let found = format!("a length of {length}");
        Err(self.error(format!("a length of at most {}, the bytes left", self.remaining()), found))
    }

    fn read_text(&mut self) -> Result<&'a str, MessageError> {
        let length = self.read_length()?;
        // Some writers omit the zero of an empty text.
        if length == 0 {
            return Ok("");
        }
        let bytes = self.take(length)?;
        let Some((0, text)) = bytes.split_last() else {
            let found = bytes.last().map_or("none".into(), |last| format!("the byte {last}"));
            return Err(self.error("a text that ends with a zero", found));
        };
        if let Some(at) = text.iter().position(|b| *b == 0) {
            return Err(self.error("a text without zeros", format!("one at its byte {at}")));
        }
        std::str::from_utf8(text).map_err(|e| self.error("a text in UTF-8", e))
    }

    fn unsupported<T>(&self, what: &str) -> Result<T, MessageError> {
        Err(self.error("a type of ROS 2 messages", what))
    }
}

macro_rules! numbers {
    ($($method:ident $visit:ident $type:ty),*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
            visitor.$visit(<$type>::from_le_bytes(self.read_number()?))
        }
    )*};
}

macro_rules! unsupported {
    ($($method:ident($($argument:ty),*) $what:literal),*) => {$(
        fn $method<V: Visitor<'de>>(self, $(_: $argument,)* _: V) -> Result<V::Value, MessageError> {
            self.unsupported($what)
        }
    )*};
}

impl<'de> Deserializer<'de> for &mut CdrReader<'de> {
    type Error = MessageError;

    fn is_human_readable(&self) -> bool {
        false
    }

    numbers!(
        deserialize_i8 visit_i8 i8, deserialize_i16 visit_i16 i16, deserialize_i32 visit_i32 i32,
        deserialize_i64 visit_i64 i64, deserialize_u8 visit_u8 u8, deserialize_u16 visit_u16 u16,
        deserialize_u32 visit_u32 u32, deserialize_u64 visit_u64 u64,
        deserialize_f32 visit_f32 f32, deserialize_f64 visit_f64 f64
    );

    unsupported!(
        deserialize_any() "a value without a type",
        deserialize_ignored_any() "a value to be ignored",
        deserialize_char() "a character",
        deserialize_option() "an option",
        deserialize_unit() "nothing",
        deserialize_unit_struct(&'static str) "a structure of nothing",
        deserialize_tuple_struct(&'static str, usize) "a structure without names",
        deserialize_map() "a map",
        deserialize_enum(&'static str, &'static [&'static str]) "an enum",
        deserialize_identifier() "a name"
    );

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        match self.read_number()? {
            [0] => visitor.visit_bool(false),
            [1] => visitor.visit_bool(true),
            [other] => Err(self.error("0 or 1", other)),
        }
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_str(self.read_text()?)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_str(self.read_text()?)
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let length = self.read_length()?;
        visitor.visit_bytes(self.take(length)?)
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        self.deserialize_bytes(visitor)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let length = self.read_length()?;
        visitor.visit_seq(ItemAccess { reader: self, next: 0, length })
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        visitor.visit_seq(ItemAccess { reader: self, next: 0, length })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        names: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        visitor.visit_seq(FieldAccess { reader: self, names })
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        visitor.visit_newtype_struct(self)
    }
}

/// Reads one field or item and keeps the path up to date.
fn read_part<'de, S: DeserializeSeed<'de>>(
    reader: &mut CdrReader<'de>,
    step: FieldPathSegment,
    seed: S,
) -> Result<Option<S::Value>, MessageError> {
    reader.path.push(step);
    let value = seed.deserialize(&mut *reader).map_err(|e| reader.with_path(e))?;
    reader.path.pop();
    Ok(Some(value))
}

struct ItemAccess<'r, 'de> {
    reader: &'r mut CdrReader<'de>,
    next: usize,
    length: usize,
}

impl<'de> SeqAccess<'de> for ItemAccess<'_, 'de> {
    type Error = MessageError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, MessageError> {
        if self.next == self.length {
            return Ok(None);
        }
        self.next += 1;
        read_part(self.reader, FieldPathSegment::Item(self.next - 1), seed)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.length - self.next)
    }
}

struct FieldAccess<'r, 'de> {
    reader: &'r mut CdrReader<'de>,
    names: &'static [&'static str],
}

impl<'de> SeqAccess<'de> for FieldAccess<'_, 'de> {
    type Error = MessageError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, MessageError> {
        let Some((name, rest)) = self.names.split_first() else { return Ok(None) };
        self.names = rest;
        read_part(self.reader, FieldPathSegment::Field(name), seed)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.names.len())
    }
}
