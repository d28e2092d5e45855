//! The squeezes of a run, from its table of steps.
//!
//! Contract: the meter and the rule are those of the core, so a report tells what partners and recordings are told.

use ballast::model::Model;
use ballast::observe::{SqueezeMeter, SqueezeOutcome, TineStep};
use ballast::track;
use ballast::track::plan::Plan;
use ballast_session::record::{Column, Followed, Row};
use std::sync::Arc;

/// The squeezes of a run, the last of each pair as far as it came; none without tines.
pub fn squeezes(
    plan: &Plan,
    model: &Model,
    followed: &[Followed],
    rows: &[Row],
) -> ballast::Result<Vec<SqueezeOutcome>> {
    let mut meter = SqueezeMeter::new(Arc::new(track::squeezes(plan, model)?));
    let h = model.stepping.h();
    for row in rows {
        let time_ns = (row.get(Column::Time) * 1e9).round() as u64;
        meter.follow(time_ns, h, |d| {
            let place = followed.iter().position(|f| f.driven == d);
            place.map_or_else(TineStep::default, |i| TineStep {
                place: row.place(i)[0],
                impulse: row.force(i)[0] * h,
                work: row.work(i),
            })
        });
    }
    Ok(meter.tell())
}
