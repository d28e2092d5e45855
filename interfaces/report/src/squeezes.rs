//! Squeezes of a run, from its table of steps.
//!
//! Contract: meter and rule are those of the core, so a report agrees with replies to partners and recordings.

use ballast::model::Model;
use ballast::observe::{SqueezeMeter, SqueezeOutcome, TineStep};
use ballast::track;
use ballast::track::plan::Plan;
use ballast_session::record::{Column, StepRow, TrackedBody};
use std::sync::Arc;

/// Returns the squeezes of a run, including unfinished ones; none without tines.
pub fn squeezes(
    plan: &Plan,
    model: &Model,
    tracked: &[TrackedBody],
    rows: &[StepRow],
) -> ballast::Result<Vec<SqueezeOutcome>> {
    let mut meter = SqueezeMeter::new(Arc::new(track::squeezes(plan, model)?));
    let h = model.stepping.h();
    for row in rows {
        let time_ns = (row.get(Column::Time) * 1e9).round() as u64;
        meter.record_step(time_ns, h, |d| {
            let place = tracked.iter().position(|f| f.driven == d);
            place.map_or_else(TineStep::default, |i| TineStep {
                position: row.position(i)[0],
                impulse: row.force(i)[0] * h,
                work: row.work(i),
            })
        });
    }
    Ok(meter.take_outcomes())
}
