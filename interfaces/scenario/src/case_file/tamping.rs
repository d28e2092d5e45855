//! `[tamping]`: lift, insertion, squeeze, hold, withdrawal.

use super::range::{Duration, Finite, NonNegative, Pause, Positive, PositiveOrInfinite};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One tamping cycle: lift, insertion, squeeze, hold, withdrawal, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Tamping {
    /// Start of the cycle, s.
    #[schemars(with = "Pause")]
    pub start_s: f64,
    /// Lifting of the tamped sleepers.
    pub lift: Lift,
    /// The tines go down.
    pub insertion: Insertion,
    /// The tines close on the sleeper.
    pub squeeze: Squeeze,
    /// Rest between squeeze and withdrawal, vibration on, s.
    #[schemars(with = "Pause")]
    pub hold_s: f64,
    /// Time of the withdrawal, vibration on, s. Absent: the rest of the run.
    #[schemars(with = "Option<Duration>")]
    pub withdrawal_s: Option<f64>,
    /// Vibration of the tines.
    pub vibration: Vibration,
}

impl Default for Tamping {
    fn default() -> Self {
        Self {
            start_s: 0.0,
            lift: Lift::default(),
            insertion: Insertion::default(),
            squeeze: Squeeze::default(),
            hold_s: 0.1,
            withdrawal_s: None,
            vibration: Vibration::default(),
        }
    }
}

/// Lifting of the tamped sleepers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Lift {
    /// How far they are lifted, m.
    #[schemars(with = "NonNegative")]
    pub height_m: f64,
    /// How long it takes, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
}

impl Default for Lift {
    fn default() -> Self {
        Self { height_m: 0.02, duration_s: 0.2 }
    }
}

/// The tines go down into the bed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Insertion {
    /// How long it takes, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Depth of the blade's upper edge below the underside of the lifted sleeper, m.
    #[schemars(with = "Finite")]
    pub depth_m: f64,
    /// Height of the blade's lower edge above the filled bed at the start, m.
    #[schemars(with = "NonNegative")]
    pub clearance_m: f64,
    /// Lowering stops while the bed carries more than this, N per tine over a vibration period (without vibration a
    /// tenth of the squeeze), and goes on until the withdrawal. `inf`: never.
    #[serde(rename = "force_limit_N")]
    #[schemars(with = "PositiveOrInfinite")]
    pub force_limit: f64,
}

impl Default for Insertion {
    fn default() -> Self {
        Self { duration_s: 0.45, depth_m: 0.018, clearance_m: 0.02, force_limit: 5000.0 }
    }
}

/// The tines close on the sleeper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Squeeze {
    /// How long it takes, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Largest closing of each side, m.
    #[schemars(with = "NonNegative")]
    pub stroke_m: f64,
    /// A pair stops closing while its mean force over a vibration period (without vibration a tenth of the squeeze)
    /// exceeds this, N. `inf`: never.
    #[serde(rename = "force_limit_N")]
    #[schemars(with = "PositiveOrInfinite")]
    pub force_limit: f64,
}

impl Default for Squeeze {
    fn default() -> Self {
        Self { duration_s: 0.8, stroke_m: 0.08, force_limit: 7800.0 }
    }
}

/// Sinusoidal vibration along x, facing tines in opposition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Vibration {
    /// Frequency, Hz.
    #[serde(rename = "frequency_Hz")]
    #[schemars(with = "Positive")]
    pub frequency: f64,
    /// Amplitude that the machine imposes on the tine's holder, m. 0: no vibration. A blade on a springy shaft swings further
    /// in the air, about `1 / |1 - (f / f0)²|` times with the shaft's own frequency f0, and less in the ballast.
    #[schemars(with = "NonNegative")]
    pub amplitude_m: f64,
}

impl Default for Vibration {
    fn default() -> Self {
        Self { frequency: 35.0, amplitude_m: 0.005 }
    }
}
