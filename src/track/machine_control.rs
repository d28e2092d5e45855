//! Control of the tamping unit: how far it has been lowered, and how far each tine pair has closed.
//!
//! Reads: reactions of the tines. Writes: the [`TampingState`].
//! Contract: that of [`force_limited_progress`](super::force_limited_progress).
//!
//! A hydraulic machine has forces, not only positions: its unit stops going down while the bed
//! carries it, and each pair stops closing at its preset pressure, independently of the others.

use super::force_limited_progress::{ForceLimitedProgress, ProgressState};
use crate::error::{Error, Result};
use crate::model::Model;
use crate::observe::squeeze::{PairTines, side_force};
use crate::step::StepReport;
use crate::track::plan::{TampingPlan, TinePlan};

/// Maximum number of steps over which forces are averaged; beyond it the time step does not suit the frequency.
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

/// State of a tamping cycle; the default is that of a run that has not begun.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TampingState {
    lowering: ProgressState,
    /// Closing of each pair in order of its number `[pairs]`; empty before the first step.
    closing: Vec<ProgressState>,
}

impl TampingState {
    /// Returns the progress of pair `p`.
    fn pair(&self, p: usize) -> &ProgressState {
        const NOT_BEGUN: &ProgressState =
            &ProgressState { elapsed: 0.0, brake: 0.0, forces: Vec::new() };
        self.closing.get(p).unwrap_or(NOT_BEGUN)
    }
}

/// Controls of the machine: progress of the lowering, and of each pair's closing.
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
        // A unit that was held continues downwards until it is withdrawn.
        let down = insertion.duration + squeeze.duration + plan.hold;
        Ok(Self {
            pairs,
            lowering: clock(insertion.force_limit, insertion.duration, down),
            closing: clock(squeeze.force_limit, squeeze.duration, squeeze.duration),
        })
    }

    /// Returns the number of values of an encoded state.
    fn encoded_len(&self) -> usize {
        self.lowering.encoded_len() + self.pairs.len() * self.closing.encoded_len()
    }

    /// Returns the state as numbers: that of the lowering, then that of each pair in order of its number.
    pub fn encode(&self, state: &TampingState) -> Vec<f64> {
        let mut values = Vec::with_capacity(self.encoded_len());
        if !state.closing.is_empty() || !state.lowering.forces.is_empty() {
            state.lowering.encode(&mut values);
            state.closing.iter().for_each(|pair| pair.encode(&mut values));
        }
        values
    }

    /// Returns the state of such numbers; none is the state before the first step.
    pub fn decode(&self, values: &[f64]) -> Result<TampingState> {
        if values.is_empty() {
            return Ok(TampingState::default());
        }
        if values.len() != self.encoded_len() {
            return Err(Error::State {
                place: "driver state".into(),
                expected: format!("{} values, or none before the first step", self.encoded_len()),
                found: values.len().to_string(),
            });
        }
        let (lowering, closing) = values.split_at(self.lowering.encoded_len());
        Ok(TampingState {
            lowering: ProgressState::decode(lowering),
            closing: closing
                .chunks_exact(self.closing.encoded_len())
                .map(ProgressState::decode)
                .collect(),
        })
    }

    /// Returns how long the unit has been lowered, s.
    pub fn lowered(&self, state: &TampingState) -> f64 {
        state.lowering.elapsed
    }

    /// Returns how long the unit has been lowered after a step of `h` that ends `since_start` seconds after the
    /// beginning of the insertion.
    pub fn lowered_next(&self, state: &TampingState, since_start: f64, h: f64) -> f64 {
        self.lowering.advanced(&state.lowering, since_start, h).0
    }

    /// Returns how long pair `p` has closed, s.
    pub fn squeezed(&self, state: &TampingState, p: usize) -> f64 {
        state.pair(p).elapsed
    }

    /// Returns how long pair `p` has closed after a step of `h` that ends `since_start` seconds after the beginning of
    /// the squeeze.
    pub fn squeezed_next(&self, state: &TampingState, p: usize, since_start: f64, h: f64) -> f64 {
        self.closing.advanced(state.pair(p), since_start, h).0
    }

    /// Returns the mean force of pair `p` over the last vibration period, N.
    pub fn mean_force(&self, state: &TampingState, p: usize) -> f64 {
        self.closing.mean_force(state.pair(p))
    }

    /// Takes a step of `h` that ended at step number `step` into the state; `since` holds the seconds since the
    /// beginnings of insertion and squeeze.
    pub fn observe(
        &self,
        state: &mut TampingState,
        report: &StepReport,
        step: u64,
        since: [f64; 2],
        h: f64,
    ) {
        let force = self.vertical_force(report, h);
        self.lowering.observe(&mut state.lowering, force, step, since[0], h);
        state.closing.resize_with(self.pairs.len(), ProgressState::default);
        for (progress, pair) in state.closing.iter_mut().zip(&self.pairs) {
            self.closing.observe(progress, pair.force(report, h), step, since[1], h);
        }
    }

    /// Returns the vertical force of the bed on the unit, N per tine.
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
            let tines = of_pair.map(|t| Ok((driven_index(model, "tine", &t.name)?, t.direction)));
            Ok(TinePair { number, tines: tines.collect::<Result<_>>()? })
        })
        .collect()
}

/// Steps over which forces are averaged, at least one.
pub(super) fn period_steps(plan: &TampingPlan, model: &Model) -> f64 {
    (plan.averaging() / model.stepping.h()).round().max(1.0)
}

/// Index of the body called `name`, of this kind, among the driven bodies.
pub(super) fn driven_index(model: &Model, kind: &str, name: &str) -> Result<usize> {
    model.driven_index(name).ok_or_else(|| Error::Model {
        place: format!("{kind} {name:?}"),
        expected: "a driven body of this name".into(),
        found: "none".into(),
    })
}
