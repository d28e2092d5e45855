//! A body that tumbles: its angular momentum changes by the moments on it, and by nothing else (T-1).

use crate::math::{Mat3, Quat, Vec3, rotation};
use crate::model::Stepping;

/// A rotation that changes by this much of a radian or less is the same.
const CONVERGED_ANGLE: f64 = 1e-15;
/// Each pass leaves about the angle turned in the step of the error of the one before.
const MAX_PASSES: usize = 16;

/// Inertia in the body's axes, kg m².
pub trait Inertia {
    /// Angular momentum of a angular velocity, in the body's axes both.
    fn momentum(&self, angular_velocity: &Vec3) -> Vec3;

    /// Spin of an angular momentum.
    fn angular_velocity(&self, momentum: &Vec3) -> Vec3;

    /// Angular momentum of a angular velocity, in the world's axes both.
    fn momentum_at(&self, q: &Quat, angular_velocity: &Vec3) -> Vec3 {
        q * self.momentum(&(q.inverse() * angular_velocity))
    }

    /// Spin of an angular momentum, in the world's axes both.
    fn spin_at(&self, q: &Quat, momentum: &Vec3) -> Vec3 {
        q * self.angular_velocity(&(q.inverse() * momentum))
    }
}

/// Principal moments.
impl Inertia for Vec3 {
    fn momentum(&self, angular_velocity: &Vec3) -> Vec3 {
        self.component_mul(angular_velocity)
    }

    fn angular_velocity(&self, momentum: &Vec3) -> Vec3 {
        momentum.component_div(self)
    }
}

/// Inertia about another point than the centre of mass, and its inverse.
pub struct InertiaTensor(pub Mat3, pub Mat3);

impl Inertia for InertiaTensor {
    fn momentum(&self, angular_velocity: &Vec3) -> Vec3 {
        self.0 * angular_velocity
    }

    fn angular_velocity(&self, momentum: &Vec3) -> Vec3 {
        self.1 * momentum
    }
}

/// A body at the start of a step.
pub struct FreeRotation<'a, I> {
    pub inertia: &'a I,
    pub start: &'a Quat,
    /// World axes, rad/s.
    pub angular_velocity: &'a Vec3,
}

impl<I: Inertia> FreeRotation<'_, I> {
    /// Angular velocity (world axes, rad/s) at the end of a step without contacts; `middle` is configuration m.
    ///
    /// Solves `D Ω = exp(-θ h Ω) L` in the axes of configuration m. Every pass turns `L`, so its length is kept
    /// to rounding however far a stone turns in a step, and a angular velocity never grows by itself; its direction is
    /// kept where the passes converge, up to about a radian per step.
    pub fn free_angular_velocity(&self, middle: &Quat, stepping: &Stepping) -> Vec3 {
        let inertia = self.inertia;
        let own = inertia.momentum(&(self.start.inverse() * self.angular_velocity));
        let momentum = middle.inverse() * (self.start * own);
        let after = -stepping.theta * stepping.h();
        let mut turning = inertia.angular_velocity(&momentum);
        for _ in 0..MAX_PASSES {
            let turned = rotation::exp(&(turning * after)) * momentum;
            let next = inertia.angular_velocity(&turned);
            let change = (next - turning).amax() * after.abs();
            turning = next;
            // Written so that what is no number ends the passes, too: it is refused later, by name.
            if !(change > CONVERGED_ANGLE) {
                break;
            }
        }
        middle * turning
    }

    /// Angular velocity where the step ends, at the orientation `end`: that of the angular momentum at the start and of the
    /// moments since, which have changed the angular velocity from `free` to `solved` at configuration m.
    pub fn angular_velocity_at_end(
        &self,
        middle: &Quat,
        [free, solved]: [&Vec3; 2],
        end: &Quat,
    ) -> Vec3 {
        let own = self.inertia.momentum_at(self.start, self.angular_velocity);
        let moments = self.inertia.momentum_at(middle, &(solved - free));
        self.inertia.spin_at(end, &(own + moments))
    }
}
