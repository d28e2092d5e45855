//! The frictional problem of a step, contact by contact, ready to be packed and swept.
//!
//! Reads: model, state (restitution needs the velocities at the start of the step), motion,
//! contacts, warm-start impulses. Writes: [`LocalProblem`]. Theory: (T-5) to (T-8), (T-15), (T-16). Cost: O(contacts
//! + grains), parallel. Contract: the result does not depend on the number of threads.
//!
//! Geometry is rounded to f32 once, here, and everything else (the third axis, the Delassus blocks)
//! is derived from the rounded values: `H` and its transpose are the same numbers, so linear
//! momentum is exact to rounding of f64. Rounding of the levers changes angular momentum by 1e-7 of
//! an impulse times its lever.

pub mod contact;
pub mod line;
mod positions;

pub use contact::LocalContact;
pub use line::Line;
pub use positions::Solved;

use crate::detection::Contacts;
use crate::math::{Mat3, Vec3};
use crate::model::Model;
use crate::motion::{Motion, Response};
use crate::state::State;
use contact::Side;
use rayon::prelude::*;

/// Contacts in canonical order, and what turns lines into velocities.
#[derive(Debug, Default)]
pub struct LocalProblem {
    /// `[nc]`, in the order of [`Contacts`].
    pub contacts: Vec<LocalContact>,
    /// Free velocities of the mobile bodies `[nm]`.
    pub lines: Vec<Line>,
    /// `B = R D^(-1/2)` per mobile body `[nm]`, (kg m²)^(-1/2): world angular velocity is `B ŵ`.
    pub whitening: Vec<Mat3>,
    /// Of the mounted bodies, which come after the grains.
    pub responses: Vec<Response>,
}

impl LocalProblem {
    /// Fills the problem of a step; `warm` are initial impulses on the candidates, world axes,
    /// N s `[nc]`, or empty for none.
    pub fn build(
        &mut self,
        model: &Model,
        state: &State,
        motion: &Motion,
        contacts: &Contacts,
        warm: &[Vec3],
    ) {
        self.build_lines(model, motion);
        let (ng, mobile) = (model.grains.len(), self.lines.len());
        let h = model.stepping.h();
        // What weight adds to a velocity in a step: an impulse next to the contact may bring as much.
        let nearly = model.gravity.norm() * h;
        let (lines, whitening, responses) = (&self.lines, &self.whitening, &self.responses);
        (0..contacts.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let [c, a] = contacts.bodies[i];
                let (c, a) = (c as usize, a as usize);
                let point = contacts.point[i];
                let side = |b: usize| {
                    let response = b.checked_sub(ng).map(|d| &responses[d]);
                    let lever = point - motion.position[b];
                    Side {
                        lever: response.map_or(lever, |r| lever - r.centre),
                        inverse_mass: lines[b].inverse_mass(),
                        whitening: whitening[b],
                        shift: response.map(|r| r.shift),
                    }
                };
                let mut contact = if a < mobile {
                    LocalContact::pair(&contacts.normal[i], &side(c), &side(a))
                } else {
                    LocalContact::single(&contacts.normal[i], &side(c))
                };
                contact.bodies = contacts.bodies[i];
                let gap = contacts.gap[i];
                let approach = if model.restitution > 0.0 {
                    let start = |b: usize| {
                        state.velocity[b] + state.spin[b].cross(&(point - motion.position[b]))
                    };
                    contact.axes()[0].dot(&(start(c) - start(a))).min(0.0)
                } else {
                    0.0
                };
                // A gap that the approach closes within this step rebounds now: anticipating it
                // would brake the grains first and leave the rebound with what remains.
                contact.offset.x = if approach < 0.0 && gap + h * approach <= 0.0 {
                    model.restitution * approach
                } else {
                    gap.max(0.0) / h
                };
                let body = a.checked_sub(ng).map(|d| &model.driven[d]);
                contact.friction = body.map_or(model.grain_friction, |b| b.friction) as f32;
                if a < mobile {
                    // Blocks of pairs keep it in f32: 6e-8 of the gap.
                    contact.offset.x = contact.offset.x as f32 as f64;
                } else {
                    let lever = point - motion.position[a];
                    let surface = motion.velocity[a] + motion.spin[a].cross(&lever);
                    contact.offset -= contact.components(&surface);
                }
                // Where there was none it stays zero: its components might be zeros with a sign.
                if let Some(world) = warm.get(i).filter(|world| **world != Vec3::zeros()) {
                    contact.impulse = contact.components(world);
                }
                let approach = contact.offset.x + contact.normal_velocity(lines);
                contact.likely = contact.impulse.x > 0.0 || approach < nearly;
                contact
            })
            .collect_into_vec(&mut self.contacts);
    }

    fn build_lines(&mut self, model: &Model, motion: &Motion) {
        let ng = model.grains.len();
        (0..ng)
            .into_par_iter()
            .with_min_len(1024)
            .map(|b| {
                let inertia = &model.grains.inertia[b];
                let rotation = motion.orientation[b].to_rotation_matrix();
                let root = inertia.map(f64::sqrt);
                let inverse_root = root.map(|x| 1.0 / x);
                let whitened = rotation.matrix().tr_mul(&motion.spin[b]).component_mul(&root);
                let line = Line::new(&motion.velocity[b], &whitened, 1.0 / model.grains.mass[b]);
                (line, rotation.matrix() * Mat3::from_diagonal(&inverse_root))
            })
            .unzip_into_vecs(&mut self.lines, &mut self.whitening);
        self.responses.clone_from(&motion.responses);
        for r in &self.responses {
            self.lines.push(Line::new(&r.velocity, &r.whitened, r.inverse_mass));
            self.whitening.push(r.turn);
        }
    }

    /// Velocity (m/s) and angular velocity (world axes, rad/s) of a body whose line is `line`.
    pub fn velocity(&self, body: usize, line: &Line) -> (Vec3, Vec3) {
        let (velocity, whitened) = (line.velocity(), line.whitened_spin());
        match body.checked_sub(self.lines.len() - self.responses.len()) {
            Some(d) => self.responses[d].twist(&velocity, &whitened),
            None => (velocity, self.whitening[body] * whitened),
        }
    }

    /// Number of mobile bodies.
    pub fn body_count(&self) -> usize {
        self.lines.len()
    }

    /// Whether contact `i` is with a driven body.
    pub fn is_single(&self, i: usize) -> bool {
        self.contacts[i].bodies[1] as usize >= self.lines.len()
    }
}
