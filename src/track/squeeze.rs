//! Squeeze rule of a plan: its tine pairs, and the period over which their motion is averaged.
//!
//! Reads: the plan, the model that holds its tines. Writes: nothing.

use super::machine_control::{pairs, period_steps};
use crate::error::Result;
use crate::model::Model;
use crate::observe::{SqueezePair, SqueezeRule};
use crate::track::plan::{Plan, TampingPlan};

/// Averaging period of a case without vibration, s: about that of 35 Hz, the frequency of tamping machines.
const DEFAULT_PERIOD: f64 = 0.028;

/// The tine pairs of a plan, `pair_0` and so on by their numbers; whoever moves them, their squeezes are followed.
///
/// # Errors
/// Tines that the model does not have.
pub fn squeezes(plan: &Plan, model: &Model) -> Result<SqueezeRule> {
    let vibrates = |tamping: &&TampingPlan| tamping.vibration.period().is_some();
    let steps = match plan.tamping.as_ref().filter(vibrates) {
        Some(tamping) => period_steps(tamping, model),
        None => (DEFAULT_PERIOD / model.stepping.h()).round().max(1.0),
    };
    let named = |pair: super::TinePair| SqueezePair {
        name: format!("pair_{}", pair.number),
        tines: pair.tines,
    };
    SqueezeRule::new(pairs(&plan.tines, model)?.into_iter().map(named).collect(), steps as u32)
}
