//! A-posteriori check of a solved step for contacts that collision detection missed (T-35, T-36).
//!
//! Two causes: a body moved further than the detection range allowed for, or a fast-rotating grain penetrates at the
//! end of the step although its linearised gaps did not predict it. In both cases the step is solved again.
//!
//! Reads: model, the solved step. Writes: detection range and added contacts of the workspace. Cost: a norm per body;
//! where velocities changed much or bodies rotate fast, a search among their pairs. Contract: a function of the step
//! alone, so results do not depend on threads; repeated checks of one step terminate.

use crate::detection::{Contacts, max_point_speed};
use crate::math::{Vec3, rotation};
use crate::model::Model;
use crate::motion::Motion;
use crate::workspace::{CorrectionBuffers, Workspace};
use rayon::prelude::*;

/// Minimum rotation of a grain in a step, rad, for which its end-of-step configuration is checked.
const MIN_RECHECKED_ROTATION: f64 = 0.03;
/// Tolerated unpredicted penetration at the end of a step, over the candidate's radius.
const PENETRATION_TOLERANCE: f64 = 0.005;
/// Maximum number of solves of a step that end-of-step penetration may cause.
const MAX_PASSES: u32 = 6;

/// Reason to solve a step again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecheckReason {
    /// A gap outside the detection range closed; the range has been enlarged (T-35).
    RangeTooSmall,
    /// Contacts at the end-of-step configuration were added (T-36).
    EndOfStepPenetration,
}

/// Returns why the step must be solved again, or `None` if it stands. `passes` counts the solves made so far.
pub fn recheck(model: &Model, ws: &mut Workspace, passes: u32) -> Option<RecheckReason> {
    if has_missed_contacts(model, ws) {
        return Some(RecheckReason::RangeTooSmall);
    }
    let added = passes < MAX_PASSES && add_end_of_step_contacts(model, ws);
    added.then_some(RecheckReason::EndOfStepPenetration)
}

/// Velocities of all bodies over a solved step, including the penetration correction of this step only.
#[derive(Clone, Copy)]
struct SolvedMotion<'a> {
    motion: &'a Motion,
    velocity: &'a [Vec3],
    angular_velocity: &'a [Vec3],
    correction: &'a CorrectionBuffers,
}

impl SolvedMotion<'_> {
    /// Returns velocity (m/s) and angular velocity (rad/s) of body `b`.
    fn twist(&self, b: usize) -> (Vec3, Vec3) {
        let (v, w) = self.motion.twist(self.velocity, self.angular_velocity, b);
        let corrected =
            self.correction.velocity.get(b).zip(self.correction.angular_velocity.get(b));
        corrected.map_or((v, w), |(dv, dw)| (v + dv, w + dw))
    }

    /// Returns the opening speed of contact `i`, m/s.
    fn opening(&self, contacts: &Contacts, i: usize) -> f64 {
        contacts.opening_speed(i, self.motion, |b| self.twist(b))
    }

    /// Returns the gap of contact `i` in `h` seconds, m.
    fn gap_ahead(&self, contacts: &Contacts, i: usize, h: f64) -> f64 {
        contacts.gap[i] + h * self.opening(contacts, i)
    }

    /// Returns the present or linearly predicted depth of two bodies, whichever is larger, m.
    fn predicted_depth(&self, contacts: &Contacts, bodies: [u32; 2], h: f64) -> f64 {
        let depth = |i: usize| -contacts.gap[i].min(self.gap_ahead(contacts, i, h));
        contacts.pair_range(bodies).map(depth).fold(0.0, f64::max)
    }

    /// Fills `end` with configuration m of the next step, `h` seconds later.
    fn end(&self, h: f64, end: &mut Motion) {
        let Motion { position, orientation, velocity, angular_velocity, responses } = end;
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

/// Returns the largest predicted depth of pairs that the step pushes beyond `limit`, m; 0 without any.
///
/// Compares configurations m of this step and the next by the linearised gaps; the next step's penetration differs by
/// rotations and new contacts only (T-26). Pairs that are already deeper count if their depth grows.
pub fn penetration_beyond(limit: f64, model: &Model, ws: &Workspace) -> f64 {
    let Workspace { motion, contacts, velocity, angular_velocity, correction, .. } = ws;
    let solved = SolvedMotion { motion, velocity, angular_velocity, correction };
    let h = model.stepping.h();
    // A pair at rest at the limit still moves in the last digits.
    let slack = 1e-5 * limit;
    let depth = |i: usize| {
        let ahead = -solved.gap_ahead(contacts, i, h);
        let now = |k: usize| -contacts.gap[k];
        let is_growing =
            || ahead > slack + contacts.pair_range(contacts.bodies[i]).map(now).fold(0.0, f64::max);
        if ahead > limit && is_growing() { ahead } else { 0.0 }
    };
    (0..contacts.len()).into_par_iter().with_min_len(1024).map(depth).reduce(|| 0.0, f64::max)
}

/// Returns true if the solve closed a gap outside the detection range, which it then enlarges (T-35).
fn has_missed_contacts(model: &Model, ws: &mut Workspace) -> bool {
    let Workspace {
        motion, velocity, angular_velocity, correction, detection_range: range, ..
    } = ws;
    let solved = SolvedMotion { motion, velocity, angular_velocity, correction };
    let twist = |b: usize| solved.twist(b);
    let change = |b: usize| {
        let (v, w) = twist(b);
        max_point_speed(model, b, &(v - motion.velocity[b]), &(w - motion.angular_velocity[b]))
    };
    if !range.enlarge(change) {
        return false;
    }
    ws.detector.broad_phase(model, motion, range);
    let is_wanted = |pair: [usize; 2]| {
        range.may_have_missed_contact(motion, model.grain_radius(pair[0]), pair, twist)
    };
    ws.detector.narrow_phase_where(model, motion, range, is_wanted, &mut ws.fresh);
    let (found, h) = (&ws.fresh, model.stepping.h());
    (0..found.len()).any(|i| {
        let pair = found.bodies[i].map(|b| b as usize);
        let (gap, radius) = (found.gap[i], model.grain_radius(pair[0]));
        gap > range.searched_distance(motion, radius, pair) && solved.gap_ahead(found, i, h) < 0.0
    })
}

/// Adds contacts at the end-of-step configuration where fast-rotating grains penetrate more than predicted (T-36).
///
/// Returns true if any was added.
fn add_end_of_step_contacts(model: &Model, ws: &mut Workspace) -> bool {
    let h = model.stepping.h();
    let Workspace { motion, velocity, angular_velocity, correction, .. } = ws;
    let solved = SolvedMotion { motion, velocity, angular_velocity, correction };
    let ng = model.grains.len();
    let rotates_fast = |b: usize| b < ng && h * solved.twist(b).1.norm() > MIN_RECHECKED_ROTATION;
    if !(0..ng).any(rotates_fast) {
        return false;
    }
    solved.end(h, &mut ws.end);
    // The pair list is valid there as well: the range covers the displacement of the step.
    let is_wanted = |[a, b]: [usize; 2]| rotates_fast(a) || rotates_fast(b);
    ws.detector.narrow_phase_where(model, &ws.end, &ws.detection_range, is_wanted, &mut ws.fresh);
    ws.foreseen.clear();
    let (found, displacement) = (&ws.fresh, |b: u32| solved.twist(b as usize).0 * h);
    for (i, &bodies) in found.bodies.iter().enumerate() {
        let tolerance = PENETRATION_TOLERANCE * model.grain_radius(bodies[0] as usize);
        if -found.gap[i] <= tolerance {
            continue;
        }
        let excess = found.gap[i] + solved.predicted_depth(&ws.contacts, bodies, h);
        if -excess > tolerance {
            // One point for both bodies, midway between them, because two points would create angular momentum.
            let point = found.point[i] - 0.5 * (displacement(bodies[0]) + displacement(bodies[1]));
            let k = ws.foreseen.len();
            ws.foreseen.push(bodies, found.feature[i], point, found.normal[i], 0.0);
            ws.foreseen.gap[k] = (excess - h * solved.opening(&ws.foreseen, k)).max(0.0);
        }
    }
    ws.contacts.merge(&ws.foreseen, &mut ws.impulse, &mut ws.history);
    !ws.foreseen.is_empty()
}
