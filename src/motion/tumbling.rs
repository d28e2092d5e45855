//! A grain that tumbles without contacts: its angular momentum stays what it is (T-1).

use crate::math::{Quat, Vec3, rotation};
use crate::model::Stepping;

/// A rotation that changes by this much of a radian or less is the same.
const SMALL: f64 = 1e-15;
/// Each pass leaves about the angle turned in the step of the error of the one before.
const MAX_PASSES: usize = 16;

/// Angular velocity (world axes, rad/s) at the end of a step without contacts of a body with the principal
/// moments `inertia` (kg m²), the orientation `start` and the spin `spin`; `middle` is configuration m.
///
/// Solves `D Ω = exp(-θ h Ω) L` in the axes of configuration m. Every pass turns `L`, so its length is kept
/// to rounding however far a stone turns in a step, and a spin never grows by itself; its direction is
/// kept where the passes converge, up to about a radian per step.
pub fn free_spin(
    inertia: &Vec3,
    start: &Quat,
    middle: &Quat,
    spin: &Vec3,
    stepping: &Stepping,
) -> Vec3 {
    let own = (start.inverse() * spin).component_mul(inertia);
    let momentum = middle.inverse() * (start * own);
    let after = -stepping.theta * stepping.h();
    let mut turning = momentum.component_div(inertia);
    for _ in 0..MAX_PASSES {
        let turned = rotation::exp(&(turning * after)) * momentum;
        let next = turned.component_div(inertia);
        let change = (next - turning).amax() * after.abs();
        turning = next;
        // Written so that what is no number ends the passes, too: it is refused later, by name.
        if !(change > SMALL) {
            break;
        }
    }
    middle * turning
}
