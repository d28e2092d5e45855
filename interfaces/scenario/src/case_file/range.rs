//! Ranges of numbers, for the schema only: the fields themselves are plain numbers.
//!
//! The limits stand in the schema, so that editors and [`crate::structure`] check the same ones.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use std::borrow::Cow;

macro_rules! range {
    ($(#[$doc:meta])* $name:ident, $($limits:tt)*) => {
        $(#[$doc])*
        pub struct $name;

        impl JsonSchema for $name {
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }
            fn inline_schema() -> bool {
                true
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({ $($limits)* })
            }
        }
    };
}

range!(
    /// A finite number.
    Finite, "type": "number"
);
range!(
    /// Number above 0.
    Positive, "type": "number", "exclusiveMinimum": 0
);
range!(
    /// Length of grains, boxes and tools, m: from thinner than any sheet to longer than any train.
    Length, "type": "number", "minimum": 0.0001, "maximum": 1000
);
range!(
    /// Mass of a body on a mount, kg: from a pebble to more than any train.
    Mass, "type": "number", "minimum": 0.001, "maximum": 1000000000
);
range!(
    /// Stiffness above 0, N/m or N m/rad, up to far beyond anything that is not rigid.
    Stiffness, "type": "number", "exclusiveMinimum": 0, "maximum": 1000000000000000000u64
);
range!(
    /// Stiffness of a contact, N/m, from far below that of rubber to far beyond that of steel; TOML's `inf` is allowed and
    /// means "rigid".
    ContactStiffness, "type": "number", "minimum": 1000, "maximum": 1000000000000u64, "x-infinite": true
);
range!(
    /// Damping of 0 or more, N s/m or N m s/rad, or ratio to the critical damping.
    Damping, "type": "number", "minimum": 0, "maximum": 1000000000000000000u64
);
range!(
    /// Number above 0; TOML's `inf` is allowed and means "no limit".
    PositiveOrInfinite, "type": "number", "exclusiveMinimum": 0, "x-infinite": true
);
range!(
    /// Number of 0 or more.
    NonNegative, "type": "number", "minimum": 0
);
range!(
    /// Friction coefficient: up to far beyond any material, where products of numbers still have all their digits.
    Coefficient, "type": "number", "minimum": 0, "maximum": 1000
);
range!(
    /// Density, kg/m³: from a gas to far beyond any rock.
    Density, "type": "number", "minimum": 1, "maximum": 1000000
);
range!(
    /// Acceleration of gravity, m/s².
    Gravity, "type": "number", "minimum": 0, "maximum": 1000
);
range!(
    /// Number of load cycles.
    Cycles, "type": "integer", "minimum": 1, "maximum": 1000000
);
range!(
    /// Relaxation factor, from steps that still make progress to full ones.
    Relaxation, "type": "number", "minimum": 0.01, "maximum": 1
);
range!(
    /// Number from 0 to 1.
    Fraction, "type": "number", "minimum": 0, "maximum": 1
);
range!(
    /// Number above 0 and up to 1.
    Ratio, "type": "number", "exclusiveMinimum": 0, "maximum": 1
);
range!(
    /// Parameter of the θ-scheme, from 1/2 to 1.
    Theta, "type": "number", "minimum": 0.5, "maximum": 1
);
range!(
    /// Whole number of 1 or more.
    Count, "type": "integer", "minimum": 1, "maximum": 4294967295u64
);
range!(
    /// Number of points of a hull: from a tetrahedron to the most whose edges and faces are large enough for detection.
    Corners, "type": "integer", "minimum": 4, "maximum": 100
);
range!(
    /// Number of sleepers in a row.
    RowCount, "type": "integer", "minimum": 1, "maximum": 1000
);
range!(
    /// Number of different grain shapes.
    ShapeCount, "type": "integer", "minimum": 1, "maximum": 10000
);
range!(
    /// Random seed; TOML's integers are signed.
    Seed, "type": "integer", "minimum": 0, "maximum": 9223372036854775807u64
);
range!(
    /// Simulated seconds; the largest value keeps nanoseconds exact.
    Duration, "type": "number", "exclusiveMinimum": 0, "maximum": 1000000
);
range!(
    /// Simulated seconds, or 0.
    Pause, "type": "number", "minimum": 0, "maximum": 1000000
);
range!(
    /// Number of a pair of tines.
    PairNumber, "type": "integer", "minimum": 0, "maximum": 100000
);
