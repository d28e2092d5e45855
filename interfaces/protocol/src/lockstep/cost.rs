//! Where the time of a window went. Wall time: in no reply and no recording, which are the same for the same inputs.

use ballast::step::{Phase, StepObserver};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Tells the wall time, ns.
pub type WallClock<'a> = &'a (dyn Fn() -> u64 + Sync);

/// Wall time of a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WindowTiming {
    pub seq: u64,
    /// Steps that were computed, kept or not.
    pub steps: u64,
    /// From the request to the reply, ms.
    pub wall_time_ms: f64,
    /// Of the phases of all steps, by name, ms; what lies between two steps counts with the first phase.
    pub phases_ms: BTreeMap<String, f64>,
}

/// A clock on a window.
pub(super) struct PhaseTimer<'a> {
    clock: WallClock<'a>,
    begin: u64,
    mark: u64,
    steps: u64,
    phases: [u64; Phase::ALL.len()],
}

impl<'a> PhaseTimer<'a> {
    pub fn begin(clock: WallClock<'a>) -> Self {
        let now = clock();
        Self { clock, begin: now, mark: now, steps: 0, phases: Default::default() }
    }

    /// The cost of the window, if it has steps.
    pub fn end(self, seq: u64) -> Option<WindowTiming> {
        let ms = |ns: u64| ns as f64 * 1e-6;
        let phases = Phase::ALL.iter().zip(self.phases);
        (self.steps > 0).then(|| WindowTiming {
            seq,
            steps: self.steps,
            wall_time_ms: ms((self.clock)().saturating_sub(self.begin)),
            phases_ms: phases.map(|(phase, ns)| (phase.name().into(), ms(ns))).collect(),
        })
    }
}

impl StepObserver for PhaseTimer<'_> {
    fn phase_finished(&mut self, phase: Phase) {
        let now = (self.clock)();
        self.phases[phase as usize] += now.saturating_sub(self.mark);
        self.steps += u64::from(phase == Phase::Store);
        self.mark = now;
    }
}
