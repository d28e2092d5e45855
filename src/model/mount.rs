//! Driven bodies that contacts can move: which degrees of freedom, against what (T-28).

use super::stepping::Stepping;
use crate::math::Vec3;

/// How a driven body answers to its contacts.
///
/// Its degrees of freedom are the three translations of its reference point along the world's axes and
/// the three rotations about them, each in one mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Mass that moves with the body, kg.
    pub mass: f64,
    /// Moments of inertia about the centre of mass, along the body's axes, kg m²; above zero if the body
    /// can turn.
    pub inertia: Vec3,
    /// Centre of mass, in the body's frame, m.
    pub centre: Vec3,
    pub dof_modes: [DofMode; 6],
}

/// What a degree of freedom follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DofMode {
    /// The imposed motion, whatever pushes back.
    Prescribed,
    /// Loads and gravity alone.
    Free,
    /// The imposed motion, through a spring (N/m, N m/rad) and a damper (N s/m, N m s/rad). Gravity is
    /// carried by the machine.
    Spring { stiffness: f64, damping: f64 },
}

impl DofMode {
    /// The freedom's name in messages.
    pub fn name(self) -> &'static str {
        match self {
            DofMode::Prescribed => "prescribed",
            DofMode::Free => "free",
            DofMode::Spring { .. } => "spring",
        }
    }

    /// Stiffness and damping; none where there is no spring.
    pub fn spring(self) -> [f64; 2] {
        match self {
            DofMode::Spring { stiffness, damping } => [stiffness, damping],
            DofMode::Prescribed | DofMode::Free => [0.0; 2],
        }
    }

    pub fn is_prescribed(self) -> bool {
        self == DofMode::Prescribed
    }
}

impl Mount {
    /// A mass on a spring (N/m) and damper (N s/m) that are equal in all directions; it does not turn.
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

    /// Modes of the three translations.
    pub fn translations(&self) -> [DofMode; 3] {
        [self.dof_modes[0], self.dof_modes[1], self.dof_modes[2]]
    }

    /// Modes of the three rotations.
    pub fn rotations(&self) -> [DofMode; 3] {
        [self.dof_modes[3], self.dof_modes[4], self.dof_modes[5]]
    }

    /// Whether an impulse moves the body's mass alike in all directions.
    pub fn has_isotropic_translations(&self) -> bool {
        let [x, y, z] = self.translations();
        !(x.is_prescribed() || y.is_prescribed() || z.is_prescribed())
            && x.spring() == y.spring()
            && y.spring() == z.spring()
    }

    /// Whether contacts can turn the body.
    pub fn can_rotate(&self) -> bool {
        self.rotations().iter().any(|r| !r.is_prescribed())
    }

    /// Share of the deflection and its rate at the end of a step with which springs and dampers of translations act, beside
    /// those at its start (T-28): one half, means, as far as the step resolves what they do; beyond, more, so that it dies
    /// away. Those of rotations act with the end alone.
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

    /// What spring and damper of degree of freedom `k` add to its inertia because they answer within the step (T-28).
    pub fn added_inertia(&self, k: usize, stepping: &Stepping) -> f64 {
        let h = stepping.h();
        let [stiffness, damping] = self.dof_modes[k].spring();
        let share = if k < 3 { self.end_weight(stepping) } else { 1.0 };
        share * h * (damping + h * stepping.theta * stiffness)
    }

    /// Whether contacts can turn the body in all directions, so that its angular momentum is its own.
    pub fn rotates_freely(&self) -> bool {
        !self.rotations().iter().any(|r| r.is_prescribed())
    }

    /// Numbers of the degrees of freedom that are not held.
    pub fn free_dofs(&self) -> impl Iterator<Item = usize> {
        (0..6).filter(|k| !self.dof_modes[*k].is_prescribed())
    }
}
