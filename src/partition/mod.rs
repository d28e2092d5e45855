//! Partition of grains into subdomains, and of contacts into subdomains and interface (T-13).
//!
//! Every grain, and every mounted body (T-28), has exactly one owner. A contact between two of them in one subdomain,
//! or between one and a body with imposed motion, belongs to that subdomain; a contact between those of two
//! subdomains belongs to the interface. Nothing is duplicated.
//!
//! Reads: positions, contacts, the rule. Writes: [`Partition`]. Cost: O(grains log subdomains + contacts). Contract:
//! a function of the scene alone, never of the number of threads.

mod boxes;
mod compact;
mod interface;
mod lists;

use crate::detection::Contacts;
use crate::math::Vec3;
use crate::model::PartitionRule;
use rayon::prelude::*;

pub use interface::Interface;
pub use lists::Lists;

/// Owners of grains and contacts in one step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Partition {
    /// Subdomain of each grain `[ng]`.
    pub owner: Vec<u32>,
    /// Grains of each subdomain, ascending.
    pub grains: Lists,
    /// Contacts of each subdomain, ascending.
    pub contacts: Lists,
    /// Contacts between subdomains.
    pub interface: Interface,
    sorted: Vec<SubdomainContacts>,
}

/// Contacts of the grains of one subdomain: internal ones, and by their two owners those of the interface.
#[derive(Debug, Clone, Default, PartialEq)]
struct SubdomainContacts {
    internal: Vec<u32>,
    interface: Vec<([u32; 2], u32)>,
}

/// Grains per unit of parallel work.
const CHUNK: usize = 1024;

/// Returns the first contact of each candidate, and the end of the last one's contacts.
fn starts_of_candidates(candidates: usize, contacts: &Contacts) -> Vec<u32> {
    let mut starts = vec![0; candidates + 1];
    starts.par_chunks_mut(CHUNK).enumerate().for_each(|(k, starts)| {
        let first = k * CHUNK;
        let mut next = contacts.bodies.partition_point(|b| (b[0] as usize) < first);
        for (candidate, start) in (first..).zip(starts) {
            let before = |b: &&[u32; 2]| (b[0] as usize) < candidate;
            next += contacts.bodies[next..].iter().take_while(before).count();
            *start = next as u32;
        }
    });
    starts
}

impl Partition {
    /// Distributes grains at `position` `[ng]` and their `contacts`.
    pub fn divide(&mut self, rule: PartitionRule, position: &[Vec3], contacts: &Contacts) {
        let ng = position.len();
        self.owner.clear();
        self.owner.resize(ng, 0);
        let subdomains = match rule {
            PartitionRule::Boxes(grid) => boxes::assign(grid, position, &mut self.owner),
            PartitionRule::Balanced(n) => {
                self.assign_compact(n.max(1) as usize, position, contacts)
            }
            PartitionRule::ContactsPer(size) => {
                let n = contacts.len().div_ceil(size.max(1) as usize).max(1);
                self.assign_compact(n, position, contacts)
            }
        };
        self.grains.fill(subdomains, self.owner.iter().copied());
        self.sort_contacts(contacts);
    }

    /// Assigns each contact, subdomain by subdomain, as contacts are sorted by candidate.
    fn sort_contacts(&mut self, contacts: &Contacts) {
        let Self { owner, grains, contacts: internal, interface, sorted } = self;
        let starts = starts_of_candidates(owner.len(), contacts);
        sorted.resize_with(grains.len(), SubdomainContacts::default);
        sorted.par_iter_mut().enumerate().for_each(|(s, part)| {
            let s = s as u32;
            part.internal.clear();
            part.interface.clear();
            for &grain in grains.list(s as usize) {
                for c in starts[grain as usize]..starts[grain as usize + 1] {
                    match owner.get(contacts.bodies[c as usize][1] as usize) {
                        Some(&other) if other != s => {
                            part.interface.push(([s.min(other), s.max(other)], c));
                        }
                        _ => part.internal.push(c),
                    }
                }
            }
            part.interface.sort_unstable();
        });
        internal.clear();
        sorted.iter().for_each(|part| internal.push_list(&part.internal));
        let mut between: Vec<_> = sorted.iter().flat_map(|part| &part.interface).copied().collect();
        // A stable sort is faster on sorted runs.
        between.sort();
        interface.group(grains.len(), &between);
    }

    /// Assigns all grains and contacts to one set.
    pub fn assign_single_set(&mut self, grains: usize, contacts: &Contacts) {
        self.owner.clear();
        self.owner.resize(grains, 0);
        self.grains.fill(1, self.owner.iter().copied());
        self.contacts.fill(1, contacts.bodies.iter().map(|_| 0));
        self.interface.group(1, &[]);
        self.sorted.clear();
    }

    fn assign_compact(&mut self, n: usize, position: &[Vec3], contacts: &Contacts) -> usize {
        let mut weight = vec![1u32; position.len()];
        for bodies in &contacts.bodies {
            for &b in bodies {
                if let Some(w) = weight.get_mut(b as usize) {
                    *w += 1;
                }
            }
        }
        compact::assign(n, position, &weight, &mut self.owner);
        n
    }
}

#[cfg(test)]
mod tests;
