//! A deserializer without data: it makes values up, and remembers what was asked for.

use crate::MessageError;
use serde::de::{Deserialize, DeserializeOwned, DeserializeSeed, Deserializer, SeqAccess, Visitor};

/// Requested type of a value.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    Plain(&'static str),
    List(Box<Shape>),
    Array(Box<Shape>, usize),
    Struct { name: &'static str, fields: Vec<(&'static str, Shape)> },
}

impl Shape {
    /// Returns the type of a field in a definition, without the package.
    pub fn text(&self) -> String {
        match self {
            Shape::Plain(name) => name.to_string(),
            Shape::List(item) => format!("{}[]", item.text()),
            Shape::Array(item, length) => format!("{}[{length}]", item.text()),
            Shape::Struct { name, .. } => name.to_string(),
        }
    }
}

pub struct Imagined {
    random: u64,
    /// Lists have one entry, so that its shape is seen.
    one_each: bool,
    shape: Option<Shape>,
}

impl Imagined {
    pub fn shape_of<T: DeserializeOwned>() -> Shape {
        let mut imagined = Self { random: 1, one_each: true, shape: None };
        T::deserialize(&mut imagined).unwrap();
        imagined.shape.unwrap()
    }

    pub fn value<T: DeserializeOwned>(seed: u64) -> T {
        T::deserialize(&mut Self { random: seed | 1, one_each: false, shape: None }).unwrap()
    }

    fn next(&mut self) -> u64 {
        // xorshift64
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        self.random
    }

    fn plain(&mut self, name: &'static str) -> u64 {
        self.shape = Some(Shape::Plain(name));
        self.next()
    }
}

macro_rules! numbers {
    ($($method:ident $visit:ident $type:ty, $name:literal);*) => {$(
        fn $method<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
            visitor.$visit(self.plain($name) as $type)
        }
    )*};
}

impl<'de> Deserializer<'de> for &mut Imagined {
    type Error = MessageError;

    fn is_human_readable(&self) -> bool {
        false
    }

    numbers!(
        deserialize_i8 visit_i8 i8, "int8"; deserialize_i16 visit_i16 i16, "int16";
        deserialize_i32 visit_i32 i32, "int32"; deserialize_i64 visit_i64 i64, "int64";
        deserialize_u16 visit_u16 u16, "uint16"; deserialize_u32 visit_u32 u32, "uint32";
        deserialize_u64 visit_u64 u64, "uint64"
    );

    // Every enum of the messages has these three.
    fn deserialize_u8<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_u8((self.plain("uint8") % 3) as u8)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let mantissa = self.plain("float64") as i64 as f64;
        visitor.visit_f64(mantissa * 10f64.powi((self.next() % 40) as i32 - 40))
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_f32(self.plain("float32") as i32 as f32)
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        visitor.visit_bool(self.plain("bool") % 2 == 1)
    }

    fn deserialize_str<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let length = self.plain("string") % 12;
        visitor.visit_string("äbc\"def\nghijk".chars().take(length as usize).collect())
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        self.deserialize_str(visitor)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, MessageError> {
        let left = if self.one_each { 1 } else { self.next() as usize % 3 };
        let value = visitor.visit_seq(Items { imagined: self, left })?;
        self.shape = self.shape.take().map(|item| Shape::List(Box::new(item)));
        Ok(value)
    }

    fn deserialize_tuple<V: Visitor<'de>>(
        self,
        length: usize,
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        let value = visitor.visit_seq(Items { imagined: self, left: length })?;
        self.shape = self.shape.take().map(|item| Shape::Array(Box::new(item), length));
        Ok(value)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        names: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, MessageError> {
        let mut fields = Fields { imagined: self, names, found: Vec::new() };
        let value = visitor.visit_seq(&mut fields)?;
        let fields = fields.found;
        self.shape = Some(Shape::Struct { name, fields });
        Ok(value)
    }

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, MessageError> {
        panic!("no type of ROS 2 messages")
    }

    serde::forward_to_deserialize_any! {
        char bytes byte_buf option unit unit_struct newtype_struct tuple_struct map enum identifier
        ignored_any
    }
}

struct Items<'a> {
    imagined: &'a mut Imagined,
    left: usize,
}

impl<'de> SeqAccess<'de> for Items<'_> {
    type Error = MessageError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, MessageError> {
        let Some(left) = self.left.checked_sub(1) else { return Ok(None) };
        self.left = left;
        seed.deserialize(&mut *self.imagined).map(Some)
    }
}

struct Fields<'a> {
    imagined: &'a mut Imagined,
    names: &'static [&'static str],
    found: Vec<(&'static str, Shape)>,
}

impl<'de> SeqAccess<'de> for &mut Fields<'_> {
    type Error = MessageError;

    fn next_element_seed<S: DeserializeSeed<'de>>(
        &mut self,
        seed: S,
    ) -> Result<Option<S::Value>, MessageError> {
        let Some((name, rest)) = self.names.split_first() else { return Ok(None) };
        self.names = rest;
        let value = seed.deserialize(&mut *self.imagined)?;
        // Empty lists of chance leave no shape; those of `shape_of` do.
        let shape = self.imagined.shape.take().unwrap_or(Shape::Plain("nothing"));
        self.found.push((name, shape));
        Ok(Some(value))
    }
}

#[test]
fn values_of_chance_differ() {
    let value =
        |seed| <Vec<u64>>::deserialize(&mut Imagined { random: seed, one_each: true, shape: None });
    assert_ne!(value(3).unwrap(), value(5).unwrap());
}
