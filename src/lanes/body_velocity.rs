//! Velocity of a body as one cache line.

use crate::math::Vec3;

/// Velocity of a body: `v` (world, m/s), `ŵ = D^(1/2) Rᵀ w` (m kg^(1/2)/s), inverse mass (1/kg), unused.
///
/// The angular velocity is whitened in the principal frame (D principal inertia, R orientation at configuration m):
/// the inverse inertia becomes the identity and needs no memory traffic.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[repr(C, align(64))]
pub struct BodyVelocity(pub [f64; 8]);

impl BodyVelocity {
    /// Returns the velocity of a body.
    pub fn new(velocity: &Vec3, whitened_angular_velocity: &Vec3, inverse_mass: f64) -> Self {
        let (v, w) = (velocity, whitened_angular_velocity);
        Self([v.x, v.y, v.z, w.x, w.y, w.z, inverse_mass, 0.0])
    }

    /// Returns the velocity of the centre of mass, m/s.
    pub fn velocity(&self) -> Vec3 {
        Vec3::new(self.0[0], self.0[1], self.0[2])
    }

    /// Returns the whitened angular velocity `ŵ`, m kg^(1/2)/s.
    pub fn whitened_angular_velocity(&self) -> Vec3 {
        Vec3::new(self.0[3], self.0[4], self.0[5])
    }

    /// Returns twice the kinetic energy over the mass, (m/s)².
    pub fn speed_squared(&self) -> f64 {
        self.velocity().norm_squared()
            + self.inverse_mass() * self.whitened_angular_velocity().norm_squared()
    }

    /// Returns the inverse mass, 1/kg.
    pub fn inverse_mass(&self) -> f64 {
        self.0[6]
    }
}
