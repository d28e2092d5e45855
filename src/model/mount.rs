//! Mounts of driven bodies that contacts can move (T-28).

use super::stepping::Stepping;
use crate::math::Vec3;

/// Mass, inertia and degrees of freedom of a driven body that contacts can move.
///
/// The degrees of freedom are the three translations of its reference point along the world's axes and the three
/// rotations about them, each in one mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Mass that moves with the body, kg.
    pub mass: f64,
    /// Moments of inertia about the centre of mass, along the body's axes, kg m²; above zero if the body can rotate.
    pub inertia: Vec3,
    /// Centre of mass, in the body's frame, m.
    pub centre: Vec3,
    /// Modes of the translations along x, y, z and the rotations about them.
    pub dof_modes: [DofMode; 6],
}

/// Mode of a degree of freedom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DofMode {
    /// Follows the imposed motion regardless of forces.
    Prescribed,
    /// Moves under loads, gravity and contacts.
    Free,
    /// Follows the imposed motion through a spring and a damper; the machine carries gravity.
    Spring {
        /// Stiffness, N/m or N m/rad.
        stiffness: f64,
        /// Damping, N s/m or N m s/rad.
        damping: f64,
    },
}

impl DofMode {
    /// Returns the mode's name in messages.
    pub fn name(self) -> &'static str {
        match self {
            DofMode::Prescribed => "prescribed",
            DofMode::Free => "free",
            DofMode::Spring { .. } => "spring",
        }
    }

    /// Returns stiffness and damping; zeros without a spring.
    pub fn spring(self) -> [f64; 2] {
        match self {
            DofMode::Spring { stiffness, damping } => [stiffness, damping],
            DofMode::Prescribed | DofMode::Free => [0.0; 2],
        }
    }

    /// True if the degree of freedom follows the imposed motion exactly.
    pub fn is_prescribed(self) -> bool {
        self == DofMode::Prescribed
    }
}

impl Mount {
    /// Returns a mass on equal springs (N/m) and dampers (N s/m) in all directions, without rotation.
    pub fn spring(mass: f64, stiffness: f64, damping: f64) -> Self {
        let spring = DofMode::Spring { stiffness, damping };
        let prescribed = DofMode::Prescribed;
        Self {
            mass,
            inertia: Vec3::zeros(),
            centre: Vec3::zeros(),
            dof_modes: [spring, spring, spring, prescribed, prescribed, prescribed],
        }
    }

    /// Returns the modes of the three translations.
    pub fn translations(&self) -> [DofMode; 3] {
        [self.dof_modes[0], self.dof_modes[1], self.dof_modes[2]]
    }

    /// Returns the modes of the three rotations.
    pub fn rotations(&self) -> [DofMode; 3] {
        [self.dof_modes[3], self.dof_modes[4], self.dof_modes[5]]
    }

    /// True if an impulse moves the body's mass equally in all directions.
    pub fn has_isotropic_translations(&self) -> bool {
        let [x, y, z] = self.translations();
        !(x.is_prescribed() || y.is_prescribed() || z.is_prescribed())
            && x.spring() == y.spring()
            && y.spring() == z.spring()
    }

    /// True if contacts can rotate the body.
    pub fn can_rotate(&self) -> bool {
        self.rotations().iter().any(|r| !r.is_prescribed())
    }

    /// Returns the weight of the end of a step in the forces of translational springs and dampers (T-28).
    ///
    /// One half where the step resolves their motion; larger beyond, so that the motion decays. Rotational springs
    /// and dampers act with the end alone.
    pub fn end_weight(&self, stepping: &Stepping) -> f64 {
        let h = stepping.h();
        let turning =
            if self.can_rotate() { self.centre.norm_squared() / self.inertia.min() } else { 0.0 };
        let light = 1.0 / self.mass + turning;
        let needed = self.translations().into_iter().map(|freedom| {
            let [stiffness, damping] = freedom.spring();
            let (swing, drag) = (h * (stiffness * light).sqrt(), h * damping * light);
            // Critical from 4 on; no rate changes its sign.
            let of_spring = if swing > 2.0 { (0.25 * swing - 0.5).min(2.0 / swing) } else { 0.0 };
            let of_damper = if drag > 2.0 { 0.5 - 1.0 / drag } else { 0.0 };
            0.5 + of_spring.max(of_damper)
        });
        needed.fold(stepping.theta, f64::max)
    }

    /// Returns the mount with its vertical translation free and everything else prescribed.
    pub(crate) fn free_vertically(mut self) -> Self {
        self.dof_modes = [DofMode::Prescribed; 6];
        self.dof_modes[2] = DofMode::Free;
        self
    }

    /// Returns the inertia that spring and damper of degree of freedom `k` add by responding within the step (T-28).
    pub fn added_inertia(&self, k: usize, stepping: &Stepping) -> f64 {
        let h = stepping.h();
        let [stiffness, damping] = self.dof_modes[k].spring();
        let share = if k < 3 { self.end_weight(stepping) } else { 1.0 };
        share * h * (damping + h * stepping.theta * stiffness)
    }

    /// True if contacts can rotate the body about all axes, so that its angular momentum is free.
    pub fn rotates_freely(&self) -> bool {
        !self.rotations().iter().any(|r| r.is_prescribed())
    }

    /// Returns the numbers of the degrees of freedom that are not prescribed.
    pub fn free_dofs(&self) -> impl Iterator<Item = usize> {
        (0..6).filter(|k| !self.dof_modes[*k].is_prescribed())
    }
}
