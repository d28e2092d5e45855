//! Values of the output variables after a window.

use crate::variable_table::VariableTable;
use crate::variables::{Quantity, VariableUse, pose_values};
use ballast::component::WindowResult;
use ballast::math::Vec3;

/// Writes the outputs of a window to the elements of an instance.
pub(crate) fn write(table: &VariableTable, result: &WindowResult, values: &mut [f64]) {
    let outputs = table.variables.iter().filter(|v| v.usage == VariableUse::Output);
    for variable in outputs {
        let place = &mut values[variable.elements()];
        match value(variable.quantity, result) {
            OutputValue::Number(number) => place[0] = number,
            OutputValue::Vector(v) => place.copy_from_slice(v.as_slice()),
            OutputValue::Elements(elements) => place.copy_from_slice(&elements),
            OutputValue::Unchanged => {}
        }
    }
}

enum OutputValue {
    Number(f64),
    Vector(Vec3),
    Elements(Vec<f64>),
    Unchanged,
}

fn value(quantity: Quantity, result: &WindowResult) -> OutputValue {
    use OutputValue::{Elements, Number, Unchanged, Vector};
    let body = |d: usize| &result.bodies[d];
    let zone = |z: usize| result.zones.get(z);
    // Zones are measured where something was computed.
    let measured = |value: Option<Option<f64>>| {
        value.map_or(Unchanged, |value| Number(value.unwrap_or(f64::NAN)))
    };
    let solver = &result.solver;
    match quantity {
        Quantity::Force(d) => Vector(body(d).mean_force),
        Quantity::Torque(d) => Vector(body(d).mean_torque),
        Quantity::AverageForce(d) => Vector(body(d).moving_average_force),
        Quantity::AverageTorque(d) => Vector(body(d).moving_average_torque),
        Quantity::Work(d) => Number(body(d).work),
        Quantity::BodyContacts(d) => Number(f64::from(body(d).contacts)),
        Quantity::BodyPosition(d) => Vector(body(d).pose.position),
        Quantity::BodyOrientation(d) => Elements(pose_values(&body(d).pose)[1].clone()),
        Quantity::BodyVelocity(d) => Vector(body(d).velocity),
        Quantity::BodyAngularVelocity(d) => Vector(body(d).angular_velocity),
        Quantity::Compactness(z) => measured(zone(z).map(|z| z.compactness)),
        Quantity::Coordination(z) => measured(zone(z).map(|z| z.coordination)),
        Quantity::Pressure(z) => measured(zone(z).map(|z| Some(z.pressure))),
        Quantity::StepsNotConverged => Number(solver.steps_not_converged as f64),
        Quantity::Iterations => Number(solver.iterations as f64),
        Quantity::Residual => Number(solver.residual_qm16),
        Quantity::Contacts => Number(solver.contacts as f64),
        Quantity::Penetration => Number(solver.max_penetration),
        _ => Unchanged,
    }
}
