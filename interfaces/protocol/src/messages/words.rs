//! Choices: a byte on the wire, a word for people.

use serde::de::{Error as _, Unexpected};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

macro_rules! words {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $number:literal $word:literal),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$variant_doc])* $variant),* }

        impl $name {
            /// All of them, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// The number on the wire.
            pub fn number(self) -> u8 {
                match self { $(Self::$variant => $number),* }
            }

            /// The word in JSON.
            pub fn word(self) -> &'static str {
                match self { $(Self::$variant => $word),* }
            }
        }

        impl schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!({ "type": "string", "enum": [$($word),*] })
            }
        }

        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                if serializer.is_human_readable() {
                    serializer.serialize_str(self.word())
                } else {
                    serializer.serialize_u8(self.number())
                }
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let all = concat!("one of" $(, " ", $word, " (", $number, ")")*);
                if deserializer.is_human_readable() {
                    let word = String::deserialize(deserializer)?;
                    let known = Self::ALL.iter().find(|v| v.word() == word);
                    known.copied().ok_or_else(|| D::Error::invalid_value(Unexpected::Str(&word), &all))
                } else {
                    let number = u8::deserialize(deserializer)?;
                    let known = Self::ALL.iter().find(|v| v.number() == number);
                    known.copied().ok_or_else(|| {
                        D::Error::invalid_value(Unexpected::Unsigned(number.into()), &all)
                    })
                }
            }
        }
    };
}

words!(
    /// What lies between knots.
    #[derive(Default)]
    InterpolationMode {
        /// The last knot.
        Hold = 0 "hold",
        /// Constant velocity and spin.
        Linear = 1 "linear",
        /// Cubic, with the knots' twists.
        #[default]
        Hermite = 2 "hermite",
    }
);

words!(
    /// What to do when the time allowed for a window has passed.
    #[derive(Default)]
    DeadlinePolicy {
        /// Go on to the end.
        #[default]
        Finish = 0 "finish",
        /// Keep what is done.
        Early = 1 "early",
        /// Take the window back.
        Discard = 2 "discard",
    }
);

words!(
    /// How a window went.
    #[derive(Default)]
    ReplyStatus {
        /// Computed to its end, every step solved.
        #[default]
        Ok = 0 "ok",
        /// Computed to its end; some step stopped at the cap of iterations.
        Warn = 1 "warn",
        /// Ended before its end, in a valid state.
        Early = 2 "early",
        /// The state is exactly that of its beginning.
        Discard = 3 "discard",
        /// Only restore, reset and detach work after it.
        Error = 4 "error",
        /// Nothing works after it.
        Fatal = 5 "fatal",
    }
);

impl ReplyStatus {
    /// Whether the window led on; otherwise the state is that of its beginning.
    pub fn is_kept(self) -> bool {
        !matches!(self, Self::Discard | Self::Error | Self::Fatal)
    }
}
