//! Nonsmooth nonlinear conjugate gradients around the Gauss-Seidel sweeps (T-37).
//!
//! Reads and writes: impulses and velocities of the sets. Cost: per extrapolation two passes over the active blocks,
//! one of them with the memory traffic of a visit. Contract: sums run over the sets in their order, so bytes do not
//! depend on the number of threads.

use super::iteration::next_multiple;
use crate::nlgs::block::{NncgBlock, Row64};
use crate::nlgs::{BlockSubset, ContactSet};

/// Iterations between two extrapolations.
const PERIOD: u32 = 2;

/// Maximum growth of the squared change; above it the search direction is reset.
///
/// A change that hardly grows belongs to iterations that creep, which extrapolation helps most. Without a bound the
/// extrapolation diverges.
const MAX_GROWTH: f64 = 1.2;

/// NNCG data of one contact set. Contacts that were open at the start are left to the sweeps.
#[derive(Debug, Default)]
pub(super) struct NncgMemory {
    subset: BlockSubset,
    weights: Vec<Row64>,
    blocks: Vec<NncgBlock>,
    /// Squared weighted change of the impulses since the last extrapolation.
    pub change_squared: f64,
}

impl NncgMemory {
    /// Measures the change of the impulses since the last extrapolation.
    pub fn measure(&mut self, contacts: &ContactSet) {
        self.change_squared = contacts.change_squared(&self.subset, &self.blocks);
    }

    /// Applies `action` to the set before its next sweeps.
    pub fn apply(&mut self, contacts: &mut ContactSet, action: NncgAction) {
        match action {
            NncgAction::Idle => {}
            NncgAction::Init => {
                self.weights.clear();
                self.weights.extend(contacts.weights());
                self.restart(contacts);
            }
            NncgAction::Restart => self.restart(contacts),
            NncgAction::Extrapolate(beta) => {
                contacts.extrapolate(&self.subset, &mut self.blocks, beta);
            }
        }
    }

    fn restart(&mut self, contacts: &ContactSet) {
        contacts.copy_active_blocks(&mut self.subset);
        contacts.begin_nncg(&self.subset, &self.weights, &mut self.blocks);
    }
}

/// Action of the NNCG method (T-37) on every contact set before the next sweeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum NncgAction {
    /// Nothing: plain sweeps.
    Idle,
    /// Stores the current impulses and the constant weights of the step.
    Init,
    /// Resets the search direction to zero and stores the current impulses.
    Restart,
    /// Moves the impulses along the previous search direction by this factor β.
    ///
    /// Needs a separate pass, because it changes velocities that other sets share.
    Extrapolate(f64),
}

/// NNCG method over all sets of a step.
#[derive(Debug)]
pub(super) struct Nncg {
    /// Iteration after which the method was initialised.
    start: Option<u32>,
    last_change: f64,
}

impl Nncg {
    /// Creates the method, which starts with the first convergence test.
    pub fn new() -> Self {
        Self { start: None, last_change: f64::INFINITY }
    }

    /// Returns the first iteration after `done` that ends with an extrapolation, if the method has started.
    pub fn next_extrapolation(&self, done: u32) -> Option<u32> {
        self.start.map(|start| next_multiple(done, start, PERIOD))
    }

    /// Returns true if iteration `done` ends with an extrapolation, so that the sets are measured after their sweeps.
    pub fn extrapolates_after(&self, done: u32) -> bool {
        self.start.is_some_and(|start| (done - start).is_multiple_of(PERIOD))
    }

    /// Returns the action of all sets after iteration `done`; the first `test`, which finds the active contacts,
    /// starts the method. `change` sums the squared changes of the sets.
    pub fn action(&mut self, done: u32, test: bool, change: impl FnOnce() -> f64) -> NncgAction {
        if self.start.is_none() && test {
            self.start = Some(done);
            return NncgAction::Init;
        }
        if !self.extrapolates_after(done) {
            return NncgAction::Idle;
        }
        let change = change();
        let growth = change / std::mem::replace(&mut self.last_change, change);
        // The growth is NaN if nothing changes any more.
        if growth <= MAX_GROWTH {
            NncgAction::Extrapolate(growth.min(1.0))
        } else {
            NncgAction::Restart
        }
    }
}
