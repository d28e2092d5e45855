//! The stepping component: windows of time, inputs as waveforms, redo, save and restore.
//!
//! Reads: a model, a state, inputs of each window. Writes: the state, a [`WindowResult`] per window.
//! Contract: same state and same inputs give the same result, bit for bit; the length of windows changes nothing. A
//! refused window leaves the state unchanged.
//!
//! Program, network, recordings and Python all advance this component.

mod driver;
mod limits;
mod load;
mod parameters;
mod probe;
mod refusal;
mod result;
mod session;
mod state_pool;
mod stepper;
mod tamping_driver;
mod waveform;
mod window;

pub use crate::cancel::StopReason;
pub use crate::step::{StepCallback, StepObserver};
pub use driver::{DrivenWindow, Driver, FunctionDriver};
pub use limits::Limits;
pub use load::{LoadKnot, LoadWaveform};
pub use parameters::Parameters;
pub use probe::{
    LoadCycle, ProbePoint, PushCurve, PushProbe, StiffnessCurve, StiffnessProbe, find_sleeper,
    sleepers,
};
pub use refusal::Refusal;
pub use result::{BodyResult, SolverResult, WindowResult, WindowStatus, ZoneResult, measure_zones};
pub use session::Session;
pub use stepper::Component;
pub use tamping_driver::TampingDriver;
pub use waveform::{Interpolation, Knot, MAX_KNOT_ROTATION, Twist, Waveform};
pub use window::{LoadInput, MotionInput, WindowInputs, WindowInputsRef};
