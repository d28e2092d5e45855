//! Stiffness of contacts (T-42).

/// Stiffness of the contact points between two materials: rigid, or springs that give way under the contact force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactStiffness {
    /// Normal stiffness of a contact point, N/m; infinite where contacts are rigid.
    pub normal: f64,
    /// Tangential stiffness over normal stiffness; infinite where contacts stick rigidly.
    pub tangential_ratio: f64,
    /// Relaxation time of the damping, s: a growing overlap adds its rate times `normal` times this time to the force.
    pub damping_time: f64,
}

impl Default for ContactStiffness {
    fn default() -> Self {
        Self::RIGID
    }
}

impl ContactStiffness {
    /// Stiffness of rigid contacts, which have no springs.
    pub const RIGID: Self =
        Self { normal: f64::INFINITY, tangential_ratio: f64::INFINITY, damping_time: 0.0 };

    /// Returns true if contacts have no springs.
    pub fn is_rigid(&self) -> bool {
        self.normal == f64::INFINITY
    }

    /// Returns the tangential stiffness of a contact point, N/m; infinite where contacts stick rigidly.
    pub fn tangential(&self) -> f64 {
        self.normal * self.tangential_ratio
    }

    /// Returns the compliance (normal, tangential) of a step of `h` seconds, 1/kg: relative velocity per impulse.
    ///
    /// Both are zero where contacts are rigid.
    pub fn compliance(&self, h: f64) -> [f64; 2] {
        [1.0 / (self.normal * h * (h + self.damping_time)), 1.0 / (self.tangential() * h * h)]
    }

    /// Returns the speed (m/s) with which a gap (m, negative: overlap) acts in a step of `h` seconds: added to the normal
    /// velocity, it gives what the force follows.
    pub fn gap_speed(&self, gap: f64, h: f64) -> f64 {
        if gap >= 0.0 {
            gap / h
        } else if self.is_rigid() {
            0.0
        } else {
            gap / (h + self.damping_time)
        }
    }

    /// Returns the energy of a contact's springs, J, from their overlap (m) and the square of their tangential force (N²).
    pub fn energy(&self, overlap: f64, tangential_force_squared: f64) -> f64 {
        if self.is_rigid() {
            return 0.0;
        }
        0.5 * (self.normal * overlap * overlap + tangential_force_squared / self.tangential())
    }
}
