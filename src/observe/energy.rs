//! Energy ledger of a run (T-14) at any state.

use crate::integrate;
use crate::model::Model;
use crate::state::{EnergyLedger, State};

/// Returns the energy ledger with kinetic and potential energy of the current state, J (T-14).
///
/// The step keeps the ledger; this also holds before the first step and for a state that was
/// changed by hand, whose change then shows as balance error.
pub fn energy(model: &Model, state: &State) -> EnergyLedger {
    if state.step == 0 {
        return integrate::open_ledger(model, state);
    }
    let (kinetic, potential) = integrate::mechanical_energy(model, state);
    EnergyLedger { kinetic, potential, ..state.energy }
}

/// Mean speed of the grains' centres, m/s, which is small in a settled bed. Summed in the order of the grains.
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
    fn a_moving_and_a_rotating_brick() {
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
        // Raised by hand during a run, without external work.
        (state.energy, state.step) = (start, 1);
        state.position[0].z += 0.5;
        assert!((energy(&model, &state).balance_error() - 10_000.0).abs() < 1e-9);
    }
}
