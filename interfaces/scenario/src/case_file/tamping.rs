//! `[tamping]`: lift, insertion, squeeze, hold, withdrawal, release; then traffic.

use super::range::{Cycles, Duration, Finite, NonNegative, Pause, Positive, PositiveOrInfinite};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One tamping cycle: lift, insertion, squeeze, hold, withdrawal, release, traffic, one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TampingSection {
    /// Start of the cycle, s.
    #[schemars(with = "Pause")]
    pub start_s: f64,
    /// Lift of the tamped sleepers.
    pub lift: LiftSection,
    /// Insertion of the tines into the bed.
    pub insertion: InsertionSection,
    /// Squeeze of the tines towards the sleeper.
    pub squeeze: SqueezeSection,
    /// Duration of the hold between squeeze and withdrawal, with vibration, s.
    #[schemars(with = "Pause")]
    pub hold_s: f64,
    /// Duration of the withdrawal, with vibration, s. Absent: what the other phases leave of the run.
    #[schemars(with = "Option<Duration>")]
    pub withdrawal_s: Option<f64>,
    /// Release of the tamped sleepers onto the ballast. Absent: they stay lifted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub release: Option<ReleaseSection>,
    /// Load cycles on the tamped sleepers after the release. Their mounts must be free or have a spring in z. Absent: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub traffic: Option<LoadCyclesSection>,
    /// Vibration of the tines.
    pub vibration: VibrationSection,
}

impl Default for TampingSection {
    fn default() -> Self {
        Self {
            start_s: 0.0,
            lift: LiftSection::default(),
            insertion: InsertionSection::default(),
            squeeze: SqueezeSection::default(),
            hold_s: 0.1,
            withdrawal_s: None,
            release: None,
            traffic: None,
            vibration: VibrationSection::default(),
        }
    }
}

/// Lift of the tamped sleepers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LiftSection {
    /// Height of the lift, m.
    #[schemars(with = "NonNegative")]
    pub height_m: f64,
    /// Duration of the lift, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
}

impl Default for LiftSection {
    fn default() -> Self {
        Self { height_m: 0.02, duration_s: 0.2 }
    }
}

/// Release of the tamped sleepers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReleaseSection {
    /// Duration of the release, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Level at which the sleepers are held after the release, m above that before the lift: through the spring of their
    /// mount, where they have one. Absent: that of the lift.
    #[schemars(with = "Option<Finite>")]
    pub height_m: Option<f64>,
}

impl Default for ReleaseSection {
    fn default() -> Self {
        Self { duration_s: 0.2, height_m: None }
    }
}

/// Vertical load cycles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadCyclesSection {
    /// Number of load cycles.
    #[schemars(with = "Cycles")]
    pub cycles: u32,
    /// Largest load on each sleeper, N.
    #[serde(rename = "max_load_N")]
    #[schemars(with = "Positive")]
    pub max_load: f64,
    /// Smallest load between two cycles, N.
    #[serde(rename = "min_load_N", default)]
    #[schemars(with = "NonNegative")]
    pub min_load: f64,
    /// Load cycles per second, Hz.
    #[serde(rename = "frequency_Hz")]
    #[schemars(with = "Positive")]
    pub frequency: f64,
}

/// Insertion of the tines into the bed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct InsertionSection {
    /// Duration of the insertion, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Depth of the blade's upper edge below the underside of the lifted sleeper, m.
    #[schemars(with = "Finite")]
    pub depth_m: f64,
    /// Height of the blade's lower edge above the filled bed at the start, m.
    #[schemars(with = "NonNegative")]
    pub clearance_m: f64,
    /// Force of the bed above which lowering pauses, N per tine, averaged over a vibration period (without vibration over
    /// a tenth of the squeeze). A paused insertion may continue until the withdrawal. `inf`: never pauses.
    #[serde(rename = "force_limit_N")]
    #[schemars(with = "PositiveOrInfinite")]
    pub force_limit: f64,
}

impl Default for InsertionSection {
    fn default() -> Self {
        Self { duration_s: 0.45, depth_m: 0.018, clearance_m: 0.02, force_limit: 5000.0 }
    }
}

/// Squeeze of the tines towards the sleeper.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SqueezeSection {
    /// Duration of the squeeze, s.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Maximum closing of each side, m.
    #[schemars(with = "NonNegative")]
    pub stroke_m: f64,
    /// Mean force of a pair above which it stops closing, N, averaged over a vibration period (without vibration over a
    /// tenth of the squeeze). `inf`: never stops.
    #[serde(rename = "force_limit_N")]
    #[schemars(with = "PositiveOrInfinite")]
    pub force_limit: f64,
}

impl Default for SqueezeSection {
    fn default() -> Self {
        Self { duration_s: 0.8, stroke_m: 0.08, force_limit: 7800.0 }
    }
}

/// Sinusoidal vibration along x, facing tines in opposition.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct VibrationSection {
    /// Frequency, Hz.
    #[serde(rename = "frequency_Hz")]
    #[schemars(with = "Positive")]
    pub frequency: f64,
    /// Amplitude of the machine's motion at the tine's holder, m. 0: no vibration. A blade on a flexible shaft has a larger
    /// amplitude in the air, about `1 / |1 - (f / f0)²|` times with the shaft's natural frequency f0, and a smaller one in
    /// the ballast.
    #[schemars(with = "NonNegative")]
    pub amplitude_m: f64,
}

impl Default for VibrationSection {
    fn default() -> Self {
        Self { frequency: 35.0, amplitude_m: 0.005 }
    }
}
