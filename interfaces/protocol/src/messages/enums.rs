//! Enumerations: a byte in CDR, a word in JSON.

use serde::de::{Error as _, Unexpected};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

macro_rules! wire_enum {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $number:literal $word:literal),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $name { $($(#[$variant_doc])* $variant),* }

        impl $name {
            /// All values, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$variant),*];

            /// Returns the number in CDR.
            pub fn number(self) -> u8 {
                match self { $(Self::$variant => $number),* }
            }

            /// Returns the word in JSON.
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

wire_enum!(
    /// Interpolation between knots.
    #[derive(Default)]
    InterpolationMode {
        /// Value of the last knot.
        Hold = 0 "hold",
        /// Constant velocity and angular velocity.
        Linear = 1 "linear",
        /// Cubic Hermite interpolation with the knots' twists.
        #[default]
        Hermite = 2 "hermite",
    }
);

wire_enum!(
    /// Action when the deadline of a window has passed.
    #[derive(Default)]
    DeadlinePolicy {
        /// Computes the window to its end.
        #[default]
        Finish = 0 "finish",
        /// Ends the window and keeps its finished steps.
        Early = 1 "early",
        /// Rolls the window back.
        Discard = 2 "discard",
    }
);

wire_enum!(
    /// Status of a window, as in FMI.
    #[derive(Default)]
    ReplyStatus {
        /// Computed to its end; every step converged.
        #[default]
        Ok = 0 "ok",
        /// Computed to its end; a step reached the maximum number of iterations.
        Warn = 1 "warn",
        /// Ended early, in a valid state.
        Early = 2 "early",
        /// Rolled back: the state is bitwise that of its beginning.
        Discard = 3 "discard",
        /// Failed by an internal error; only `restore`, `reset` and `detach` are possible.
        Error = 4 "error",
        /// Failed; the component cannot be used any more.
        Fatal = 5 "fatal",
    }
);

impl ReplyStatus {
    /// Returns true if the window has steps that are kept; otherwise the state is that of its beginning.
    pub fn is_kept(self) -> bool {
        !matches!(self, Self::Discard | Self::Error | Self::Fatal)
    }
}
