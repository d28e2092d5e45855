//! The velocity of a boundary grain as a sum of parts, one per set that works on it (T-13).
//!
//! Reads and writes: the sets' lines. Cost: O(boundary grains) per visit of a set. Contract: a part
//! is written by its set alone and read by the others on the fly, so that nothing is lost and
//! momentum is exact to rounding, however visits of different sets overlap.

use super::Decomposition;
use super::decomposition::{Set, open};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Velocity components of a line.
const COMPONENTS: usize = 6;

type Velocity = [f64; COMPONENTS];

/// A part as the other sets see it.
#[derive(Debug, Default)]
struct Slot([AtomicU64; COMPONENTS]);

/// A line of a set whose grain other sets work on as well.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoundaryLine {
    line: u32,
    /// Where this set's part is published, and where all parts of the grain are.
    slot: u32,
    slots: [u32; 2],
    part: Velocity,
    /// Sum of the other parts when they were last read.
    others: Velocity,
}

/// The published parts of all boundary grains.
#[derive(Debug, Default)]
pub(super) struct Boundary {
    slots: Vec<Slot>,
    /// Grain, group and line there, sorted.
    uses: Vec<(u32, u32, u32)>,
}

impl Slot {
    fn store(&self, part: &Velocity) {
        for (to, from) in self.0.iter().zip(part) {
            to.store(from.to_bits(), Ordering::Relaxed);
        }
    }

    fn add_to(&self, sum: &mut Velocity) {
        for (to, from) in sum.iter_mut().zip(&self.0) {
            *to += f64::from_bits(from.load(Ordering::Relaxed));
        }
    }
}

impl Boundary {
    fn read(&self, set: &mut Set) {
        for x in &mut set.boundary {
            x.others = Velocity::default();
            for slot in (x.slots[0]..x.slots[1]).filter(|&slot| slot != x.slot) {
                self.slots[slot as usize].add_to(&mut x.others);
            }
        }
    }

    /// Brings the lines of `set` to the newest sum of parts.
    pub fn gather(&self, set: &mut Set) {
        self.read(set);
        for x in &set.boundary {
            let line = &mut set.contacts.lines[x.line as usize].0;
            for k in 0..COMPONENTS {
                line[k] = x.part[k] + x.others[k];
            }
        }
    }

    /// Makes known what the lines of `set` hold beyond the others' parts, as last read.
    pub fn publish(&self, set: &mut Set) {
        for x in &mut set.boundary {
            let line = &set.contacts.lines[x.line as usize].0;
            x.part = std::array::from_fn(|k| line[k] - x.others[k]);
            self.slots[x.slot as usize].store(&x.part);
        }
    }
}

impl Decomposition {
    /// Splits the velocities into parts: a group's part is what its own impulses have contributed, a
    /// subdomain's part is all the rest.
    pub(super) fn split(&mut self) {
        self.number_parts();
        let Self { subdomains, groups, boundary, .. } = self;
        groups.par_iter_mut().for_each(|group| {
            let set = &mut open(group).set;
            for line in &mut set.contacts.lines {
                line.0[..COMPONENTS].fill(0.0);
            }
            set.contacts.apply_impulses();
            boundary.publish(set);
        });
        subdomains.par_iter_mut().for_each(|set| {
            boundary.read(open(set));
            boundary.publish(open(set));
        });
    }

    /// Writes the sum of all parts into the subdomains' lines.
    pub(super) fn settle(&mut self) {
        let Self { subdomains, boundary, .. } = self;
        subdomains.par_iter_mut().for_each(|set| boundary.gather(open(set)));
    }

    /// Numbers the parts of every boundary grain: its subdomain's first, then those of the groups.
    fn number_parts(&mut self) {
        let Self { subdomains, groups, boundary, partition, line_of, .. } = self;
        let Boundary { slots, uses } = boundary;
        uses.clear();
        for (group, g) in groups.iter_mut().zip(0u32..) {
            let group = open(group);
            group.set.restart();
            uses.extend(group.grains.iter().zip(0u32..).map(|(&grain, line)| (grain, g, line)));
        }
        uses.sort_unstable();
        subdomains.iter_mut().for_each(|set| open(set).restart());
        let mut next = 0;
        for same in uses.chunk_by(|a, b| a.0 == b.0) {
            let grain = same[0].0 as usize;
            let slots = [next, next + 1 + same.len() as u32];
            let line = |line, slot| BoundaryLine {
                line,
                slot,
                slots,
                part: Velocity::default(),
                others: Velocity::default(),
            };
            let home = open(&mut subdomains[partition.owner[grain] as usize]);
            home.boundary.push(line(line_of[grain], next));
            for (&(_, g, at), slot) in same.iter().zip(next + 1..) {
                open(&mut groups[g as usize]).set.boundary.push(line(at, slot));
            }
            next = slots[1];
        }
        slots.resize_with(next as usize, Slot::default);
    }
}
