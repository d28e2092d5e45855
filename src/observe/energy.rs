//! The energy ledger of a run (T-14), at any moment.

use crate::integrate;
use crate::model::Model;
use crate::state::{EnergyLedger, State};

/// The ledger with kinetic and potential energy of the state as it is now, J (T-14).
///
/// The step keeps the ledger; this also holds before the first step and for a state that was
/// changed by hand, whose change then shows as balance error.
pub fn energy(model: &Model, state: &State) -> EnergyLedger {
    if state.step == 0 {
        return integrate::open_ledger(model, state);
    }
    let (kinetic, potential) = integrate::energies(model, state);
    EnergyLedger { kinetic, potential, ..state.energy }
}

/// Mean speed of the grains' centres, m/s: what tells a bed at rest. Summed in order, one after another.
pub fn mean_speed(model: &Model, state: &State) -> f64 {
    let grains = model.grains.len();
    state.velocity[..grains].iter().map(|v| v.norm()).sum::<f64>() / grains.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;
    use crate::math::{Vec3, rotation};

    #[test]
    fn a_moving_and_a_spinning_brick() {
        let mut model = scene::cubes(2);
        model.grains.inertia[1] = Vec3::new(1.0, 2.0, 3.0);
        let mut state = scene::at(&[[5.0, 0.0, 3.0], [0.0, 7.0, -1.0]]);
        state.velocity[0] = Vec3::new(1.0, -2.0, 2.0);
        // Spin about the brick's own y axis, which points along the world's x axis.
        state.orientation[1] = rotation::exp(&(Vec3::z() * -std::f64::consts::FRAC_PI_2));
        state.angular_velocity[1] = Vec3::x() * 4.0;
        let start = energy(&model, &state);
        assert!((start.kinetic - (0.5 * 2000.0 * 9.0 + 0.5 * 2.0 * 16.0)).abs() < 1e-11);
        assert_eq!(start.potential, 2000.0 * 10.0 * (3.0 - 1.0));
        assert_eq!(start.balance_error(), 0.0);
        // Raised by hand in the middle of a run: nobody did that work.
        (state.energy, state.step) = (start, 1);
        state.position[0].z += 0.5;
        assert!((energy(&model, &state).balance_error() - 10_000.0).abs() < 1e-9);
    }
}
