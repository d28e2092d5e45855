//! Variables of a unit, from the bodies and zones of its case.
//!
//! Reads: the bed. Contract: the same bed has the same variables in description and library. All numbers of an instance
//! are one array, the *elements*; a variable is a range of it. Value reference `1 + e` is element `e` alone, and
//! `ARRAYS + e` the whole variable that begins at element `e` (FMI 3.0).

use crate::bed::UnitBed;
use ballast::math::Pose;
use ballast::model::{DofMode, Role};
use std::ops::Range;

/// Value reference of the time, the independent variable (FMI 3.0).
pub const TIME: u32 = 0;
/// First value reference of whole arrays.
pub const ARRAYS: u32 = 1 << 24;

/// Type of a variable's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
#[derive(Debug, Clone, PartialEq)]
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
    pub unit: &'static str,
    /// Sentence with frame, sign and reference point.
    pub description: String,
    /// Values at the start `[count]`.
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

/// Returns the value reference of an element.
pub fn scalar_reference(element: usize) -> u32 {
    1 + element as u32
}

/// Variables of a unit.
#[derive(Debug, Clone, PartialEq)]
pub struct VariableTable {
    /// Variables in the order of their elements.
    pub variables: Vec<Variable>,
    /// Variable of each element.
    owner: Vec<usize>,
}

impl VariableTable {
    /// Lists the variables of a bed.
    pub fn new(bed: &UnitBed) -> Self {
        let mut table = Self { variables: Vec::new(), owner: Vec::new() };
        table.add_parameters(bed);
        for d in 0..bed.model.driven.len() {
            // Walls and floor stand still.
            if bed.model.driven[d].role != Role::Boundary {
                table.add_body(bed, d);
            }
        }
        table.add_zones(bed);
        table.add_solver();
        table
    }

    /// Returns the number of elements.
    pub fn element_count(&self) -> usize {
        self.owner.len()
    }

    /// Returns the values of all elements at the start.
    pub fn start_values(&self) -> Vec<f64> {
        self.variables.iter().flat_map(|v| v.start.iter().copied()).collect()
    }

    /// Returns the variable of a value reference, and the elements that it stands for.
    pub fn find(&self, reference: u32) -> Option<(&Variable, Range<usize>)> {
        if let Some(first) = reference.checked_sub(ARRAYS) {
            let variable = &self.variables[*self.owner.get(first as usize)?];
            let is_array = variable.count > 1 && variable.first == first as usize;
            return is_array.then(|| (variable, variable.elements()));
        }
        let element = reference.checked_sub(1)? as usize;
        let variable = &self.variables[*self.owner.get(element)?];
        Some((variable, element..element + 1))
    }

    /// Returns the first element of a quantity.
    pub fn first(&self, quantity: Quantity) -> Option<usize> {
        self.variables.iter().find(|v| v.quantity == quantity).map(|v| v.first)
    }

    fn add(
        &mut self,
        name: impl Into<String>,
        (quantity, usage, kind): (Quantity, VariableUse, ValueType),
        unit: &'static str,
        description: impl Into<String>,
        start: &[f64],
    ) {
        let (first, count) = (self.owner.len(), start.len());
        self.owner.extend(std::iter::repeat_n(self.variables.len(), count));
        self.variables.push(Variable {
            name: name.into(),
            first,
            count,
            kind,
            usage,
            quantity,
            unit,
            description: description.into(),
            start: start.to_vec(),
        });
    }

    fn add_parameters(&mut self, bed: &UnitBed) {
        use ValueType::{InputTime, Integer, Real};
        use VariableUse::{Constant, Fixed, Tunable};
        let (h, solver) = (bed.model.stepping.h(), &bed.model.solver);
        self.add(
            "step_s",
            (Quantity::Step, Constant, Real),
            "s",
            "Time step; a communication step is a whole number of time steps",
            &[h],
        );
        self.add(
            "inputs_at",
            (Quantity::InputsAt, Fixed, InputTime),
            "",
            "Time at which the inputs set before a step hold",
            &[1.0],
        );
        self.add(
            "threads",
            (Quantity::Threads, Fixed, Integer),
            "",
            "Number of worker threads (0: one per processor); the results do not depend on it",
            &[0.0],
        );
        self.add(
            "solver.max_iterations",
            (Quantity::MaxIterations, Tunable, Integer),
            "",
            "Largest number of iterations per time step, at least 1",
            &[f64::from(solver.max_iterations)],
        );
        self.add(
            "solver.tolerance",
            (Quantity::Tolerance, Tunable, Real),
            "",
            "Tolerance of the solver (0: all iterations)",
            &[solver.tolerance.unwrap_or(0.0)],
        );
        self.add(
            "solver.max_penetration",
            (Quantity::MaxPenetration, Tunable, Real),
            "m",
            "Penetration that a step may add at most; a step beyond is discarded (0: no limit)",
            &[0.0],
        );
    }

    fn add_body(&mut self, bed: &UnitBed, d: usize) {
        use ValueType::{Integer, Real};
        use VariableUse::{Input, Output};
        let body = &bed.model.driven[d];
        let point = match body.role {
            Role::Tine => "middle of the upper edge of the blade",
            Role::Sleeper => "centre of the underside",
            Role::Boundary => "origin",
        };
        let name = identifier(&body.name);
        let name = |leaf: &str| format!("{name}.{leaf}");
        let holder = if body.mount.is_some() { "What holds the body: " } else { "" };
        let axes = "world axes, x along the track, z up";
        let imposed = bed.state.imposed(&bed.model, d);
        let [position, orientation] = pose_values(&imposed);
        let zero = [0.0; 3];
        let about = format!("by the ballast on the body, {axes}, about the {point}");
        let inputs: [(_, _, _, String, &[f64]); 4] = [
            (
                "position",
                Quantity::Position(d),
                "m",
                format!("{holder}position of the {point}, {axes}"),
                &position,
            ),
            (
                "orientation",
                Quantity::Orientation(d),
                "",
                format!("{holder}unit quaternion x, y, z, w, body to world"),
                &orientation,
            ),
            (
                "velocity",
                Quantity::Velocity(d),
                "m/s",
                format!("{holder}velocity of the {point}, {axes}"),
                &zero,
            ),
            (
                "angular_velocity",
                Quantity::AngularVelocity(d),
                "rad/s",
                format!("{holder}angular velocity, {axes}"),
                &zero,
            ),
        ];
        for (leaf, quantity, unit, description, start) in inputs {
            self.add(name(leaf), (quantity, Input, Real), unit, description, start);
        }
        if let Some(mount) = &body.mount {
            if body.role == Role::Sleeper || mount.dof_modes.contains(&DofMode::Free) {
                let load = format!(
                    "on the body besides its weight, {axes}, about the {point}; acts along free and spring degrees of freedom"
                );
                self.add(
                    name("load_force"),
                    (Quantity::LoadForce(d), Input, Real),
                    "N",
                    format!("Force {load}"),
                    &zero,
                );
                self.add(
                    name("load_torque"),
                    (Quantity::LoadTorque(d), Input, Real),
                    "N.m",
                    format!("Torque {load}"),
                    &zero,
                );
            }
            let [position, orientation] = pose_values(&bed.state.pose(bed.model.grains.len() + d));
            let outputs: [(_, _, _, String, &[f64]); 4] = [
                (
                    "body_position",
                    Quantity::BodyPosition(d),
                    "m",
                    format!("Position of the {point}, {axes}"),
                    &position,
                ),
                (
                    "body_orientation",
                    Quantity::BodyOrientation(d),
                    "",
                    "Unit quaternion x, y, z, w, body to world".into(),
                    &orientation,
                ),
                (
                    "body_velocity",
                    Quantity::BodyVelocity(d),
                    "m/s",
                    format!("Velocity of the {point}, {axes}"),
                    &zero,
                ),
                (
                    "body_angular_velocity",
                    Quantity::BodyAngularVelocity(d),
                    "rad/s",
                    format!("Angular velocity, {axes}"),
                    &zero,
                ),
            ];
            for (leaf, quantity, unit, description, start) in outputs {
                self.add(name(leaf), (quantity, Output, Real), unit, description, start);
            }
        }
        let forces = [
            ("force", Quantity::Force(d), "N", format!("Force {about}; mean over the step")),
            ("torque", Quantity::Torque(d), "N.m", format!("Torque {about}; mean over the step")),
            (
                "average_force",
                Quantity::AverageForce(d),
                "N",
                format!("Force {about}; mean over the last 4 ms"),
            ),
            (
                "average_torque",
                Quantity::AverageTorque(d),
                "N.m",
                format!("Torque {about}; mean over the last 4 ms"),
            ),
        ];
        for (leaf, quantity, unit, description) in forces {
            self.add(name(leaf), (quantity, Output, Real), unit, description, &zero);
        }
        self.add(
            name("work"),
            (Quantity::Work(d), Output, Real),
            "J",
            "Work by the body on the ballast in the step",
            &[0.0],
        );
        self.add(
            name("contacts"),
            (Quantity::BodyContacts(d), Output, Integer),
            "",
            "Number of contact points that carry a force",
            &[0.0],
        );
    }

    fn add_zones(&mut self, bed: &UnitBed) {
        use {ValueType::Real, VariableUse::Output};
        let measured = ballast::component::measure_zones(&bed.model, &bed.state, &bed.zones);
        for (z, zone) in measured.iter().enumerate() {
            let segments: Vec<String> = zone.name.split('/').map(identifier).collect();
            let name = |leaf: &str| format!("zone.{}.{leaf}", segments.join("."));
            let value = |measured: Option<f64>| [measured.unwrap_or(f64::NAN)];
            let region = format!(
                "x {:.3} to {:.3}, y {:.3} to {:.3}, z {:.3} to {:.3} m",
                zone.region.low.x,
                zone.region.high.x,
                zone.region.low.y,
                zone.region.high.y,
                zone.region.low.z,
                zone.region.high.z
            );
            self.add(
                name("compactness"),
                (Quantity::Compactness(z), Output, Real),
                "",
                format!("Solid over accessible volume in {region}; NaN where undefined"),
                &value(zone.compactness),
            );
            self.add(name("coordination"), (Quantity::Coordination(z), Output, Real), "", format!("Mean number of touching neighbours of the grains in {region}; NaN where undefined"), &value(zone.coordination));
            self.add(
                name("pressure"),
                (Quantity::Pressure(z), Output, Real),
                "Pa",
                format!("Pressure in {region}; mean over the last time step"),
                &[zone.pressure],
            );
        }
    }

    fn add_solver(&mut self) {
        use ValueType::{Integer, Real, Text};
        use VariableUse::{Local, Output};
        let of = |quantity, kind| (quantity, Output, kind);
        self.add(
            "solver.steps_not_converged",
            of(Quantity::StepsNotConverged, Integer),
            "",
            "Number of time steps that have not reached the tolerance",
            &[0.0],
        );
        self.add(
            "solver.iterations",
            of(Quantity::Iterations, Integer),
            "",
            "Number of iterations of all time steps",
            &[0.0],
        );
        self.add(
            "solver.residual",
            of(Quantity::Residual, Real),
            "",
            "Largest residual QM/16 of a time step",
            &[0.0],
        );
        self.add(
            "solver.contacts",
            of(Quantity::Contacts, Integer),
            "",
            "Number of contact points in the last time step",
            &[0.0],
        );
        self.add(
            "solver.penetration",
            of(Quantity::Penetration, Real),
            "m",
            "Largest penetration of all time steps",
            &[0.0],
        );
        self.add(
            "state_hash",
            (Quantity::StateHash, Local, Text),
            "",
            "Hash of model and state, 32 hexadecimal digits: equal states have equal hashes",
            &[0.0],
        );
    }
}

/// Returns a name as a part of a structured name, as in topics: `_` in place of `-`.
fn identifier(name: &str) -> String {
    let plain = name.replace('-', "_");
    if plain.starts_with(|c: char| c.is_ascii_digit()) { format!("_{plain}") } else { plain }
}

/// Returns position, and orientation x, y, z, w.
pub(crate) fn pose_values(pose: &Pose) -> [Vec<f64>; 2] {
    let (p, q) = (&pose.position, &pose.orientation);
    [vec![p.x, p.y, p.z], vec![q.i, q.j, q.k, q.w]]
}
