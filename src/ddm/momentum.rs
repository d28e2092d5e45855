//! Iterations with momentum (T-37), over all sets: nonsmooth nonlinear conjugate gradients around the sweeps.
//!
//! Reads and writes: impulses and lines of the sets. Cost: per point five passes over the impulses that carry, and
//! half a sweep. Contract: sums go over the sets in their order, so bytes do not depend on the number of threads.

use super::Decomposition;
use super::carried::Carried;
use crate::nlgs::ContactSet;

/// Iterations between two points.
const PERIOD: u32 = 2;

/// Growth of the squared change above which what was learnt is forgotten. Changes that hardly grow are those of an
/// iteration that creeps, and momentum helps it most; without a bound, momentum leads away.
const BOUND: f64 = 1.2;

/// What a set remembers.
#[derive(Debug, Default)]
pub(super) struct Memory {
    carried: Carried,
    weight: Vec<f64>,
    /// Sum of the last changes, the older the less.
    direction: Vec<f64>,
    change_squared: f64,
}

impl Memory {
    fn begin(&mut self, contacts: &ContactSet) {
        self.carried.begin(contacts);
        self.weight.clear();
        self.weight.extend(self.carried.weights(contacts));
        self.direction.clear();
        self.direction.resize(self.weight.len(), 0.0);
    }

    fn observe(&mut self, contacts: &ContactSet) {
        self.carried.observe(contacts);
        let Carried { before, image, .. } = &self.carried;
        let changes = image.iter().zip(before).zip(&self.weight);
        self.change_squared = changes.map(|((g, r), w)| ((g - r) * w).powi(2)).sum();
    }

    /// Goes on from `r⁺ + β p`.
    fn go_on(&mut self, contacts: &mut ContactSet, share: f64) {
        let Carried { before, image, .. } = &mut self.carried;
        for ((x, r), p) in image.iter_mut().zip(before).zip(&mut self.direction) {
            let change = *x - *r;
            *x += share * *p;
            *p = share * *p + change;
        }
        self.carried.replace(contacts, &self.carried.image);
        self.carried.resume(contacts);
    }
}

/// Momentum of the iterations of a step.
#[derive(Debug)]
pub(super) struct Momentum {
    /// Iteration after which it began.
    began: Option<u32>,
    last: f64,
}

impl Momentum {
    pub fn new() -> Self {
        Self { began: None, last: f64::INFINITY }
    }

    /// Goes on to a further point after iteration `done`, if it is time for one. It begins with the first `test`,
    /// which says what carries.
    pub fn go_on(&mut self, decomposition: &mut Decomposition, done: u32, test: bool) {
        let Some(began) = self.began else {
            if test {
                self.began = Some(done);
                decomposition.on_sets(|set| set.momentum.begin(&set.contacts));
            }
            return;
        };
        if !(done - began).is_multiple_of(PERIOD) {
            return;
        }
        decomposition.on_sets(|set| set.momentum.observe(&set.contacts));
        let sets = 0..decomposition.sets();
        let change: f64 =
            sets.map(|s| decomposition.with_set(s, |set| set.momentum.change_squared)).sum();
        let growth = change / std::mem::replace(&mut self.last, change);
        // Not a number where nothing changes any more.
        if growth <= BOUND {
            let share = growth.min(1.0);
            decomposition.on_sets_in_turn(|set| set.momentum.go_on(&mut set.contacts, share));
        } else {
            decomposition.on_sets(|set| set.momentum.begin(&set.contacts));
        }
    }
}
