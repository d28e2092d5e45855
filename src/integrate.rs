//! Integration of the velocities to the end-of-step configuration (T-4), reactions of the driven bodies, and energies (T-14).
//!
//! Reads: model, state, prediction, solved velocities, contact impulses. Writes: the next state,
//! reactions.
//! Cost: O(bodies + contacts).

use crate::detection::{ContactHistory, Contacts};
use crate::math::{Pose, Quat, Vec3, rotation};
use crate::model::Model;
use crate::motion::{Motion, turns_far};
use crate::state::{EnergyLedger, State};
use rayon::prelude::*;

/// Contacts summed by one thread at a time; fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 4096;

/// Reaction of the ballast on one driven body during a step, about its reference point, world axes (T-27).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reaction {
    /// Impulse, N s.
    pub impulse: Vec3,
    /// Angular impulse, N m s.
    pub angular_impulse: Vec3,
    /// Work of the body on the ballast, J.
    pub work: f64,
    /// Number of contact points with an impulse.
    pub contacts: u32,
}

impl Default for Reaction {
    fn default() -> Self {
        Self { impulse: Vec3::zeros(), angular_impulse: Vec3::zeros(), work: 0.0, contacts: 0 }
    }
}

/// Writes the end-of-step configuration of every body to `next`.
pub fn write_end_configuration(step: &StepMotion, targets: &[Pose], next: &mut State) {
    let StepMotion { model, state, motion, velocity, angular_velocity } = *step;
    let (ng, mobile, bodies) = (model.grains.len(), velocity.len(), motion.position.len());
    let after = model.stepping.h() * model.stepping.theta;
    next.position.resize(bodies, Vec3::zeros());
    next.orientation.resize(bodies, Quat::identity());
    next.velocity.resize(bodies, Vec3::zeros());
    next.angular_velocity.resize(bodies, Vec3::zeros());
    (&mut next.position[..ng], &mut next.orientation[..ng])
        .into_par_iter()
        .zip((&mut next.velocity[..ng], &mut next.angular_velocity[..ng]))
        .enumerate()
        .with_min_len(1024)
        .for_each(|(i, ((x, q), (v, w)))| {
            *x = motion.position[i] + velocity[i] * after;
            *q = rotation::advance(&motion.orientation[i], &(angular_velocity[i] * after));
            *v = velocity[i];
            *w = motion.angular_velocity_at_end(model, state, i, &angular_velocity[i], q);
        });
    next.mount.clear();
    next.mount.extend(&targets[..mobile - ng]);
    for (b, target) in (ng..).zip(targets) {
        let (pose, [v, w]) = match model.driven[b - ng].mount.as_ref() {
            Some(mount) => {
                let solved = [&velocity[b], &angular_velocity[b]];
                motion.mounted_end_state(model, state, b - ng, mount, target, solved)
            }
            // The target itself, not an integrated velocity: rounding must not add up over steps.
            None => (*target, [motion.velocity[b], motion.angular_velocity[b]]),
        };
        next.position[b] = pose.position;
        next.orientation[b] = pose.orientation;
        next.velocity[b] = v;
        next.angular_velocity[b] = w;
    }
}

/// Energy taken from grains that turned too far in a step for contacts that are linear in it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RotationLimit {
    /// Grains concerned.
    pub grains: usize,
    /// Kinetic energy taken from them, J.
    pub energy: f64,
}

/// Limits the kinetic energy of grains that turn fast to what the impulses of the step have left them (T-41).
///
/// Impulses act with the inertia of configuration m. A body that turns on by a good part of a radian has another one at
/// the end of the step, where the same angular momentum may belong to more energy than the impulses have given.
pub fn limit_rotation(step: &StepMotion, next: &mut State) -> RotationLimit {
    let StepMotion { model, state, motion, velocity, angular_velocity } = *step;
    let h = model.stepping.h();
    let mut limit = RotationLimit::default();
    for i in 0..model.grains.len() {
        let free = &motion.angular_velocity[i];
        let solved = &angular_velocity[i];
        let is_fast = [free, solved].iter().any(|w| turns_far(&model.grains.inertia[i], w, h));
        if !is_fast || (solved - free).norm() <= 1e-9 * free.norm() {
            continue;
        }
        let rotational = |q: &Quat, w: &Vec3| rotational_energy(model, i, q, w);
        let start = rotational(&state.orientation[i], &state.angular_velocity[i]);
        let middle = &motion.orientation[i];
        let left = start + rotational(middle, solved) - rotational(middle, free);
        let translational = 0.5 * model.grains.mass[i] * velocity[i].norm_squared();
        let found = rotational(&next.orientation[i], &next.angular_velocity[i]);
        if found <= left {
            continue;
        }
        limit.grains += 1;
        // What rotation cannot give is taken from translation.
        let rotational_left = left.max(0.0);
        let translational_left = (translational + left.min(0.0)).max(0.0);
        if found > 0.0 {
            next.angular_velocity[i] *= (rotational_left / found).sqrt();
        }
        if translational > 0.0 {
            next.velocity[i] *= (translational_left / translational).sqrt();
        }
        limit.energy += found - rotational_left + translational - translational_left;
    }
    limit
}

/// Returns the kinetic energy of rotation, J, of grain `i` at orientation `q` with angular velocity `w` (world axes, rad/s).
fn rotational_energy(model: &Model, i: usize, q: &Quat, w: &Vec3) -> f64 {
    let w = q.inverse() * w;
    0.5 * model.grains.inertia[i].component_mul(&w).dot(&w)
}

/// Moves the grains of `next` by velocities that last for `h` seconds, without changing their velocities (T-34).
pub fn shift_grains(velocity: &[Vec3], angular_velocity: &[Vec3], h: f64, next: &mut State) {
    let ng = velocity.len();
    (&mut next.position[..ng], &mut next.orientation[..ng], velocity, angular_velocity)
        .into_par_iter()
        .with_min_len(1024)
        .for_each(|(x, q, v, w)| {
            // Most grains do not move, and keep their bits.
            if *v != Vec3::zeros() || *w != Vec3::zeros() {
                *x += v * h;
                *q = rotation::advance(q, &(w * h));
            }
        });
}

/// Motion of all bodies through a step: initial state, prediction, and solved velocities of the mobile bodies.
pub struct StepMotion<'a> {
    /// Model of the step.
    pub model: &'a Model,
    /// State at the beginning of the step.
    pub state: &'a State,
    /// Configuration m and free velocities.
    pub motion: &'a Motion,
    /// Velocities of the mobile bodies at the end of the step `[ng + nm]`, m/s.
    pub velocity: &'a [Vec3],
    /// Angular velocities of the mobile bodies at the end of the step `[ng + nm]`, rad/s.
    pub angular_velocity: &'a [Vec3],
}

impl StepMotion<'_> {
    /// Fills `overlap` with the overlap of each contact's spring at the end of the step, m `[nc]`; zero where it is rigid
    /// (T-42).
    pub fn end_overlaps(
        &self,
        contacts: &Contacts,
        history: &ContactHistory,
        overlap: &mut Vec<f64>,
    ) {
        if self.model.is_rigid() {
            overlap.clear();
            return overlap.resize(contacts.len(), 0.0);
        }
        let h = self.model.stepping.h();
        let twist = |b: usize| self.motion.twist(self.velocity, self.angular_velocity, b);
        let end = |c: usize| {
            let stiffness = self.model.contact_stiffness(contacts.bodies[c][1] as usize);
            if stiffness.is_rigid() {
                return 0.0;
            }
            let start = history.spring_gap(c, contacts.gap[c], h);
            (-start - h * contacts.opening_speed(c, self.motion, twist)).max(0.0)
        };
        let contacts = (0..contacts.len()).into_par_iter().with_min_len(1024);
        contacts.map(end).collect_into_vec(overlap);
    }

    /// Energy of the springs of contact `c` with impulse `f` (N s) at the end of the step, J (T-42).
    ///
    /// `overlap` is that in configuration m of the next step, m; kinetic energies are those of the end of the step.
    fn spring_energy(&self, contacts: &Contacts, c: usize, f: &Vec3, overlap: f64) -> f64 {
        if overlap == 0.0 && *f == Vec3::zeros() {
            return 0.0;
        }
        let (normal, stepping) = (&contacts.normal[c], &self.model.stepping);
        let h = stepping.h();
        let twist = |b: usize| self.motion.twist(self.velocity, self.angular_velocity, b);
        let opening = contacts.opening_speed(c, self.motion, twist);
        let at_end = (overlap + (1.0 - stepping.theta) * h * opening).max(0.0);
        let tangential_squared = (f.norm_squared() - f.dot(normal).powi(2)).max(0.0) / (h * h);
        let stiffness = self.model.contact_stiffness(contacts.bodies[c][1] as usize);
        stiffness.energy(at_end, tangential_squared)
    }

    /// Mean velocity over the step of the point of body `b` at `point`, with which impulses do work.
    ///
    /// Prescribed bodies have a constant velocity over the step.
    fn mean_velocity(&self, b: usize, point: &Vec3) -> Vec3 {
        let lever = point - self.motion.position[b];
        let (v, w) = self.motion.initial_twist(self.model, self.state, b);
        let (v, w) = match self.velocity.get(b).zip(self.angular_velocity.get(b)) {
            Some((v_end, w_end)) => (0.5 * (v + v_end), 0.5 * (w + w_end)),
            None => (v, w),
        };
        v + w.cross(&lever)
    }
}

/// Sums over the contacts of a step: dissipation and penetration.
#[derive(Debug, Default)]
pub struct ContactBalance {
    /// Number of contact points with an impulse.
    pub active: usize,
    /// Contacts of driven bodies with an impulse, ascending.
    driven: Vec<u32>,
    /// Energy that contacts took from the bodies during the step, J: minus the impulses times the mean of the relative
    /// velocities before and after.
    pub absorbed: f64,
    /// Energy of the contacts' springs at the end of the step, J (T-42).
    pub elastic: f64,
    /// Number of penetrating contact points.
    pub penetrating: usize,
    /// Sum of the penetration depths, m.
    pub depth_sum: f64,
    /// Largest penetration depth, m.
    pub max_depth: f64,
}

impl ContactBalance {
    /// Sums over all contacts in one pass.
    ///
    /// `impulse` are those of the step, world axes, N s, `overlap` those of the springs at its end, m `[nc]`.
    pub fn new(step: &StepMotion, contacts: &Contacts, impulse: &[Vec3], overlap: &[f64]) -> Self {
        let (ng, has_springs) = (step.model.grains.len(), !step.model.is_rigid());
        let chunks: Vec<Self> = impulse
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(k, chunk)| {
                let mut part = Self::default();
                let gaps = contacts.gap[k * CHUNK..].iter().zip(chunk).map(|(gap, _)| *gap);
                for gap in gaps.filter(|gap| *gap < 0.0) {
                    part.penetrating += 1;
                    part.depth_sum -= gap;
                    part.max_depth = part.max_depth.max(-gap);
                }
                if has_springs {
                    let springs = (k * CHUNK..).zip(chunk);
                    part.elastic =
                        springs.map(|(c, f)| step.spring_energy(contacts, c, f, overlap[c])).sum();
                }
                // Most contacts are open and without effect.
                let closed = (k * CHUNK..).zip(chunk).filter(|(_, f)| **f != Vec3::zeros());
                for (c, f) in closed {
                    let [candidate, antagonist] = contacts.bodies[c];
                    let velocity = |b: u32| step.mean_velocity(b as usize, &contacts.point[c]);
                    part.active += 1;
                    part.absorbed -= f.dot(&(velocity(candidate) - velocity(antagonist)));
                    if antagonist as usize >= ng {
                        part.driven.push(c as u32);
                    }
                }
                part
            })
            .collect();
        chunks.into_iter().fold(Self::default(), |mut sum, part| {
            sum.active += part.active;
            sum.driven.extend(part.driven);
            sum.absorbed += part.absorbed;
            sum.elastic += part.elastic;
            sum.penetrating += part.penetrating;
            sum.depth_sum += part.depth_sum;
            sum.max_depth = sum.max_depth.max(part.max_depth);
            sum
        })
    }

    /// Computes the reaction on each driven body, about its reference point in configuration m.
    ///
    /// Sums run in the order of the contacts, so that they have the same bits for any number of threads.
    pub fn reactions(
        &self,
        step: &StepMotion,
        contacts: &Contacts,
        impulse: &[Vec3],
    ) -> Vec<Reaction> {
        let model = step.model;
        let mut reactions = vec![Reaction::default(); model.driven.len()];
        for &c in &self.driven {
            let c = c as usize;
            let (b, f, point) = (contacts.bodies[c][1] as usize, &impulse[c], &contacts.point[c]);
            let reaction = &mut reactions[b - model.grains.len()];
            let lever = point - step.motion.position[b];
            reaction.impulse -= f;
            reaction.angular_impulse -= lever.cross(f);
            reaction.work += f.dot(&step.mean_velocity(b, point));
            reaction.contacts += 1;
        }
        reactions
    }
}

/// Returns kinetic and potential energy of the grains, J; potential energy is zero at the world's origin.
pub fn mechanical_energy(model: &Model, state: &State) -> (f64, f64) {
    let chunks: Vec<(f64, f64)> = model
        .grains
        .mass
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(k, chunk)| {
            let mut sums = (0.0, 0.0);
            for (i, &mass) in (k * CHUNK..).zip(chunk) {
                let turning =
                    rotational_energy(model, i, &state.orientation[i], &state.angular_velocity[i]);
                sums.0 += 0.5 * mass * state.velocity[i].norm_squared() + turning;
                sums.1 -= mass * model.gravity.dot(&state.position[i]);
            }
            sums
        })
        .collect();
    chunks.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
}

/// Creates the energy ledger of a run that starts at `state`.
pub fn open_ledger(model: &Model, state: &State) -> EnergyLedger {
    let (kinetic, potential) = mechanical_energy(model, state);
    EnergyLedger {
        initial_kinetic: kinetic,
        initial_potential: potential,
        initial_elastic: state.energy.elastic,
        kinetic,
        potential,
        elastic: state.energy.elastic,
        work_in: 0.0,
        dissipated: 0.0,
    }
}
