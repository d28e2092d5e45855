//! Hashes: 16 bytes in CDR, hexadecimal in JSON.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// Hash of the simulation state.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct StateHash {
    /// Bytes of the hash, most significant first.
    pub bytes: [u8; 16],
}

/// Digest of a message: the first 128 bits of BLAKE3 over its CDR.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Digest(pub [u8; 16]);

impl Digest {
    /// Computes the digest of bytes.
    pub fn of(bytes: &[u8]) -> Self {
        let mut first = [0; 16];
        first.copy_from_slice(&blake3::hash(bytes).as_bytes()[..16]);
        Self(first)
    }
}

impl From<u128> for StateHash {
    fn from(hash: u128) -> Self {
        Self { bytes: hash.to_be_bytes() }
    }
}

impl fmt::Display for StateHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", u128::from_be_bytes(self.bytes))
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", u128::from_be_bytes(self.0))
    }
}

/// Parses 32 hexadecimal digits.
fn parse_hexadecimal(text: &str) -> Result<[u8; 16], String> {
    let hexadecimal = text.len() == 32 && text.bytes().all(|b| b.is_ascii_hexdigit());
    match u128::from_str_radix(text, 16) {
        Ok(number) if hexadecimal => Ok(number.to_be_bytes()),
        _ => Err(format!("expected 32 hexadecimal digits, found {text:?}")),
    }
}

impl std::str::FromStr for StateHash {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        parse_hexadecimal(text).map(|bytes| Self { bytes })
    }
}

/// Structure of the hash in CDR.
#[derive(Serialize, Deserialize)]
#[serde(rename = "StateHash")]
struct StateHashBytes {
    bytes: [u8; 16],
}

impl Serialize for StateHash {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            serializer.collect_str(self)
        } else {
            StateHashBytes { bytes: self.bytes }.serialize(serializer)
        }
    }
}

impl<'de> Deserialize<'de> for StateHash {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
        } else {
            StateHashBytes::deserialize(deserializer).map(|plain| Self { bytes: plain.bytes })
        }
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            serializer.collect_str(self)
        } else {
            self.0.serialize(serializer)
        }
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            parse_hexadecimal(&String::deserialize(deserializer)?)
                .map(Self)
                .map_err(D::Error::custom)
        } else {
            <[u8; 16]>::deserialize(deserializer).map(Self)
        }
    }
}

macro_rules! hexadecimal {
    ($($name:ident),*) => {$(
        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!({ "type": "string", "pattern": "^[0-9a-fA-F]{32}$" })
            }
        }
    )*};
}

hexadecimal!(StateHash, Digest);
