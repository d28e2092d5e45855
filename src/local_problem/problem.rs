//! Construction of the local problem from the contacts of a step.

use super::contact::{ContactSide, LocalContact};
use super::lane_builder::{ContactGeometryRows, ContactRows};
use crate::detection::{ContactHistory, Contacts};
use crate::lanes::{self, BodyVelocity, InstructionSet, LANES, LaneKernel, Lanes};
use crate::math::{Mat3, Vec3};
use crate::model::Model;
use crate::motion::{Motion, MountResponse};
use crate::state::State;
use rayon::prelude::*;

/// Contacts that a thread builds at once.
const CHUNK: usize = 32 * LANES;

/// Contacts of a step with the data that converts lines to velocities.
#[derive(Debug, Default)]
pub struct LocalProblem {
    /// Contacts `[nc]`, in the order of [`Contacts`].
    pub contacts: Vec<LocalContact>,
    /// Free velocities of the mobile bodies `[ng + nm]`.
    pub lines: Vec<BodyVelocity>,
    /// Whitening matrix `B = R D^(-1/2)` of each mobile body `[ng + nm]`, (kg m²)^(-1/2): world angular velocity is `B ŵ`.
    pub whitening: Vec<Mat3>,
    /// Responses of the mounted bodies, which follow the grains.
    pub responses: Vec<MountResponse>,
    /// Velocity that gravity adds in a step, m/s; infinite where it is no scale.
    pub gravity_dv: f64,
}

impl LocalProblem {
    /// Builds the problem of a step.
    ///
    /// `warm` are initial impulses on the candidates, world axes, N s `[nc]`, or empty for zero. The springs of the contacts
    /// continue from `history`.
    pub fn build(
        &mut self,
        model: &Model,
        state: &State,
        motion: &Motion,
        contacts: &Contacts,
        warm: &[Vec3],
        history: &ContactHistory,
    ) {
        self.build_lines(model, motion);
        let Self { contacts: built, lines, whitening, responses, .. } = self;
        let (lines, whitening, responses) = (&**lines, &**whitening, &**responses);
        let gravity_dv = model.gravity.norm() * model.stepping.h();
        let step = ProblemInputs {
            model,
            state,
            motion,
            contacts,
            warm,
            history,
            lines,
            whitening,
            responses,
            gravity_dv,
        };
        let arithmetic = InstructionSet::detect();
        built.resize(contacts.len(), LocalContact::default());
        built.par_chunks_mut(CHUNK).enumerate().for_each(|(k, built)| {
            lanes::compute(arithmetic, BuildChunk { step: &step, first: k * CHUNK, built });
        });
        self.gravity_dv = if gravity_dv > 0.0 { gravity_dv } else { f64::INFINITY };
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
                let whitened =
                    rotation.matrix().tr_mul(&motion.angular_velocity[b]).component_mul(&root);
                let line =
                    BodyVelocity::new(&motion.velocity[b], &whitened, 1.0 / model.grains.mass[b]);
                (line, rotation.matrix() * Mat3::from_diagonal(&inverse_root))
            })
            .unzip_into_vecs(&mut self.lines, &mut self.whitening);
        self.responses.clone_from(&motion.responses);
        for r in &self.responses {
            self.lines.push(BodyVelocity::new(&r.velocity, &r.whitened_velocity, r.inverse_mass));
            self.whitening.push(r.angular_map);
        }
    }

    /// Velocity (m/s) and angular velocity (world axes, rad/s) of a body whose line is `line`.
    pub fn velocity(&self, body: usize, line: &BodyVelocity) -> (Vec3, Vec3) {
        let (velocity, whitened) = (line.velocity(), line.whitened_angular_velocity());
        match body.checked_sub(self.lines.len() - self.responses.len()) {
            Some(d) => self.responses[d].twist(&velocity, &whitened),
            None => (velocity, self.whitening[body] * whitened),
        }
    }

    /// Number of mobile bodies.
    pub fn body_count(&self) -> usize {
        self.lines.len()
    }

    /// Returns true if the antagonist of contact `i` is a driven body without a line.
    pub fn is_single(&self, i: usize) -> bool {
        self.contacts[i].bodies[1] as usize >= self.lines.len()
    }
}

/// Data from which contacts are built.
struct ProblemInputs<'a> {
    model: &'a Model,
    state: &'a State,
    motion: &'a Motion,
    contacts: &'a Contacts,
    warm: &'a [Vec3],
    history: &'a ContactHistory,
    lines: &'a [BodyVelocity],
    whitening: &'a [Mat3],
    responses: &'a [MountResponse],
    /// Velocity that gravity adds in a step, m/s.
    gravity_dv: f64,
}

impl ProblemInputs<'_> {
    /// Returns the data of a mobile body for the contact at `point`.
    // Inlined here and below, so that values reach their rows in registers.
    #[inline(always)]
    fn side(&self, b: usize, point: &Vec3) -> ContactSide {
        let response = b.checked_sub(self.model.grains.len()).map(|d| &self.responses[d]);
        let lever = point - self.motion.position[b];
        ContactSide {
            lever: response.map_or(lever, |r| lever - r.centre),
            inverse_mass: self.lines[b].inverse_mass(),
            whitening: self.whitening[b],
            shift: response.map(|r| r.linear_map),
        }
    }

    /// Sets a lane to contact `i`.
    #[inline(always)]
    fn set(&self, i: usize, geometry: &mut ContactGeometryRows, lane: usize) {
        let Contacts { bodies, point, normal, .. } = self.contacts;
        let [c, a] = bodies[i].map(|b| b as usize);
        let antagonist = (a < self.lines.len()).then(|| self.side(a, &point[i]));
        let compliance = self.compliance(a);
        geometry.set(lane, &normal[i], &self.side(c, &point[i]), antagonist.as_ref(), &compliance);
    }

    /// Returns the compliances (normal, tangential) of contacts with antagonist `a`, 1/kg, rounded.
    #[inline(always)]
    fn compliance(&self, a: usize) -> [f32; 2] {
        let compliance = self.model.contact_stiffness(a).compliance(self.model.stepping.h());
        compliance.map(|c| c as f32)
    }

    /// Sets the fields that do not follow from frame and bodies.
    fn finish(&self, i: usize, contact: &mut LocalContact) {
        let Self { model, state, motion, contacts, warm, history, lines, .. } = self;
        let h = model.stepping.h();
        let (point, gap) = (contacts.point[i], contacts.gap[i]);
        let [c, a] = contacts.bodies[i].map(|b| b as usize);
        contact.bodies = contacts.bodies[i];
        let approach = if model.restitution > 0.0 {
            let start = |b: usize| {
                let (velocity, angular_velocity) = motion.initial_twist(model, state, b);
                velocity + angular_velocity.cross(&(point - motion.position[b]))
            };
            contact.axes()[0].dot(&(start(c) - start(a))).min(0.0)
        } else {
            0.0
        };
        let stiffness = model.contact_stiffness(a);
        contact.compliance = self.compliance(a);
        contact.offset = if !stiffness.is_rigid() {
            let held = contact.yielding(&contact.components(&history.impulse[i]));
            let start = history.spring_gap(i, gap, h);
            Vec3::new(stiffness.gap_speed(start, h), -held.y, -held.z)
        } else if approach < 0.0 && gap + h * approach <= 0.0 {
            // A gap that the approach closes within this step rebounds now: anticipating it
            // would brake the grains first and leave the rebound with what remains.
            Vec3::new(model.restitution * approach, 0.0, 0.0)
        } else {
            Vec3::new(stiffness.gap_speed(gap, h), 0.0, 0.0)
        };
        let body = a.checked_sub(model.grains.len()).map(|d| &model.driven[d]);
        contact.friction = body.map_or(model.grain_friction, |b| b.friction) as f32;
        if a < lines.len() {
            // Pair blocks store it in f32: 6e-8 of the gap.
            contact.offset = contact.offset.map(|x| x as f32 as f64);
        } else {
            let lever = point - motion.position[a];
            let surface = motion.velocity[a] + motion.angular_velocity[a].cross(&lever);
            contact.offset -= contact.components(&surface);
        }
        // A zero impulse stays exactly zero: its components might be signed zeros.
        let world = warm.get(i).filter(|world| **world != Vec3::zeros());
        contact.impulse = world.map_or(Vec3::zeros(), |world| contact.components(world));
        let approach = contact.offset.x + contact.normal_velocity(lines);
        // A neighbouring impulse may change the velocity by as much as gravity.
        contact.is_likely_active = contact.impulse.x > 0.0 || approach < self.gravity_dv;
    }
}

/// Chunk of contacts to build, from number `first` on.
struct BuildChunk<'a> {
    step: &'a ProblemInputs<'a>,
    first: usize,
    built: &'a mut [LocalContact],
}

impl LaneKernel for BuildChunk<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (mut geometry, mut rows) = (ContactGeometryRows::default(), ContactRows::default());
        for (block, contacts) in self.built.chunks_mut(LANES).enumerate() {
            let first = self.first + block * LANES;
            for lane in 0..contacts.len() {
                self.step.set(first + lane, &mut geometry, lane);
            }
            geometry.build::<L>(&mut rows);
            for (lane, contact) in contacts.iter_mut().enumerate() {
                rows.get(lane, contact);
                self.step.finish(first + lane, contact);
            }
        }
    }
}
