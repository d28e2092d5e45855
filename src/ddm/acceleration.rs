//! Acceleration of iterations that do not get on (T-32), over all sets.
//!
//! Reads and writes: impulses and lines of the sets. Cost: per point two passes over ten vectors of
//! the impulses that carry, and half a sweep. Contract: sums go over the sets in their order, so bytes do not
//! depend on the number of threads.

use super::{Decomposition, next_after};
use crate::nlgs::acceleration::{Guard, History, Mixing, PERIOD, Products, Verdict};
use crate::nlgs::{Chosen, ContactSet};

/// What a set remembers. Contacts that were open at the beginning are left to the sweeps.
#[derive(Debug, Default)]
pub(super) struct Memory {
    chosen: Chosen,
    history: History,
    /// Impulses of the chosen contacts: where the iterations since the last point began, where they led, the next
    /// point, and those of least change.
    before: Vec<f64>,
    image: Vec<f64>,
    point: Vec<f64>,
    safe: Vec<f64>,
    products: Products,
}

impl Memory {
    fn begin(&mut self, contacts: &ContactSet) {
        contacts.choose_awake(&mut self.chosen);
        self.history.begin(contacts.chosen_weights(&self.chosen));
        self.resume(contacts);
        self.safe.clone_from(&self.before);
    }

    /// Takes the present impulses as those that the next iterations begin with.
    fn resume(&mut self, contacts: &ContactSet) {
        self.before.clear();
        self.before.extend(contacts.chosen_impulses(&self.chosen));
    }

    fn observe(&mut self, contacts: &ContactSet, slot: Option<usize>, remembered: usize) {
        self.image.clear();
        self.image.extend(contacts.chosen_impulses(&self.chosen));
        self.products = self.history.observe(slot, remembered, &self.before, &self.image);
    }

    fn retreat(&mut self, contacts: &mut ContactSet) {
        contacts.replace_impulses(&self.chosen, &self.safe);
    }
}

/// An acceleration in progress.
#[derive(Debug)]
pub(super) struct AndersonAcceleration {
    mixing: Mixing,
    guard: Guard,
    began: u32,
    /// Of the visits, and of those after the next failure: what one goes astray from, the other may get through.
    relaxations: [f64; 2],
}

impl AndersonAcceleration {
    /// Begins after iteration `done`.
    pub fn begin(decomposition: &mut Decomposition, done: u32, relaxations: [f64; 2]) -> Self {
        decomposition.on_sets(|set| set.memory.begin(&set.contacts));
        let guard = Guard::new(u64::from(done));
        Self { mixing: Mixing::default(), guard, began: done, relaxations }
    }

    /// Relaxation of the visits.
    pub fn relaxation(&self) -> f64 {
        self.relaxations[0]
    }

    /// The iteration after `done` that ends at a point.
    pub fn next_point(&self, done: u32) -> u32 {
        next_after(done, self.began, PERIOD)
    }

    /// Goes on to a better point after iteration `done`, if it is time for one.
    pub fn go_on(&mut self, decomposition: &mut Decomposition, done: u32) {
        if !(done - self.began).is_multiple_of(PERIOD) || done == self.began {
            return;
        }
        let (slot, remembered) = (self.mixing.slot(), self.mixing.remembered());
        decomposition.on_sets(|set| set.memory.observe(&set.contacts, slot, remembered));
        let products: Products = decomposition.sum(|set| set.memory.products);
        let shares = self.mixing.shares(&products);
        let verdict = self.guard.judge(products.change_squared.sqrt(), u64::from(done));
        if verdict == Verdict::Astray {
            self.retreat(decomposition);
            self.mixing.forget();
            self.relaxations.swap(0, 1);
            return decomposition.on_sets(|set| set.memory.begin(&set.contacts));
        }
        let rests = self.guard.rests(u64::from(done));
        decomposition.on_sets_in_turn(|set| {
            let memory = &mut set.memory;
            if verdict == Verdict::Best {
                memory.safe.clone_from(&memory.image);
            }
            if !rests {
                memory.history.combine(&shares, &mut memory.point);
                set.contacts.replace_impulses(&memory.chosen, &memory.point);
            }
            memory.resume(&set.contacts);
        });
    }

    /// Goes back to the impulses of the least change.
    pub fn retreat(&mut self, decomposition: &mut Decomposition) {
        decomposition.on_sets_in_turn(|set| set.memory.retreat(&mut set.contacts));
    }
}
