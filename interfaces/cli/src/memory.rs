//! What the machine of a case would remember of the steps of a recording of it: forces of the last vibration period, how
//! far it has lowered and closed.
//!
//! Contract: where the machine moved the bodies, a state completed by it is the machine's own, bit for bit.

use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::TampingCycle;
use ballast_mcap::verify::Keeper;
use ballast_protocol::messages::StateHash;
use std::borrow::Cow;

/// The memory of a machine that does not move the bodies itself.
pub struct Memory {
    pub cycle: TampingCycle,
    /// `None`: no machine moved the bodies.
    drive: Option<Vec<f64>>,
}

impl Memory {
    /// The memory at `state`; nothing is remembered unless the machine moved the bodies.
    pub fn new(cycle: &TampingCycle, state: &State, of_the_machine: bool) -> Self {
        Self { cycle: cycle.clone(), drive: of_the_machine.then(|| state.drive.clone()) }
    }

    /// The state with what is remembered.
    pub fn complete<'a>(&self, state: &'a State) -> Cow<'a, State> {
        match &self.drive {
            Some(drive) => Cow::Owned(State { drive: drive.clone(), ..state.clone() }),
            None => Cow::Borrowed(state),
        }
    }
}

impl Keeper for Memory {
    fn observe(&mut self, model: &Model, state: &State, report: &StepReport) {
        if let Some(drive) = &mut self.drive {
            self.cycle.observe(model, report, state, drive);
        }
    }

    fn hash(&self, model: &Model, state: &State) -> StateHash {
        ballast_hdf5::state_hash(model, &self.complete(state)).into()
    }
}
