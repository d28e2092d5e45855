//! Reference implementation of the sweeps, contact by contact, against which the kernel is tested.
//!
//! Reads: a [`LocalProblem`]. Cost: not tuned. [`super::assembled_problem`] assembles its operator from the same
//! data.

use super::contact_law;
use crate::lanes::BodyVelocity;
use crate::local_problem::LocalProblem;
use crate::math::{Vec3, widen};

/// Solver that visits contacts one after the other, with body velocities as the running state.
#[derive(Debug, Clone)]
pub struct MatrixFreeSolver<'a> {
    problem: &'a LocalProblem,
    /// Velocities of the mobile bodies.
    pub lines: Vec<BodyVelocity>,
    /// Impulses (n, t, s), N s `[nc]`.
    pub impulse: Vec<Vec3>,
}

impl<'a> MatrixFreeSolver<'a> {
    /// Starts from the problem's initial impulses.
    pub fn new(problem: &'a LocalProblem) -> Self {
        let mut start = Self {
            problem,
            lines: problem.lines.clone(),
            impulse: problem.contacts.iter().map(|c| c.impulse).collect(),
        };
        for i in 0..start.impulse.len() {
            start.push(i, &start.impulse[i].clone());
        }
        start
    }

    /// Relative velocity of contact `i`, offset and springs included, m/s.
    pub fn relative_velocity(&self, i: usize) -> Vec3 {
        let contact = &self.problem.contacts[i];
        let mut u = contact.offset + contact.yielding(&self.impulse[i]);
        for (line, arms, sign) in self.sides(i) {
            let v = contact.components(&self.lines[line].velocity());
            let w = self.lines[line].whitened_angular_velocity();
            u += (v + Vec3::from_fn(|k, _| widen(&arms[k]).dot(&w))) * sign;
        }
        u
    }

    /// Returns line, arms and sign of each mobile body of contact `i`.
    pub(super) fn sides(
        &self,
        i: usize,
    ) -> impl Iterator<Item = (usize, [[f32; 3]; 3], f64)> + use<> {
        let contact = &self.problem.contacts[i];
        let [c, a] = contact.bodies.map(|b| b as usize);
        let antagonist = (!self.problem.is_single(i)).then_some((a, contact.antagonist_arms, -1.0));
        std::iter::once((c, contact.candidate_arms, 1.0)).chain(antagonist)
    }

    /// Adds the effect of an impulse: `V += M⁻¹ H_i Δr`.
    fn push(&mut self, i: usize, delta: &Vec3) {
        let force = self.problem.contacts[i].world(delta);
        for (line, arms, sign) in self.sides(i) {
            let line = &mut self.lines[line].0;
            for j in 0..3 {
                line[j] += sign * line[6] * force[j];
                line[3 + j] += sign * (0..3).map(|k| arms[k][j] as f64 * delta[k]).sum::<f64>();
            }
        }
    }

    /// Visits the contacts in the given order.
    pub fn sweep(&mut self, order: impl IntoIterator<Item = u32>, relaxation: f64) {
        for i in order {
            let i = i as usize;
            let contact = &self.problem.contacts[i];
            let w = contact.law_block();
            let b = self.relative_velocity(i) - w * self.impulse[i];
            let solved = contact_law::solve(&w, &b, contact.friction as f64);
            let delta = contact_law::relaxed_change(&self.impulse[i], &solved, relaxation);
            self.impulse[i] += delta;
            self.push(i, &delta);
        }
    }
}
