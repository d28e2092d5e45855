//! How far each tine pair has closed, and when its force limit stops it.
//!
//! Reads: reactions of the tines. Writes: the memory in [`State::drive`](crate::state::State::drive).
//! Contract: everything that later steps depend on is in that memory, so a restored run continues
//! bit for bit.
//!
//! Memory, for each pair in order of its number, `2 + window` entries:
//! * `[0]` squeezed time, s: the pair's own clock, which stands still while the pair is held;
//! * `[1]` brake, 0 (full rate) to 1 (held), so that a pair never stops nor starts with a jump;
//! * `[2..]` the force of each of the last `window` steps, N, at index `step % window`.

use crate::error::{Error, Result};
use crate::model::Model;
use crate::step::StepReport;
use crate::track::plan::{TampingPlan, TinePlan};

/// Entries of the memory before a pair's ring of forces.
const HEAD: usize = 2;
/// Longest window in steps; beyond this the time step and the frequency do not belong together.
const LONGEST_WINDOW: f64 = 1e5;

/// Tines that close together under one force limit.
#[derive(Debug, Clone, PartialEq)]
pub struct TinePair {
    /// Number in the plan.
    pub number: u32,
    /// Index among the driven bodies, and the direction it squeezes towards, +1 or -1 along x.
    pub tines: Vec<(usize, f64)>,
}

impl TinePair {
    /// The force with which one side of the pair closes, N, in a step of `h` seconds: the
    /// ballast's resistance along the closing, summed over the tines, over the number of sides.
    pub fn force(&self, report: &StepReport, h: f64) -> f64 {
        let side = |d: f64| f64::from(u8::from(self.tines.iter().any(|t| t.1 == d)));
        let resistance: f64 = self
            .tines
            .iter()
            .map(|&(body, direction)| -direction * report.reactions[body].impulse.x)
            .sum();
        resistance / (h * (side(1.0) + side(-1.0)))
    }
}

/// Asynchronous constant-pressure closing: each pair closes at its rate and waits while its mean
/// force over the last vibration period exceeds the limit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SqueezeControl {
    pub pairs: Vec<TinePair>,
    /// Steps in a vibration period.
    window: usize,
    force_limit: f64,
    /// Time in which a pair comes to a halt, s.
    braking: f64,
    duration: f64,
}

impl SqueezeControl {
    pub fn new(plan: &TampingPlan, tines: &[TinePlan], model: &Model) -> Result<Self> {
        let mut numbers: Vec<u32> = tines.iter().map(|t| t.pair).collect();
        numbers.sort_unstable();
        numbers.dedup();
        let pairs = numbers
            .into_iter()
            .map(|number| {
                let of_pair = tines.iter().filter(|t| t.pair == number);
                let tines = of_pair.map(|t| Ok((tine_index(model, &t.name)?, t.direction)));
                Ok(TinePair { number, tines: tines.collect::<Result<_>>()? })
            })
            .collect::<Result<_>>()?;
        // Without vibration there is no period; a tenth of the squeeze is a steady mean.
        let period = match plan.vibration.frequency {
            f if f > 0.0 => 1.0 / f,
            _ => 0.1 * plan.squeeze.duration,
        };
        let steps = (period / model.stepping.h()).round().max(1.0);
        if steps > LONGEST_WINDOW {
            return Err(Error::Model {
                place: "tamping.vibration.frequency".into(),
                expected: format!("a period of at most {LONGEST_WINDOW} time steps"),
                found: format!("{steps} steps"),
            });
        }
        Ok(Self {
            pairs,
            window: steps as usize,
            force_limit: plan.squeeze.force_limit,
            braking: period,
            duration: plan.squeeze.duration,
        })
    }

    fn stride(&self) -> usize {
        HEAD + self.window
    }

    /// Length of the memory.
    pub fn memory_len(&self) -> usize {
        self.pairs.len() * self.stride()
    }

    /// Squeezed time of pair `p`, s; a fresh run has an empty memory.
    pub fn squeezed(&self, memory: &[f64], p: usize) -> f64 {
        memory.get(p * self.stride()).copied().unwrap_or(0.0)
    }

    /// Mean force of pair `p` over the last vibration period, N.
    pub fn mean_force(&self, memory: &[f64], p: usize) -> f64 {
        let start = p * self.stride() + HEAD;
        let ring = memory.get(start..start + self.window).unwrap_or(&[]);
        ring.iter().sum::<f64>() / self.window as f64
    }

    /// Squeezed time and brake of pair `p` after a step of `h` that ends `since_start` seconds
    /// after the beginning of the squeeze.
    pub fn advanced(&self, memory: &[f64], p: usize, since_start: f64, h: f64) -> (f64, f64) {
        let squeezed = self.squeezed(memory, p);
        let brake = memory.get(p * self.stride() + 1).copied().unwrap_or(0.0);
        let within = since_start.min(h);
        if within <= 0.0 {
            return (squeezed, brake);
        }
        let over = since_start - within >= self.duration;
        let held = over || self.mean_force(memory, p) > self.force_limit;
        let change = h / self.braking;
        let brake = (brake + if held { change } else { -change }).clamp(0.0, 1.0);
        ((squeezed + within * (1.0 - brake)).min(self.duration), brake)
    }

    /// Takes a step that ended at step number `step` into the memory.
    pub fn observe(
        &self,
        memory: &mut Vec<f64>,
        report: &StepReport,
        step: u64,
        since_start: f64,
        h: f64,
    ) {
        memory.resize(self.memory_len(), 0.0);
        let slot = (step % self.window as u64) as usize;
        for (p, pair) in self.pairs.iter().enumerate() {
            let (squeezed, brake) = self.advanced(memory, p, since_start, h);
            let start = p * self.stride();
            memory[start] = squeezed;
            memory[start + 1] = brake;
            memory[start + HEAD + slot] = pair.force(report, h);
        }
    }
}

/// Index of the tine called `name` among the driven bodies.
pub(super) fn tine_index(model: &Model, name: &str) -> Result<usize> {
    model.driven_index(name).ok_or_else(|| Error::Model {
        place: format!("tine {name:?}"),
        expected: "a driven body of this name".into(),
        found: "none".into(),
    })
}
