//! Variables of a unit: names, types, meaning, value references.
//!
//! All numbers of an instance are one array, the *elements*; a variable is a range of it. Value reference `1 + e` is
//! element `e` alone, and `ARRAYS + e` the whole variable that begins at element `e` (FMI 3.0).

use ballast::math::Pose;
use serde::{Deserialize, Deserializer, Serialize};
use std::ops::Range;

/// Value reference of the time, the independent variable (FMI 3.0).
pub const TIME: u32 = 0;
/// First value reference of whole arrays.
pub const ARRAYS: u32 = 1 << 24;

/// Type of a variable's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ValueType {
    /// Real number.
    Real,
    /// Whole number.
    Integer,
    /// Value of [`INPUT_TIMES`], from 1.
    InputTime,
    /// Text: the hash of the state.
    Text,
}

/// Names of the values of `inputs_at`, and their descriptions.
pub const INPUT_TIMES: [(&str, &str); 2] = [
    ("end", "The inputs hold at the end of the step; the motion leads there"),
    ("start", "The inputs hold at the start of the step and are extrapolated with the velocities"),
];

/// Causality and variability of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum VariableUse {
    /// Continuous input.
    Input,
    /// Output, new after each step.
    Output,
    /// Parameter to be set before the simulation.
    Fixed,
    /// Parameter that may change between steps.
    Tunable,
    /// Constant.
    Constant,
    /// Local variable.
    Local,
}

/// Meaning of a variable; the number is that of a driven body or of a zone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs)]
pub enum Quantity {
    Step,
    InputsAt,
    Threads,
    MaxIterations,
    Tolerance,
    MaxPenetration,
    Position(usize),
    Orientation(usize),
    Velocity(usize),
    AngularVelocity(usize),
    LoadForce(usize),
    LoadTorque(usize),
    BodyPosition(usize),
    BodyOrientation(usize),
    BodyVelocity(usize),
    BodyAngularVelocity(usize),
    Force(usize),
    Torque(usize),
    AverageForce(usize),
    AverageTorque(usize),
    Work(usize),
    BodyContacts(usize),
    Compactness(usize),
    Coordination(usize),
    Pressure(usize),
    StepsNotConverged,
    Iterations,
    Residual,
    Contacts,
    Penetration,
    StateHash,
}

impl Quantity {
    /// Returns the driven body whose motion the variable gives.
    pub fn moved_body(self) -> Option<usize> {
        match self {
            Quantity::Position(d) | Quantity::Orientation(d) => Some(d),
            other => other.twisted_body(),
        }
    }

    /// Returns the driven body whose velocity or angular velocity the variable gives.
    pub fn twisted_body(self) -> Option<usize> {
        match self {
            Quantity::Velocity(d) | Quantity::AngularVelocity(d) => Some(d),
            _ => None,
        }
    }
}

/// Variable of a unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Variable {
    /// Structured name; a scalar of an array has its number from 1 in brackets behind it.
    pub name: String,
    /// First element.
    pub first: usize,
    /// Number of elements: 1, or the length of the array.
    pub count: usize,
    /// Type of the values.
    pub kind: ValueType,
    /// Causality and variability.
    pub usage: VariableUse,
    /// Meaning.
    pub quantity: Quantity,
    /// Unit; empty without one.
    pub unit: String,
    /// Sentence with frame, sign and reference point.
    pub description: String,
    /// Values at the start `[count]`; NaN, in JSON `null`, where undefined.
    #[serde(deserialize_with = "numbers_or_null")]
    pub start: Vec<f64>,
}

impl Variable {
    /// Returns the range of the variable's elements.
    pub fn elements(&self) -> Range<usize> {
        self.first..self.first + self.count
    }

    /// Returns the value reference of the whole variable.
    pub fn reference(&self) -> u32 {
        if self.count == 1 { scalar_reference(self.first) } else { ARRAYS + self.first as u32 }
    }

    /// Returns the name of element `k` of the variable.
    pub fn scalar_name(&self, k: usize) -> String {
        if self.count == 1 { self.name.clone() } else { format!("{}[{}]", self.name, k + 1) }
    }
}

/// Deserializes numbers; JSON writes NaN as `null`.
fn numbers_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f64>, D::Error> {
    let numbers = Vec::<Option<f64>>::deserialize(deserializer)?;
    Ok(numbers.into_iter().map(|number| number.unwrap_or(f64::NAN)).collect())
}

/// Returns the value reference of an element.
pub fn scalar_reference(element: usize) -> u32 {
    1 + element as u32
}

/// Returns position, and orientation x, y, z, w.
pub(crate) fn pose_values(pose: &Pose) -> [Vec<f64>; 2] {
    let (p, q) = (&pose.position, &pose.orientation);
    [vec![p.x, p.y, p.z], vec![q.i, q.j, q.k, q.w]]
}
