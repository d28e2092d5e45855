//! Grains to subdomains, contacts to subdomains and interface (T-13).
//!
//! Every grain has exactly one owner. A contact between two grains of one subdomain, or between a
//! grain and a driven body, belongs to the grain's subdomain; a contact between grains of two
//! subdomains belongs to the interface. Nothing is duplicated.
//!
//! Reads: positions, contacts, the rule. Writes: [`Partition`]. Cost: O(grains log subdomains +
//! contacts). Contract: a function of the scene alone, never of the number of threads.

mod boxes;
mod compact;
mod interface;

use crate::detection::Contacts;
use crate::math::Vec3;
use crate::model::PartitionRule;
use rayon::prelude::*;

pub use interface::Interface;

/// Who owns what in one step.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Partition {
    /// Subdomain of each grain `[ng]`.
    pub owner: Vec<u32>,
    /// Grains of each subdomain, ascending.
    pub grains: Lists,
    /// Contacts of each subdomain, ascending.
    pub contacts: Lists,
    pub interface: Interface,
}

/// Lists of numbers in one array: list `i` is `items[starts[i]..starts[i + 1]]`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lists {
    pub starts: Vec<u32>,
    pub items: Vec<u32>,
}

impl Lists {
    /// Number of lists.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Whether there is no list.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// List `i`.
    pub fn list(&self, i: usize) -> &[u32] {
        &self.items[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Files each item `0..keys.len()` under its key; items whose key is `lists` or more are left
    /// out. Stable, so every list is ascending.
    fn fill(&mut self, lists: usize, keys: impl Iterator<Item = u32> + Clone) {
        self.file(lists, keys.zip(0..).filter(|&(key, _)| (key as usize) < lists));
    }

    /// Files items under their keys, which are below `lists`, in the order in which they come.
    fn file(&mut self, lists: usize, entries: impl Iterator<Item = (u32, u32)> + Clone) {
        self.starts.clear();
        self.starts.resize(lists + 1, 0);
        for (key, _) in entries.clone() {
            self.starts[key as usize + 1] += 1;
        }
        for i in 0..lists {
            self.starts[i + 1] += self.starts[i];
        }
        self.items.clear();
        self.items.resize(self.starts[lists] as usize, 0);
        let mut next = self.starts.clone();
        for (key, item) in entries {
            let place = &mut next[key as usize];
            self.items[*place as usize] = item;
            *place += 1;
        }
    }
}

/// Key of a contact that belongs to no subdomain.
const INTERFACE: u32 = u32::MAX;

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
        let owner = &self.owner;
        self.grains.fill(subdomains, owner.iter().copied());
        let key = |&[candidate, antagonist]: &[u32; 2]| {
            let mine = owner[candidate as usize];
            match owner.get(antagonist as usize) {
                Some(&other) if other != mine => INTERFACE,
                _ => mine,
            }
        };
        let keys: Vec<u32> = contacts.bodies.par_iter().with_min_len(4096).map(key).collect();
        self.contacts.fill(subdomains, keys.iter().copied());
        let between = (0u32..)
            .zip(&contacts.bodies)
            .zip(&keys)
            .filter(|(_, key)| **key == INTERFACE)
            .map(|((c, &[a, b]), _)| (c, [owner[a as usize], owner[b as usize]]));
        self.interface.group(subdomains, between);
    }

    /// One set of all grains and contacts.
    pub fn whole(&mut self, grains: usize, contacts: &Contacts) {
        self.owner.clear();
        self.owner.resize(grains, 0);
        self.grains.fill(1, self.owner.iter().copied());
        self.contacts.fill(1, contacts.bodies.iter().map(|_| 0));
        self.interface.group(1, std::iter::empty());
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
