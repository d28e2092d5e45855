//! Free rotation of a rigid body: its angular momentum changes only by the moments on it (T-1).

use crate::math::{Mat3, Quat, Vec3, rotation};
use crate::model::Stepping;

/// Maximum change of a rotation that counts as converged, rad.
const CONVERGED_ANGLE: f64 = 1e-15;
/// Maximum number of fixed-point passes.
///
/// Each reduces the error by about the angle of rotation in the step.
const MAX_PASSES: usize = 16;

/// Rotation in a step, rad, times the slenderness of the body, up to which its angular velocity counts as constant.
const MAX_UNIFORM_TURN: f64 = 0.1;
/// Rotation in a step, rad, times the slenderness of the body, up to which impulses may act with the inertia of configuration m.
const MAX_BLOW_TURN: f64 = 0.3;
/// Maximum rotation in a substep of [`mean_angular_velocity`], rad.
const MAX_SUBSTEP_TURN: f64 = 0.01;
/// Maximum number of substeps.
const MAX_SUBSTEPS: f64 = 1024.0;

/// Inertia in the body's axes, kg m².
pub trait Inertia {
    /// Returns the angular momentum of an angular velocity, both in the body's axes.
    fn momentum(&self, angular_velocity: &Vec3) -> Vec3;

    /// Returns the angular velocity of an angular momentum, both in the body's axes.
    fn angular_velocity(&self, momentum: &Vec3) -> Vec3;

    /// Returns the angular momentum of an angular velocity, both in the world's axes.
    fn momentum_at(&self, q: &Quat, angular_velocity: &Vec3) -> Vec3 {
        q * self.momentum(&(q.inverse() * angular_velocity))
    }

    /// Returns the angular velocity of an angular momentum, both in the world's axes.
    fn angular_velocity_at(&self, q: &Quat, momentum: &Vec3) -> Vec3 {
        q * self.angular_velocity(&(q.inverse() * momentum))
    }
}

/// Principal moments of inertia.
impl Inertia for Vec3 {
    fn momentum(&self, angular_velocity: &Vec3) -> Vec3 {
        self.component_mul(angular_velocity)
    }

    fn angular_velocity(&self, momentum: &Vec3) -> Vec3 {
        momentum.component_div(self)
    }
}

/// Inertia tensor about any point, and its inverse.
pub struct InertiaTensor(pub Mat3, pub Mat3);

impl Inertia for InertiaTensor {
    fn momentum(&self, angular_velocity: &Vec3) -> Vec3 {
        self.0 * angular_velocity
    }

    fn angular_velocity(&self, momentum: &Vec3) -> Vec3 {
        self.1 * momentum
    }
}

/// Rotating body at the start of a step.
pub struct FreeRotation<'a, I> {
    pub inertia: &'a I,
    pub start: &'a Quat,
    /// Angular velocity, world axes, rad/s.
    pub angular_velocity: &'a Vec3,
}

impl FreeRotation<'_, Vec3> {
    /// Returns the orientation at configuration m, and the free angular velocity there (world axes, rad/s).
    ///
    /// A body that turns slowly keeps its angular velocity up to configuration m. One that turns fast, for its shape,
    /// is led along its free rotation in both parts of the step, so that it keeps its energy as well.
    pub fn predict(&self, stepping: &Stepping) -> (Quat, Vec3) {
        let h = stepping.h();
        let (before, after) = (h * (1.0 - stepping.theta), h * stepping.theta);
        if !turns_beyond(MAX_UNIFORM_TURN, self.inertia, self.angular_velocity, h) {
            let middle = rotation::advance(self.start, &(self.angular_velocity * before));
            return (middle, self.free_angular_velocity(&middle, stepping));
        }
        let own = self.inertia.momentum(&(self.start.inverse() * self.angular_velocity));
        let mean = self.start * mean_angular_velocity(self.inertia, own, before);
        let middle = rotation::advance(self.start, &(mean * before));
        let momentum = middle.inverse() * (self.start * own);
        (middle, middle * mean_angular_velocity(self.inertia, momentum, after))
    }
}

/// Returns true if a body with these principal moments turns so far in `h` seconds that its inertia changes much from
/// configuration m to the end of the step.
pub fn turns_far(inertia: &Vec3, angular_velocity: &Vec3, h: f64) -> bool {
    turns_beyond(MAX_BLOW_TURN, inertia, angular_velocity, h)
}

/// Returns true if the rotation in `h` seconds times the slenderness, the root of the ratio of the principal moments, exceeds
/// an angle, rad.
///
/// False for what is not finite, which the plain prediction refuses by name.
fn turns_beyond(angle: f64, inertia: &Vec3, angular_velocity: &Vec3, h: f64) -> bool {
    let slenderness_squared = inertia.max() / inertia.min();
    let turn_squared = angular_velocity.norm_squared() * h * h * slenderness_squared;
    turn_squared.is_finite() && turn_squared > angle * angle
}

/// Returns the mean angular velocity, rad/s, of a body without moments over `duration` seconds, in its axes at the start.
///
/// `momentum` is its angular momentum in those axes. Integrates `dL/dt = L × D⁻¹ L` in the axes of the body by the
/// classical Runge-Kutta method, and the rotation by Magnus's exponent of fourth order from a cubic through both ends of
/// each substep.
fn mean_angular_velocity(inertia: &impl Inertia, momentum: Vec3, duration: f64) -> Vec3 {
    if duration == 0.0 {
        return inertia.angular_velocity(&momentum);
    }
    let length = momentum.norm();
    let rate = |l: &Vec3| l.cross(&inertia.angular_velocity(l));
    let turn = inertia.angular_velocity(&momentum).norm() * duration;
    let substeps = (turn / MAX_SUBSTEP_TURN).ceil().clamp(1.0, MAX_SUBSTEPS);
    let dt = duration / substeps;
    let mut l = momentum;
    let mut turned = Quat::identity();
    for _ in 0..substeps as usize {
        let k1 = rate(&l);
        let k2 = rate(&(l + k1 * (0.5 * dt)));
        let k3 = rate(&(l + k2 * (0.5 * dt)));
        let k4 = rate(&(l + k3 * dt));
        let mut next = l + (k1 + (k2 + k3) * 2.0 + k4) * (dt / 6.0);
        next *= length / next.norm();
        let middle = (l + next) * 0.5 + (k1 - rate(&next)) * (0.125 * dt);
        let [w0, w, w1] = [&l, &middle, &next].map(|l| inertia.angular_velocity(l));
        let turn = (w0 + w * 4.0 + w1) * (dt / 6.0) + w0.cross(&w1) * (dt * dt / 12.0);
        turned *= rotation::exp(&turn);
        l = next;
    }
    rotation::log(&turned) / duration
}

impl<I: Inertia> FreeRotation<'_, I> {
    /// Returns the angular velocity (world axes, rad/s) at the end of a step without contacts.
    ///
    /// `middle` is the orientation at configuration m. Solves `D Ω = exp(-θ h Ω) L` in the axes of configuration m.
    /// Every pass rotates `L`, so its length is kept to rounding for any rotation in a step, and the angular velocity
    /// never grows spuriously. Its direction is kept where the passes converge, up to about a radian per step.
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
            // The negated comparison also ends the passes at NaN, which is refused later, by name.
            if !(change > CONVERGED_ANGLE) {
                break;
            }
        }
        middle * turning
    }

    /// Returns the angular velocity at the end of the step, at the orientation `end`.
    ///
    /// It is that of the angular momentum at the start and of the moments since, which have changed the angular
    /// velocity from `free` to `solved` at configuration m.
    pub fn angular_velocity_at_end(
        &self,
        middle: &Quat,
        [free, solved]: [&Vec3; 2],
        end: &Quat,
    ) -> Vec3 {
        let own = self.inertia.momentum_at(self.start, self.angular_velocity);
        let moments = self.inertia.momentum_at(middle, &(solved - free));
        self.inertia.angular_velocity_at(end, &(own + moments))
    }
}
