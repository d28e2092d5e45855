//! Position-level problem of the penetration correction (T-34).
//!
//! Reads: the solved problem, contacts, velocities at the end of the step. Writes: [`LocalProblem`]. Cost: O(contacts +
//! bodies), parallel. Contract: as for the velocity-level problem; arms and normals are the same, so it is
//! partitioned and swept in the same way.

use super::problem::LocalProblem;
use crate::detection::Contacts;
use crate::lanes::BodyVelocity;
use crate::math::Vec3;
use crate::model::PenetrationCorrection;
use crate::motion::Motion;
use rayon::prelude::*;

/// Velocity-level problem with its solution.
pub struct VelocitySolution<'a> {
    /// Contact problem of the step.
    pub problem: &'a LocalProblem,
    /// Configuration m and free velocities.
    pub motion: &'a Motion,
    /// Contacts of the step `[nc]`.
    pub contacts: &'a Contacts,
    /// Impulses on the candidates, world axes, N s `[nc]`.
    pub impulse: &'a [Vec3],
    /// Velocities of the mobile bodies at the end of the step `[ng + nm]`, m/s.
    pub velocity: &'a [Vec3],
    /// Angular velocities of the mobile bodies at the end of the step `[ng + nm]`, rad/s.
    pub angular_velocity: &'a [Vec3],
}

impl VelocitySolution<'_> {
    /// Gap of contact `i` at configuration m of the next step, `h` seconds later, m.
    fn next_gap(&self, i: usize, h: f64) -> f64 {
        let twist = |b: usize| self.motion.twist(self.velocity, self.angular_velocity, b);
        self.contacts.gap[i] + h * self.contacts.opening_speed(i, self.motion, twist)
    }
}

impl LocalProblem {
    /// Builds the position-level problem of a step of `h` seconds; returns true if there is penetration to correct.
    ///
    /// Lines are velocities that last for one step and start at zero. Driven bodies do not move, mounted ones included:
    /// their machine determines their positions.
    pub fn build_positions(
        &mut self,
        ng: usize,
        solved: &VelocitySolution,
        correction: &PenetrationCorrection,
        h: f64,
    ) -> bool {
        let still = |inverse_mass| BodyVelocity::new(&Vec3::zeros(), &Vec3::zeros(), inverse_mass);
        let (grains, mounted) = solved.problem.lines.split_at(ng);
        self.lines.clear();
        self.lines.extend(grains.iter().map(|line| still(line.inverse_mass())));
        self.lines.extend(mounted.iter().map(|_| still(0.0)));
        self.whitening.clone_from(&solved.problem.whitening);
        self.responses.clone_from(&solved.problem.responses);
        self.gravity_dv = f64::INFINITY;
        (0..solved.contacts.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let mut contact = solved.problem.contacts[i];
                let gap = solved.next_gap(i, h);
                // An overlap that carries a force is no error.
                let factor = if contact.compliance[0] > 0.0 { 0.0 } else { correction.factor };
                let target = gap.max(0.0) + factor * (gap + correction.slop).min(0.0);
                // Pair blocks store it in f32.
                contact.offset = Vec3::new((target / h) as f32 as f64, 0.0, 0.0);
                contact.friction = 0.0;
                contact.compliance = [0.0; 2];
                contact.impulse = Vec3::zeros();
                let [candidate, antagonist] = contact.bodies.map(|b| b as usize);
                if antagonist >= ng {
                    // Normal mass of the grain alone.
                    let arm = contact.candidate_arms[0].map(f64::from);
                    let turning: f64 = arm.iter().map(|x| x * x).sum();
                    contact.antagonist_arms = Default::default();
                    contact.normal_mass =
                        (1.0 / (self.lines[candidate].inverse_mass() + turning)) as f32;
                }
                contact.is_likely_active = target < 0.0 || solved.impulse[i] != Vec3::zeros();
                contact
            })
            .collect_into_vec(&mut self.contacts);
        self.contacts.par_iter().any(|contact| contact.offset.x < 0.0)
    }
}
