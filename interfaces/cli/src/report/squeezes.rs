//! The squeezes of a run, from its table of steps.
//!
//! Contract: rule and meter are those of the core, fed with what the table says of each step; so a squeeze is what
//! the tines did, whoever moved them.

use crate::record::{Column, Followed, Row};
use ballast::math::{Pose, Vec3};
use ballast::model::Model;
use ballast::observe::{SqueezeMeter, SqueezeOutcome};
use ballast::state::State;
use ballast::step::{Reaction, StepReport};
use ballast::track;
use ballast::track::plan::Plan;

/// The squeezes in the order in which they ended; none without tines.
pub fn squeezes(
    plan: &Plan,
    model: &Model,
    followed: &[Followed],
    rows: &[Row],
) -> ballast::Result<Vec<SqueezeOutcome>> {
    let mut meter = SqueezeMeter::new(track::squeezes(plan, model)?.into());
    // The meter looks at the driven bodies alone.
    let mut state = State::default();
    (0..model.body_count()).for_each(|_| state.push(Pose::identity()));
    let h = model.stepping.h();
    for row in rows {
        let mut reactions = vec![Reaction::default(); model.driven.len()];
        for (i, body) in followed.iter().enumerate() {
            state.position[model.grains.len() + body.driven] = row.place(i).into();
            reactions[body.driven] = Reaction {
                impulse: Vec3::from(row.force(i)) * h,
                work: row.work(i),
                ..Reaction::default()
            };
        }
        state.time_ns = (row.get(Column::Time) * 1e9).round() as u64;
        meter.take(model, &state, &StepReport { reactions, ..StepReport::default() });
    }
    Ok(meter.tell())
}
