//! CDR as serde's data model, as far as ROS 2 messages go.

use crate::MessageError;
use serde::de::{DeserializeSeed, Deserializer, SeqAccess, Visitor};

pub(super) struct Reader<'a> {
    /// What follows the encapsulation header.
    bytes: &'a [u8],
    at: usize,
    little: bool,
    /// Where in the message this is; not taken back on errors, so that they know their place.
    path: Vec<Step>,
}

#[derive(Debug, Clone, Copy)]
enum Step {
    Field(&'static str),
    Item(usize),
}

impl<'a> Reader<'a> {
    pub fn new(bytes: &'a [u8], little: bool) -> Self {
        Self { bytes, at: 0, little, path: Vec::new() }
    }

    /// Everything has been read.
    pub fn end(&self) -> Result<(), MessageError> {
        let rest = &self.bytes[self.at..];
        let fills_a_word = rest.len() < 4 && self.bytes.len().is_multiple_of(4);
        if rest.is_empty() || (fills_a_word && rest.iter().all(|b| *b == 0)) {
            return Ok(());
        }
        Err(self.fault("the end of the message", format!("{} more bytes", rest.len())))
    }

    /// An error with its place, if it has none yet.
    pub fn located(&self, error: MessageError) -> MessageError {
        if !error.place.is_empty() {
            return error;
        }
        MessageError { place: self.place(), ..error }
    }

    fn place(&self) -> String {
        let mut text = String::new();
        for step in &self.path {
            match step {
                Step::Field(name) if text.is_empty() => text += name,
                Step::Field(name) => text += &format!(".{name}"),
                Step::Item(index) => text += &format!("[{index}]"),
            }
        }
        format!("{text}, byte {}", self.at + 4)
    }

    fn fault(&self, expected: impl Into<String>, found: impl ToString) -> MessageError {
        MessageError::new(self.place(), expected, found)
    }

    fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], MessageError> {
        match self.bytes[self.at..].get(..count) {
            Some(bytes) => {
                self.at += count;
                Ok(bytes)
            }
            None => {
                Err(self.fault(format!("{count} more bytes"), format!("{} bytes", self.left())))
            }
        }
    }

    /// The bytes of an aligned number, lowest first.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], MessageError> {
        self.take(self.at.next_multiple_of(N) - self.at)?;
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if !self.little {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// A length that the rest of the bytes can hold: every entry takes one at least.
    fn length(&mut self) -> Result<usize, MessageError> {
        let length = u32::from_le_bytes(self.number()?) as usize;
        if length <= self.left() {
            return Ok(length);
        }
        let found = format!("a length of {length}");
        Err(self.fault(format!("a length of at most {}, the bytes left", self.left()), found))
    }

    fn text(&mut self) -> Result<&'a str, MessageError> {
        let length = self.length()?;
        // Some writers leave the zero out of an empty text.
        if length == 0 {
            return Ok("");
        }
        let bytes = self.take(length)?;
        let Some((0, text)) = bytes.split_last() else {
            let found = bytes.last().map_or("none".into(), |last| format!("the byte {last}"));
            return Err(self.fault("a text that ends with a zero", found));
        };
        if let Some(at) = text.iter().position(|b| *b == 0) {
            return Err(self.fault("a text without zeros", format!("one at its byte {at}")));
        }
        std::str::from_utf8(text).map_err(|e| self.fault("a text in UTF-8", e))
    }

    fn unknown<T>(&self, what: &str) -> Result<T, MessageError> {
        Err(self.fault("a type of ROS 2 messages", what))
    }
}

macro_rules! numbers {
    ($($method:ident $visit:ident $type:ty),*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
            visitor.$visit(<$type>::from_le_bytes(self.number()?))
        }
    )*};
}

macro_rules! unknown {
    ($($method:ident($($argument:ty),*) $what:literal),*) => {$(
        fn $method<V: Visitor<'de>>(self, $(_: $argument,)* _: V) -> Result<V::Value, MessageError> {
            self.unknown($what)
        }
    )*};
}

impl<'de> Deserializer<'de> for &mut Reader<'de> {
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

    unknown!(
        deserialize_any() "a value that does not say its type",
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
        match self.number()? {
            [0] => visitor.visit_bool(false),
            [1] => visitor.visit_bool(true),
            [other] => Err(self.fault("0 or 1", other)),
        }
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_str(self.text()?)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_str(self.text()?)
    }

    fn deserialize_bytes<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let length = self.length()?;
        visitor.visit_bytes(self.take(length)?)
    }

    fn deserialize_byte_buf<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        self.deserialize_bytes(visitor)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let length = self.length()?;
        visitor.visit_seq(Items { reader: self, next: 0, length })
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        visitor.visit_seq(Items { reader: self, next: 0, length })
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        names: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        visitor.visit_seq(Fields { reader: self, names })
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        visitor.visit_newtype_struct(self)
    }
}

/// Reads one part of the message at the end of the path.
fn part<'de, S: DeserializeSeed<'de>>(
    reader: &mut Reader<'de>,
    step: Step,
    seed: S,
) -> Result<Option<S::Value>, MessageError> {
    reader.path.push(step);
    let value = seed.deserialize(&mut *reader).map_err(|e| reader.located(e))?;
    reader.path.pop();
    Ok(Some(value))
}

struct Items<'r, 'de> {
    reader: &'r mut Reader<'de>,
    next: usize,
    length: usize,
}

impl<'de> SeqAccess<'de> for Items<'_, 'de> {
    type Error = MessageError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, MessageError> {
        if self.next == self.length {
            return Ok(None);
        }
        self.next += 1;
        part(self.reader, Step::Item(self.next - 1), seed)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.length - self.next)
    }
}

struct Fields<'r, 'de> {
    reader: &'r mut Reader<'de>,
    names: &'static [&'static str],
}

impl<'de> SeqAccess<'de> for Fields<'_, 'de> {
    type Error = MessageError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, MessageError> {
        let Some((name, rest)) = self.names.split_first() else { return Ok(None) };
        self.names = rest;
        part(self.reader, Step::Field(name), seed)
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.names.len())
    }
}
