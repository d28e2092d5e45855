//! How far the tamping unit has been lowered, and how far each tine pair has closed.
//!
//! Reads: reactions of the tines. Writes: the memory in [`State::drive`](crate::state::State::drive).
//! Contract: that of [`force_limited_progress`](super::force_limited_progress); the memory is that of the lowering, then
//! that of each pair's closing in order of its number.
//!
//! A hydraulic machine has forces, not only positions: its unit stops going down while the bed
//! carries it, and each pair stops closing at its preset pressure, independently of the others.

use super::force_limited_progress::ForceLimitedProgress;
use crate::error::{Error, Result};
use crate::model::Model;
use crate::observe::squeeze::{PairTines, side_force};
use crate::step::StepReport;
use crate::track::plan::{TampingPlan, TinePlan};

/// Longest window in steps; beyond this the time step and the frequency do not belong together.
pub const MAX_AVERAGING_STEPS: f64 = 1e5;

/// Tines that close together under one force limit.
#[derive(Debug, Clone, PartialEq)]
pub struct TinePair {
    /// Number in the plan.
    pub number: u32,
    /// Index among the driven bodies, and the direction it squeezes towards, +1 or -1 along x.
    pub tines: PairTines,
}

impl TinePair {
    /// The force with which one side of the pair closes, N, in a step of `h` seconds: the
    /// ballast's resistance along the closing, summed over the tines, over the number of sides.
    pub fn force(&self, report: &StepReport, h: f64) -> f64 {
        side_force(&self.tines, |d| report.reactions[d].impulse.x, h)
    }
}

/// The machine's clocks: one of the lowering, one of each pair's closing.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MachineControl {
    pub pairs: Vec<TinePair>,
    lowering: ForceLimitedProgress,
    closing: ForceLimitedProgress,
}

impl MachineControl {
    pub fn new(plan: &TampingPlan, tines: &[TinePlan], model: &Model) -> Result<Self> {
        let pairs = pairs(tines, model)?;
        let steps = period_steps(plan, model);
        if steps > MAX_AVERAGING_STEPS {
            return Err(Error::Model {
                place: "tamping".into(),
                expected: format!("forces averaged over {MAX_AVERAGING_STEPS} time steps at most"),
                found: format!(
                    "{steps} steps: a period, or without vibration a tenth of the squeeze"
                ),
            });
        }
        let clock = |force_limit: f64, duration: f64, open: f64| ForceLimitedProgress {
            window: steps as usize,
            force_limit,
            braking: plan.averaging(),
            duration,
            open,
        };
        let (insertion, squeeze) = (&plan.insertion, &plan.squeeze);
        // A unit that was held goes on down until it is withdrawn.
        let down = insertion.duration + squeeze.duration + plan.hold;
        Ok(Self {
            pairs,
            lowering: clock(insertion.force_limit, insertion.duration, down),
            closing: clock(squeeze.force_limit, squeeze.duration, squeeze.duration),
        })
    }

    /// Length of the memory.
    pub fn memory_len(&self) -> usize {
        self.lowering.memory_len() + self.pairs.len() * self.closing.memory_len()
    }

    fn of_lowering<'a>(&self, memory: &'a [f64]) -> &'a [f64] {
        memory.get(..self.lowering.memory_len()).unwrap_or(&[])
    }

    fn of_pair<'a>(&self, memory: &'a [f64], p: usize) -> &'a [f64] {
        let start = self.lowering.memory_len() + p * self.closing.memory_len();
        memory.get(start..start + self.closing.memory_len()).unwrap_or(&[])
    }

    /// For how long the unit has been lowered, s.
    pub fn lowered(&self, memory: &[f64]) -> f64 {
        self.lowering.elapsed(self.of_lowering(memory))
    }

    /// The same after a step of `h` that ends `since_start` seconds after the beginning of the
    /// insertion.
    pub fn lowered_next(&self, memory: &[f64], since_start: f64, h: f64) -> f64 {
        self.lowering.advanced(self.of_lowering(memory), since_start, h).0
    }

    /// For how long pair `p` has closed, s.
    pub fn squeezed(&self, memory: &[f64], p: usize) -> f64 {
        self.closing.elapsed(self.of_pair(memory, p))
    }

    /// The same after a step of `h` that ends `since_start` seconds after the beginning of the
    /// squeeze.
    pub fn squeezed_next(&self, memory: &[f64], p: usize, since_start: f64, h: f64) -> f64 {
        self.closing.advanced(self.of_pair(memory, p), since_start, h).0
    }

    /// Mean force of pair `p` over the last vibration period, N.
    pub fn mean_force(&self, memory: &[f64], p: usize) -> f64 {
        self.closing.mean_force(self.of_pair(memory, p))
    }

    /// Takes a step of `h` that ended at step number `step` into the memory; `since` holds the
    /// seconds since the beginnings of insertion and squeeze.
    pub fn observe(
        &self,
        memory: &mut Vec<f64>,
        report: &StepReport,
        step: u64,
        since: [f64; 2],
        h: f64,
    ) {
        memory.resize(self.memory_len(), 0.0);
        let (lowering, closing) = memory.split_at_mut(self.lowering.memory_len());
        self.lowering.observe(lowering, self.vertical_force(report, h), step, since[0], h);
        let each = closing.chunks_exact_mut(self.closing.memory_len());
        for (memory, pair) in each.zip(&self.pairs) {
            self.closing.observe(memory, pair.force(report, h), step, since[1], h);
        }
    }

    /// What the bed carries of the unit, N per tine.
    fn vertical_force(&self, report: &StepReport, h: f64) -> f64 {
        let tines = || self.pairs.iter().flat_map(|p| &p.tines);
        let carried: f64 = tines().map(|(body, _)| report.reactions[*body].impulse.z).sum();
        carried / (h * tines().count().max(1) as f64)
    }
}

/// The tines of a plan by their pairs, in order of the pairs' numbers.
pub(super) fn pairs(tines: &[TinePlan], model: &Model) -> Result<Vec<TinePair>> {
    let mut numbers: Vec<u32> = tines.iter().map(|t| t.pair).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
        .into_iter()
        .map(|number| {
            let of_pair = tines.iter().filter(|t| t.pair == number);
            let tines = of_pair.map(|t| Ok((tine_index(model, &t.name)?, t.direction)));
            Ok(TinePair { number, tines: tines.collect::<Result<_>>()? })
        })
        .collect()
}

/// Steps over which forces are averaged, at least one.
pub(super) fn period_steps(plan: &TampingPlan, model: &Model) -> f64 {
    (plan.averaging() / model.stepping.h()).round().max(1.0)
}

/// Index of the tine called `name` among the driven bodies.
pub(super) fn tine_index(model: &Model, name: &str) -> Result<usize> {
    model.driven_index(name).ok_or_else(|| Error::Model {
        place: format!("tine {name:?}"),
        expected: "a driven body of this name".into(),
        found: "none".into(),
    })
}
