//! List of the variables of a unit, from the bodies and zones of its case.
//!
//! Reads: the bed. Contract: the same bed has the same variables in description and library.

use crate::bed::UnitBed;
use crate::variables::{ARRAYS, Quantity, ValueType, Variable, VariableUse, pose_values};
use ballast::model::{DofMode, Role};
use std::ops::Range;

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

    /// Lists variables in the order of their elements.
    pub fn from_variables(variables: Vec<Variable>) -> Self {
        let elements = |(k, variable): (usize, &Variable)| std::iter::repeat_n(k, variable.count);
        let owner = variables.iter().enumerate().flat_map(elements).collect();
        Self { variables, owner }
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
            unit: unit.into(),
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
            "Time at which the inputs set before a step hold: 1, end of the step, or 2, start of the step, extrapolated with the velocities",
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
            Role::Plate => "reference point of the boxes",
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
            if body.role != Role::Tine || mount.dof_modes.contains(&DofMode::Free) {
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
