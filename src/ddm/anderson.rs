//! Anderson acceleration of stagnating iterations (T-32) over all sets.
//!
//! Reads and writes: impulses and velocities of the sets. Cost: per mixing two passes over ten vectors of the active
//! impulses, and half a sweep. Contract: sums run over the sets in their order, so bytes do not depend on the number
//! of threads.

use super::decomposition::Decomposition;
use super::iteration::next_multiple;
use crate::nlgs::anderson::{
    AndersonMixing, HistoryProducts, MIXING_PERIOD, Safeguard, SafeguardVerdict,
};

/// Anderson acceleration in progress.
#[derive(Debug)]
pub(super) struct AndersonAcceleration {
    mixing: AndersonMixing,
    safeguard: Safeguard,
    /// Iteration after which the acceleration started.
    start: u32,
    /// Relaxation of the visits now, and after the next failure: one may converge where the other diverges.
    relaxations: [f64; 2],
}

impl AndersonAcceleration {
    /// Starts after iteration `done`.
    pub fn start(decomposition: &mut Decomposition, done: u32, relaxations: [f64; 2]) -> Self {
        decomposition.for_each_set(|set| set.anderson.start(&set.contacts));
        let safeguard = Safeguard::new(u64::from(done));
        Self { mixing: AndersonMixing::default(), safeguard, start: done, relaxations }
    }

    /// Relaxation factor of the visits.
    pub fn relaxation(&self) -> f64 {
        self.relaxations[0]
    }

    /// Returns the first iteration after `done` that ends with a mixing.
    pub fn next_mixing(&self, done: u32) -> u32 {
        next_multiple(done, self.start, MIXING_PERIOD)
    }

    /// Mixes the last impulses after iteration `done`, if a mixing is due.
    pub fn advance(&mut self, decomposition: &mut Decomposition, done: u32) {
        if !(done - self.start).is_multiple_of(MIXING_PERIOD) || done == self.start {
            return;
        }
        let slot = self.mixing.next_slot();
        let stored = self.mixing.stored();
        decomposition.for_each_set(|set| set.anderson.observe(&set.contacts, slot, stored));
        let products: HistoryProducts = decomposition.sum(|set| set.anderson.products);
        let coefficients = self.mixing.coefficients(&products);
        let verdict = self.safeguard.assess(products.change_squared.sqrt(), u64::from(done));
        if verdict == SafeguardVerdict::Diverging {
            self.restore(decomposition);
            self.mixing.reset();
            self.relaxations.swap(0, 1);
            return decomposition.for_each_set(|set| set.anderson.start(&set.contacts));
        }
        let is_cooling_down = self.safeguard.is_cooling_down(u64::from(done));
        decomposition.for_each_set_in_order(|set| {
            let memory = &mut set.anderson;
            if verdict == SafeguardVerdict::NewBest {
                memory.safe.clone_from(&memory.image);
            }
            if !is_cooling_down {
                memory.history.combine(&coefficients, &mut memory.mixed);
                set.contacts.replace_impulses(&memory.subset, &memory.mixed);
            }
            memory.resume(&set.contacts);
        });
    }

    /// Restores the impulses of least change.
    pub fn restore(&mut self, decomposition: &mut Decomposition) {
        decomposition.for_each_set_in_order(|set| set.anderson.restore(&mut set.contacts));
    }
}
