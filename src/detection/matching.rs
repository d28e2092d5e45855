//! Matching of this step's contacts with those of the last step.
//!
//! Reads: motion, contacts, [`ContactMemory`]. Writes: [`ContactHistory`], the next memory. Cost: O(contacts).
//! Contract: each old contact is used at most once; independent of threads.

use super::contacts::Contacts;
use super::history::ContactHistory;
use crate::math::Vec3;
use crate::model::Model;
use crate::motion::Motion;
use crate::state::ContactMemory;
use rayon::prelude::*;

/// Maximum number of contacts per unit of parallel work; pairs are not split.
const CHUNK: usize = 1024;
/// Maximum displacement of a matched contact point in its body, over the candidate's radius.
const TOLERANCE: f64 = 0.2;
/// Maximum gap of a closed contact, over the candidate's radius.
const MAX_CLOSED_GAP: f64 = 1e-3;

/// Fills `history` with impulse and overlap of each contact `[nc]` in the last step (T-20).
///
/// They are those of the same contact in `memory`, or zero without one. In a pair of bodies, contacts with equal
/// features are the same. Of the others, the nearest points in the candidate's frame are matched first, up to a fifth of
/// its radius.
pub fn match_contacts(
    model: &Model,
    motion: &Motion,
    memory: &ContactMemory,
    contacts: &Contacts,
    history: &mut ContactHistory,
) {
    let ContactHistory { impulse, overlap } = history;
    impulse.resize(contacts.len(), Vec3::zeros());
    overlap.resize(contacts.len(), 0.0);
    ContactMatching { model, motion, memory, contacts }.run(0, impulse, overlap);
}

/// Returns the sum of the impulses of the previous step, N s, on pairs that are open where it ended, and that on all pairs.
///
/// `contacts` are those of configuration m, where the gaps of the previous step were to close. A pair is open if it has no
/// contact there, or none with a gap below a thousandth of the candidate's radius.
pub fn open_impulse(model: &Model, memory: &ContactMemory, contacts: &Contacts) -> [f64; 2] {
    let mut sums = [0.0; 2];
    let mut new = 0;
    let mut old = 0;
    while old < memory.bodies.len() {
        let bodies = memory.bodies[old];
        let end = run_end(&memory.bodies, old);
        let impulse: f64 = memory.impulse[old..end].iter().map(|r| r.norm()).sum();
        while new < contacts.len() && contacts.bodies[new] < bodies {
            new += 1;
        }
        let closed_gap = MAX_CLOSED_GAP * model.grain_radius(bodies[0] as usize);
        let pair = contacts.bodies[new..].iter().zip(&contacts.gap[new..]);
        let is_closed = pair.take_while(|(b, _)| **b == bodies).any(|(_, gap)| *gap <= closed_gap);
        sums[0] += if is_closed { 0.0 } else { impulse };
        sums[1] += impulse;
        old = end;
    }
    sums
}

struct ContactMatching<'a> {
    model: &'a Model,
    motion: &'a Motion,
    memory: &'a ContactMemory,
    contacts: &'a Contacts,
}

impl ContactMatching<'_> {
    /// Matches the contacts `from..from + impulse.len()`, which are those of whole pairs.
    fn run(&self, from: usize, impulse: &mut [Vec3], overlap: &mut [f64]) {
        match self.cut(from, impulse.len()) {
            Some(n) => {
                let (left, right) = impulse.split_at_mut(n);
                let (left_overlap, right_overlap) = overlap.split_at_mut(n);
                rayon::join(
                    || self.run(from, left, left_overlap),
                    || self.run(from + n, right, right_overlap),
                );
            }
            None => self.match_all(from, impulse, overlap),
        }
    }

    /// Returns the number of contacts after which `n` contacts from `from` on are split; `None` if they are few.
    fn cut(&self, from: usize, n: usize) -> Option<usize> {
        let bodies = &self.contacts.bodies[from..from + n];
        let starts_pair = |k: &usize| bodies[*k] != bodies[*k - 1];
        (n > CHUNK).then(|| (n / 2..n).find(starts_pair))?
    }

    fn match_all(&self, from: usize, impulse: &mut [Vec3], overlap: &mut [f64]) {
        impulse.fill(Vec3::zeros());
        overlap.fill(0.0);
        let Some(first) = self.contacts.bodies.get(from) else { return };
        let old_bodies = &self.memory.bodies;
        let mut old = old_bodies.partition_point(|b| b < first);
        let end = from + impulse.len();
        let mut used = Vec::new();
        let mut new = from;
        while new < end {
            let bodies = self.contacts.bodies[new];
            let next = run_end(&self.contacts.bodies[..end], new);
            while old < old_bodies.len() && old_bodies[old] < bodies {
                old += 1;
            }
            if old < old_bodies.len() && old_bodies[old] == bodies {
                let old_end = run_end(old_bodies, old);
                let pair = new - from..next - from;
                let (impulse, overlap) = (&mut impulse[pair.clone()], &mut overlap[pair]);
                self.pair(new..next, old..old_end, impulse, overlap, &mut used);
                old = old_end;
            }
            new = next;
        }
    }

    fn pair(
        &self,
        new: std::ops::Range<usize>,
        old: std::ops::Range<usize>,
        impulse: &mut [Vec3],
        overlap: &mut [f64],
        used: &mut Vec<bool>,
    ) {
        used.clear();
        used.resize(old.len() + new.len(), false);
        let (old_used, new_used) = used.split_at_mut(old.len());
        let mut keep = |n: usize, o: usize| {
            impulse[n - new.start] = self.memory.impulse[o];
            overlap[n - new.start] = self.memory.overlap[o];
        };
        for n in new.clone() {
            let same = |o: &usize| self.memory.feature[*o] == self.contacts.feature[n];
            let unused = old.clone().filter(|o| !old_used[o - old.start]);
            if let Some(o) = unused.into_iter().find(same) {
                keep(n, o);
                old_used[o - old.start] = true;
                new_used[n - new.start] = true;
            }
        }
        if old_used.iter().all(|u| *u) || new_used.iter().all(|u| *u) {
            return;
        }
        let candidate = self.contacts.bodies[new.start][0] as usize;
        let pose = self.motion.pose(candidate);
        let shape = self.model.grains.shape[candidate] as usize;
        let max_distance = TOLERANCE * self.model.shapes[shape].radius;
        // The nearest pair is first; among equals the first in the order of contacts.
        loop {
            let mut best = (max_distance * max_distance, None);
            for n in new.clone().filter(|n| !new_used[n - new.start]) {
                let point = pose.inverse_point(&self.contacts.point[n]);
                for o in old.clone().filter(|o| !old_used[o - old.start]) {
                    let d = (self.memory.local_point[o] - point).norm_squared();
                    if d < best.0 {
                        best = (d, Some((n, o)));
                    }
                }
            }
            let Some((n, o)) = best.1 else { break };
            keep(n, o);
            old_used[o - old.start] = true;
            new_used[n - new.start] = true;
        }
        let gone = self.memory.overlap[old].iter().zip(&*old_used).filter(|(_, used)| !**used);
        let squares: f64 = gone.map(|(overlap, _)| overlap * overlap).sum();
        let come = new_used.iter().filter(|used| !**used).count();
        let shared = (squares / come.max(1) as f64).sqrt();
        for (own, _) in overlap.iter_mut().zip(&*new_used).filter(|(_, used)| !**used) {
            *own = shared;
        }
    }
}

/// Returns the end of the run of equal bodies that starts at `start`.
fn run_end(bodies: &[[u32; 2]], start: usize) -> usize {
    let same = bodies[start..].iter().take_while(|b| **b == bodies[start]).count();
    start + same
}

/// Stores this step's contacts, their impulses (`[nc]`, world axes, N s) and the overlaps of their springs at its end
/// (`[nc]`, m) for the next [`match_contacts`].
pub fn store_contacts(
    motion: &Motion,
    contacts: &Contacts,
    impulse: &[Vec3],
    overlap: &[f64],
    memory: &mut ContactMemory,
) {
    copy(overlap, &mut memory.overlap);
    copy(&contacts.bodies, &mut memory.bodies);
    copy(&contacts.feature, &mut memory.feature);
    copy(impulse, &mut memory.impulse);
    (&contacts.bodies, &contacts.point)
        .into_par_iter()
        .with_min_len(1024)
        .map(|(bodies, point)| motion.pose(bodies[0] as usize).inverse_point(point))
        .collect_into_vec(&mut memory.local_point);
}

/// Copies in parallel; large beds have tens of megabytes.
fn copy<T: Copy + Send + Sync>(from: &[T], to: &mut Vec<T>) {
    from.par_iter().copied().with_min_len(8192).collect_into_vec(to);
}
