//! Velocity of a boundary body as a sum of parts, one per set that changes it (T-13).
//!
//! Reads and writes: velocities of the sets. Cost: O(boundary bodies) per visit of a set. Contract: a part
//! is written by its set alone and read by the others during their visits. Nothing is lost, and linear
//! momentum is exact to rounding, however visits of different sets overlap.

use super::sweep_set::{
    BoundaryBody, COMPONENTS, InterfaceGroup, SweepSet, VelocityParts, get_mut,
};
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

/// Published part of a velocity, as bits.
#[derive(Debug, Default)]
struct PartSlot([AtomicU64; COMPONENTS]);

/// Published velocity parts of all boundary bodies.
#[derive(Debug, Default)]
pub(super) struct Boundary {
    slots: Vec<PartSlot>,
    /// Body, group and line there, sorted.
    uses: Vec<(u32, u32, u32)>,
}

impl PartSlot {
    fn store(&self, part: &VelocityParts) {
        for (to, from) in self.0.iter().zip(part) {
            to.store(from.to_bits(), Ordering::Relaxed);
        }
    }

    fn add_to(&self, sum: &mut VelocityParts) {
        for (to, from) in sum.iter_mut().zip(&self.0) {
            *to += f64::from_bits(from.load(Ordering::Relaxed));
        }
    }
}

impl Boundary {
    fn read(&self, set: &mut SweepSet) {
        for x in &mut set.boundary {
            x.others = VelocityParts::default();
            for slot in (x.slots[0]..x.slots[1]).filter(|&slot| slot != x.slot) {
                self.slots[slot as usize].add_to(&mut x.others);
            }
        }
    }

    /// Sets the velocities of `set` to the newest sums of parts.
    pub fn gather(&self, set: &mut SweepSet) {
        self.read(set);
        for x in &set.boundary {
            let line = &mut set.contacts.lines[x.line as usize].0;
            for k in 0..COMPONENTS {
                line[k] = x.part[k] + x.others[k];
            }
        }
    }

    /// Publishes the velocities of `set` minus the other parts as last read.
    pub fn publish(&self, set: &mut SweepSet) {
        for x in &mut set.boundary {
            let line = &set.contacts.lines[x.line as usize].0;
            x.part = std::array::from_fn(|k| line[k] - x.others[k]);
            self.slots[x.slot as usize].store(&x.part);
        }
    }

    /// Splits the velocities into parts: the part of a group comes from its own impulses, the part of a
    /// subdomain is the rest.
    ///
    /// `owner` is the subdomain of each body, `line_of` its line there `[ng]`.
    pub fn split(
        &mut self,
        subdomains: &mut [Mutex<SweepSet>],
        groups: &mut [Mutex<InterfaceGroup>],
        owner: &[u32],
        line_of: &[u32],
    ) {
        self.number_parts(subdomains, groups, owner, line_of);
        groups.par_iter_mut().for_each(|group| {
            let set = &mut get_mut(group).set;
            for line in &mut set.contacts.lines {
                line.0[..COMPONENTS].fill(0.0);
            }
            set.contacts.apply_impulses();
            self.publish(set);
        });
        subdomains.par_iter_mut().for_each(|set| {
            self.read(get_mut(set));
            self.publish(get_mut(set));
        });
    }

    /// Numbers the parts of every boundary body: its subdomain's first, then those of the groups.
    fn number_parts(
        &mut self,
        subdomains: &mut [Mutex<SweepSet>],
        groups: &mut [Mutex<InterfaceGroup>],
        owner: &[u32],
        line_of: &[u32],
    ) {
        let Self { slots, uses } = self;
        uses.clear();
        for (group, g) in groups.iter_mut().zip(0u32..) {
            let group = get_mut(group);
            group.set.reset();
            uses.extend(group.grains.iter().zip(0u32..).map(|(&grain, line)| (grain, g, line)));
        }
        uses.sort_unstable();
        subdomains.iter_mut().for_each(|set| get_mut(set).reset());
        let mut next = 0;
        for same in uses.chunk_by(|a, b| a.0 == b.0) {
            let grain = same[0].0 as usize;
            let slots = [next, next + 1 + same.len() as u32];
            let part = VelocityParts::default();
            let body = |line, slot| BoundaryBody { line, slot, slots, part, others: part };
            get_mut(&mut subdomains[owner[grain] as usize])
                .boundary
                .push(body(line_of[grain], next));
            for (&(_, g, line), slot) in same.iter().zip(next + 1..) {
                get_mut(&mut groups[g as usize]).set.boundary.push(body(line, slot));
            }
            next = slots[1];
        }
        slots.resize_with(next as usize, PartSlot::default);
    }
}
