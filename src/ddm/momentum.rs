//! Iterations with momentum (T-37), over all sets: nonsmooth nonlinear conjugate gradients around the sweeps.
//!
//! Reads and writes: impulses and lines of the sets. Cost: per point two passes over the blocks that carry, one of them
//! with what a visit reads and writes. Contract: sums go over the sets in their order, so bytes do not depend on the
//! number of threads.

use super::{Decomposition, next_after};
use crate::nlgs::block::{BlockMemory, Row64};
use crate::nlgs::{Chosen, ContactSet};

/// Iterations between two points.
const PERIOD: u32 = 2;

/// Growth of the squared change above which what was learnt is forgotten. Changes that hardly grow are those of an
/// iteration that creeps, and momentum helps it most; without a bound, momentum leads away.
const BOUND: f64 = 1.2;

/// What a set remembers. Contacts that were open at the beginning are left to the sweeps.
#[derive(Debug, Default)]
pub(super) struct Memory {
    chosen: Chosen,
    weights: Vec<Row64>,
    blocks: Vec<BlockMemory>,
    change_squared: f64,
}

impl Memory {
    /// Takes note of how far the sweeps have come since the last point.
    pub fn measure(&mut self, contacts: &ContactSet) {
        self.change_squared = contacts.change_squared(&self.chosen, &self.blocks);
    }

    /// Does what the next iterations begin with.
    pub fn start(&mut self, contacts: &mut ContactSet, start: Start) {
        match start {
            Start::Sweeps => {}
            Start::First => {
                self.weights.clear();
                self.weights.extend(contacts.weights());
                self.begin(contacts);
            }
            Start::Anew => self.begin(contacts),
            Start::GoOn(share) => contacts.go_on(&self.chosen, &mut self.blocks, share),
        }
    }

    /// Without momentum, from the present impulses.
    fn begin(&mut self, contacts: &ContactSet) {
        contacts.choose_awake(&mut self.chosen);
        contacts.set_out(&self.chosen, &self.weights, &mut self.blocks);
    }
}

/// What a set begins the next iterations with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Start {
    /// The momentum has nothing to do.
    Sweeps,
    /// It takes note of where it is, and of what stays the same in a step.
    First,
    /// It forgets what it has learnt, and takes note of where it is.
    Anew,
    /// A step in the direction of before, by this share of it, from where the sweeps have come to. A pass of its own:
    /// it changes velocities that other sets share.
    GoOn(f64),
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

    /// The iteration after `done` that ends at a point, if it has begun.
    pub fn next_point(&self, done: u32) -> Option<u32> {
        self.began.map(|began| next_after(done, began, PERIOD))
    }

    /// Whether iteration `done` ends at a point: its sets are to be measured after their sweeps.
    pub fn is_point(&self, done: u32) -> bool {
        self.began.is_some_and(|began| (done - began).is_multiple_of(PERIOD))
    }

    /// What all sets begin the next iterations with after iteration `done`. It begins with the first `test`, which says
    /// what carries.
    pub fn start(&mut self, sets: &Decomposition, done: u32, test: bool) -> Start {
        if self.began.is_none() && test {
            self.began = Some(done);
            return Start::First;
        }
        if !self.is_point(done) {
            return Start::Sweeps;
        }
        let change: f64 = sets.sum(|set| set.momentum.change_squared);
        let growth = change / std::mem::replace(&mut self.last, change);
        // Not a number where nothing changes any more.
        if growth <= BOUND { Start::GoOn(growth.min(1.0)) } else { Start::Anew }
    }
}
