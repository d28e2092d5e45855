//! Couplings with a spring and with a served component, and the tamping unit of the example alone.

#[path = "../../../../tests/common/mod.rs"]
mod common;
#[allow(dead_code, reason = "its program uses the rest")]
#[path = "../../../../examples/machine/tamping_unit/model/mod.rs"]
mod model;

mod press;
mod schemes;
mod served;
mod spring_bed;
mod tamping_unit;
