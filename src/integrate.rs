//! From velocities to the configuration at the end of the step (T-4), and what the step did:
//! reactions of the driven bodies and the energy ledger (T-14).
//!
//! Reads: model, prediction, solved velocities, contact impulses. Writes: state, reactions.
//! Cost: O(bodies + contacts).

use crate::detection::Contacts;
use crate::math::{Pose, Vec3, rotation};
use crate::model::Model;
use crate::motion::Motion;
use crate::state::{EnergyLedger, State};
use rayon::prelude::*;

/// Contacts summed by one thread at a time: fixed, so that sums do not depend on the threads.
const CHUNK: usize = 4096;

/// What the ballast did to one driven body during a step, about its reference point, world axes
/// (T-27).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reaction {
    /// N s.
    pub impulse: Vec3,
    /// N m s.
    pub angular_impulse: Vec3,
    /// Work of the body on the ballast, J.
    pub work: f64,
    /// Contact points that carry an impulse.
    pub contacts: u32,
}

impl Default for Reaction {
    fn default() -> Self {
        Self { impulse: Vec3::zeros(), angular_impulse: Vec3::zeros(), work: 0.0, contacts: 0 }
    }
}

/// Moves all bodies to the end of the step with the velocities at its end `[ng]`.
pub fn configurations(
    model: &Model,
    motion: &Motion,
    velocity: &[Vec3],
    spin: &[Vec3],
    targets: &[Pose],
    state: &mut State,
) {
    let ng = model.grains.len();
    let after = model.stepping.h() * model.stepping.theta;
    (&mut state.position[..ng], &mut state.orientation[..ng])
        .into_par_iter()
        .enumerate()
        .with_min_len(1024)
        .for_each(|(i, (x, q))| {
            *x = motion.position[i] + velocity[i] * after;
            *q = rotation::advance(&motion.orientation[i], &(spin[i] * after));
        });
    state.velocity[..ng].copy_from_slice(velocity);
    state.spin[..ng].copy_from_slice(spin);
    state.velocity[ng..].copy_from_slice(&motion.velocity[ng..]);
    state.spin[ng..].copy_from_slice(&motion.spin[ng..]);
    for (d, target) in targets.iter().enumerate() {
        // The target itself, not what the velocity leads to: rounding must not add up over steps.
        state.position[ng + d] = target.position;
        state.orientation[ng + d] = target.orientation;
    }
}

/// What the ballast did to each driven body: impulses about its reference point as placed in
/// configuration m, where the contacts were found.
pub fn reactions(
    model: &Model,
    motion: &Motion,
    contacts: &Contacts,
    impulse: &[Vec3],
) -> Vec<Reaction> {
    let ng = model.grains.len();
    let mut reactions = vec![Reaction::default(); model.driven.len()];
    for (c, &[_, antagonist]) in contacts.bodies.iter().enumerate() {
        let b = antagonist as usize;
        if b < ng || impulse[c] == Vec3::zeros() {
            continue;
        }
        let reaction = &mut reactions[b - ng];
        let lever = contacts.point[c] - motion.position[b];
        reaction.impulse -= impulse[c];
        reaction.angular_impulse -= lever.cross(&impulse[c]);
        reaction.work += impulse[c].dot(&(motion.velocity[b] + motion.spin[b].cross(&lever)));
        reaction.contacts += 1;
    }
    reactions
}

/// Energy that the contacts took during the step, J: minus the impulses times the mean of the
/// relative velocities before and after.
///
/// `start` and `end` are (velocity, spin) of the grains `[ng]`; a driven body keeps its imposed
/// velocity over the whole step.
pub fn dissipation(
    motion: &Motion,
    contacts: &Contacts,
    impulse: &[Vec3],
    start: (&[Vec3], &[Vec3]),
    end: (&[Vec3], &[Vec3]),
) -> f64 {
    let ng = end.0.len();
    let velocity_at = |b: u32, point: &Vec3| {
        let b = b as usize;
        let lever = point - motion.position[b];
        if b < ng {
            let mean_spin = 0.5 * (start.1[b] + end.1[b]);
            0.5 * (start.0[b] + end.0[b]) + mean_spin.cross(&lever)
        } else {
            motion.velocity[b] + motion.spin[b].cross(&lever)
        }
    };
    let chunks: Vec<f64> = impulse
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(k, chunk)| {
            let mut sum = 0.0;
            for (c, f) in (k * CHUNK..).zip(chunk) {
                let [candidate, antagonist] = contacts.bodies[c];
                let point = &contacts.point[c];
                sum -= f.dot(&(velocity_at(candidate, point) - velocity_at(antagonist, point)));
            }
            sum
        })
        .collect();
    chunks.iter().sum()
}

/// Kinetic and potential energy of the grains, J; potential energy is zero at the world's origin.
pub fn energies(model: &Model, state: &State) -> (f64, f64) {
    let chunks: Vec<(f64, f64)> = model
        .grains
        .mass
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(k, chunk)| {
            let mut sums = (0.0, 0.0);
            for (i, &mass) in (k * CHUNK..).zip(chunk) {
                let spin = state.orientation[i].inverse() * state.spin[i];
                let turning = model.grains.inertia[i].component_mul(&spin).dot(&spin);
                sums.0 += 0.5 * (mass * state.velocity[i].norm_squared() + turning);
                sums.1 -= mass * model.gravity.dot(&state.position[i]);
            }
            sums
        })
        .collect();
    chunks.iter().fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
}

/// Opens the ledger of a run that starts at `state`.
pub fn open_ledger(model: &Model, state: &State) -> EnergyLedger {
    let (kinetic, potential) = energies(model, state);
    EnergyLedger {
        initial_kinetic: kinetic,
        initial_potential: potential,
        kinetic,
        potential,
        work_in: 0.0,
        dissipated: 0.0,
    }
}
