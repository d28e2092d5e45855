//! What a solved step has overlooked, and is to be done again with (T-35, T-36).
//!
//! Reads: model, the solved step. Writes: reach and foreseen contacts of the workspace. Cost: a norm per body; where bodies
//! were changed much or turn fast, a search among their pairs.
//! Contract: a function of the step alone, so bytes do not depend on threads; asked again and again about one step, it
//! comes to an end.

use crate::detection::{Contacts, max_point_speed};
use crate::math::{Vec3, rotation};
use crate::model::Model;
use crate::motion::Motion;
use crate::workspace::{CorrectionBuffers, Workspace};
use rayon::prelude::*;

/// Grains that turn by more than this in a step, rad, are looked at where they end.
const MIN_RECHECKED_ROTATION: f64 = 0.03;
/// Penetration at the end that the contacts of a step did not foretell, over the candidate's radius, that is let pass.
const PENETRATION_TOLERANCE: f64 = 0.005;
/// How often a step is done before what is found at its end is let pass.
const MAX_PASSES: u32 = 6;

/// Why a step is done again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecheckReason {
    /// Contacts are to be looked for further away.
    RangeTooSmall,
    /// Contacts were added.
    EndOfStepPenetration,
}

/// Whether the step is to be done again; `passes` is how often it has been done.
pub fn recheck(model: &Model, ws: &mut Workspace, passes: u32) -> Option<RecheckReason> {
    if has_missed_contacts(model, ws) {
        return Some(RecheckReason::RangeTooSmall);
    }
    let added = passes < MAX_PASSES && add_end_of_step_contacts(model, ws);
    added.then_some(RecheckReason::EndOfStepPenetration)
}

/// Velocities of all bodies over a solved step: those of the next state, and what penetration correction adds for this step only.
#[derive(Clone, Copy)]
struct SolvedMotion<'a> {
    motion: &'a Motion,
    velocity: &'a [Vec3],
    angular_velocity: &'a [Vec3],
    correction: &'a CorrectionBuffers,
}

impl SolvedMotion<'_> {
    /// Velocity and angular velocity of body `b`, m/s and rad/s.
    fn twist(&self, b: usize) -> (Vec3, Vec3) {
        let (v, w) = self.motion.twist(self.velocity, self.angular_velocity, b);
        let recovered =
            self.correction.velocity.get(b).zip(self.correction.angular_velocity.get(b));
        recovered.map_or((v, w), |(dv, dw)| (v + dv, w + dw))
    }

    /// How fast contact `i` opens, m/s.
    fn opening(&self, contacts: &Contacts, i: usize) -> f64 {
        contacts.opening_speed(i, self.motion, |b| self.twist(b))
    }

    /// Gap of contact `i` in `h` seconds, m.
    fn gap_ahead(&self, contacts: &Contacts, i: usize, h: f64) -> f64 {
        contacts.gap[i] + h * self.opening(contacts, i)
    }

    /// How deep two bodies are in each other, or will be in `h` seconds as their contacts have it, m.
    fn predicted_depth(&self, contacts: &Contacts, bodies: [u32; 2], h: f64) -> f64 {
        let depth = |i: usize| -contacts.gap[i].min(self.gap_ahead(contacts, i, h));
        contacts.pair_range(bodies).map(depth).fold(0.0, f64::max)
    }

    /// Configuration m of the next step, `h` seconds later.
    fn end(&self, h: f64, end: &mut Motion) {
        let Motion {
            position,
            orientation,
            velocity,
            angular_velocity,
            responses,
        } = end;
        position.clone_from(&self.motion.position);
        orientation.clone_from(&self.motion.orientation);
        velocity.clone_from(&self.motion.velocity);
        angular_velocity.clone_from(&self.motion.angular_velocity);
        responses.clone_from(&self.motion.responses);
        for (b, (x, q)) in position.iter_mut().zip(orientation).enumerate() {
            let (v, w) = self.twist(b);
            *x += v * h;
            *q = rotation::advance(q, &(w * h));
        }
    }
}

/// How deep bodies that the step presses further than `limit` into each other will be, m; 0 where there are none. By
/// configurations m of this step and the next, as the contacts of this one have it: what the next step's penetration will
/// be but for turns and new contacts (T-26). Bodies that are deeper already count where they go further.
pub fn penetration_beyond(limit: f64, model: &Model, ws: &Workspace) -> f64 {
    let Workspace { motion, contacts, velocity, angular_velocity, correction, .. } = ws;
    let solved = SolvedMotion { motion, velocity, angular_velocity, correction };
    let h = model.stepping.h();
    // What rests there is not still to the last digit.
    let slack = 1e-5 * limit;
    let depth = |i: usize| {
        let ahead = -solved.gap_ahead(contacts, i, h);
        let now = |k: usize| -contacts.gap[k];
        let goes_on =
            || ahead > slack + contacts.pair_range(contacts.bodies[i]).map(now).fold(0.0, f64::max);
        if ahead > limit && goes_on() { ahead } else { 0.0 }
    };
    (0..contacts.len()).into_par_iter().with_min_len(1024).map(depth).reduce(|| 0.0, f64::max)
}

/// Whether the solve has changed the motion of a body so much that it closed a gap in which no contact was looked for
/// (T-35); more is allowed for such bodies then.
fn has_missed_contacts(model: &Model, ws: &mut Workspace) -> bool {
    let Workspace {
        motion, velocity, angular_velocity, correction, detection_range: reach, ..
    } = ws;
    let solved = SolvedMotion { motion, velocity, angular_velocity, correction };
    let twist = |b: usize| solved.twist(b);
    let change = |b: usize| {
        let (v, w) = twist(b);
        max_point_speed(model, b, &(v - motion.velocity[b]), &(w - motion.angular_velocity[b]))
    };
    if !reach.enlarge(change) {
        return false;
    }
    ws.detector.broad_phase(model, motion, reach);
    let asked = |pair: [usize; 2]| {
        reach.may_have_missed_contact(motion, model.grain_radius(pair[0]), pair, twist)
    };
    ws.detector.narrow_phase_where(model, motion, reach, asked, &mut ws.fresh);
    let (found, h) = (&ws.fresh, model.stepping.h());
    (0..found.len()).any(|i| {
        let pair = found.bodies[i].map(|b| b as usize);
        let (gap, radius) = (found.gap[i], model.grain_radius(pair[0]));
        gap > reach.searched_distance(motion, radius, pair) && solved.gap_ahead(found, i, h) < 0.0
    })
}

/// Whether grains that turn fast end the step deeper in others than any contact of the step foretold (T-36); contacts of
/// where they end are added then.
fn add_end_of_step_contacts(model: &Model, ws: &mut Workspace) -> bool {
    let h = model.stepping.h();
    let Workspace { motion, velocity, angular_velocity, correction, .. } = ws;
    let solved = SolvedMotion { motion, velocity, angular_velocity, correction };
    let ng = model.grains.len();
    let turns = |b: usize| b < ng && h * solved.twist(b).1.norm() > MIN_RECHECKED_ROTATION;
    if !(0..ng).any(turns) {
        return false;
    }
    solved.end(h, &mut ws.end);
    // The list of pairs holds there, too: reach is as far as the step can carry bodies.
    let asked = |[a, b]: [usize; 2]| turns(a) || turns(b);
    ws.detector.narrow_phase_where(model, &ws.end, &ws.detection_range, asked, &mut ws.fresh);
    ws.foreseen.clear();
    let (found, way) = (&ws.fresh, |b: u32| solved.twist(b as usize).0 * h);
    for (i, &bodies) in found.bodies.iter().enumerate() {
        let tolerance = PENETRATION_TOLERANCE * model.grain_radius(bodies[0] as usize);
        if -found.gap[i] <= tolerance {
            continue;
        }
        let excess = found.gap[i] + solved.predicted_depth(&ws.contacts, bodies, h);
        if -excess > tolerance {
            // One point for both bodies, or they would gain spin from nothing: as seen from midway between them.
            let point = found.point[i] - 0.5 * (way(bodies[0]) + way(bodies[1]));
            let k = ws.foreseen.len();
            ws.foreseen.push(bodies, found.feature[i], point, found.normal[i], 0.0);
            ws.foreseen.gap[k] = (excess - h * solved.opening(&ws.foreseen, k)).max(0.0);
        }
    }
    ws.contacts.merge(&ws.foreseen, &mut ws.impulse);
    !ws.foreseen.is_empty()
}
