//! Wall time of a window and of its phases.
//!
//! Wall times are in no reply and no recording, because these are the same for the same inputs.

use ballast::step::{Phase, StepObserver};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Function that returns the wall time, ns.
pub type WallClock<'a> = &'a (dyn Fn() -> u64 + Sync);

/// Wall time of a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WindowTiming {
    /// Number of the window.
    pub seq: u64,
    /// Number of computed steps, including steps that were rolled back.
    pub steps: u64,
    /// Wall time from request to reply, ms.
    pub wall_time_ms: f64,
    /// Wall time of each phase, summed over all steps, ms; the time between two steps counts as the first phase.
    pub phases_ms: BTreeMap<String, f64>,
}

/// Observer that measures the wall time of each phase of a window.
pub(super) struct PhaseTimer<'a> {
    clock: WallClock<'a>,
    start_ns: u64,
    /// Wall time at the end of the last phase, ns.
    phase_start_ns: u64,
    steps: u64,
    phases_ns: [u64; Phase::ALL.len()],
}

impl<'a> PhaseTimer<'a> {
    pub fn start(clock: WallClock<'a>) -> Self {
        let now = clock();
        Self { clock, start_ns: now, phase_start_ns: now, steps: 0, phases_ns: Default::default() }
    }

    /// Returns the wall time of window `seq`, or `None` without a computed step.
    pub fn finish(self, seq: u64) -> Option<WindowTiming> {
        let ms = |ns: u64| ns as f64 * 1e-6;
        let phases = Phase::ALL.iter().zip(self.phases_ns);
        (self.steps > 0).then(|| WindowTiming {
            seq,
            steps: self.steps,
            wall_time_ms: ms((self.clock)().saturating_sub(self.start_ns)),
            phases_ms: phases.map(|(phase, ns)| (phase.name().into(), ms(ns))).collect(),
        })
    }
}

impl StepObserver for PhaseTimer<'_> {
    fn phase_finished(&mut self, phase: Phase) {
        let now = (self.clock)();
        self.phases_ns[phase as usize] += now.saturating_sub(self.phase_start_ns);
        self.steps += u64::from(phase == Phase::Store);
        self.phase_start_ns = now;
    }
}
