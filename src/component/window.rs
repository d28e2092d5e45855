//! The inputs of a window: what a caller says of its bodies, checked, and what that is for each step.

use super::Limits;
use super::load::LoadWaveform;
use super::memory::WindowMemory;
use super::refusal::Refusal;
use super::waveform::{Twist, Waveform, around};
use crate::drive::Load;
use crate::math::{Pose, rotation};
use crate::model::Model;
use crate::state::State;

/// The motion of one driven body, or of its mount, through a window.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionInput {
    /// The body's name.
    pub body: String,
    pub waveform: Waveform,
    /// The window need not join the one before: the body is moved there within the first step.
    pub allow_jump: bool,
}

impl MotionInput {
    /// The same motion with no more knots than the stretch from `t0_ns` to `t1_ns` depends on: there it is the same to
    /// the bit.
    pub fn cut(&self, t0_ns: u64, t1_ns: u64) -> Self {
        let Waveform { interpolation, knots } = &self.waveform;
        let knots = around(knots, |k| k.time_ns, t0_ns, t1_ns).to_vec();
        let waveform = Waveform { interpolation: *interpolation, knots };
        Self { body: self.body.clone(), waveform, allow_jump: self.allow_jump }
    }
}

/// The load on one mounted body through a window, besides its weight along directions that are loaded.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadInput {
    /// The body's name.
    pub body: String,
    pub waveform: LoadWaveform,
}

impl LoadInput {
    /// The same load with no more knots than the stretch from `t0_ns` to `t1_ns` depends on.
    pub fn cut(&self, t0_ns: u64, t1_ns: u64) -> Self {
        let LoadWaveform { is_held, knots } = &self.waveform;
        let knots = around(knots, |k| k.time_ns, t0_ns, t1_ns).to_vec();
        Self { body: self.body.clone(), waveform: LoadWaveform { is_held: *is_held, knots } }
    }
}

/// All inputs of a window. A body without motion stays where it is, or where its mount is; one without
/// load has none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WindowInputsRef<'a> {
    pub motions: &'a [MotionInput],
    pub loads: &'a [LoadInput],
}

impl<'a> From<&'a [MotionInput]> for WindowInputsRef<'a> {
    fn from(motions: &'a [MotionInput]) -> Self {
        Self { motions, loads: &[] }
    }
}

impl<'a, const N: usize> From<&'a [MotionInput; N]> for WindowInputsRef<'a> {
    fn from(motions: &'a [MotionInput; N]) -> Self {
        Self { motions, loads: &[] }
    }
}

/// The waveforms of a window by body.
pub(super) struct WindowPlan<'a> {
    /// `[nd]`.
    motions: Vec<Option<&'a Waveform>>,
    /// `[nm]`.
    loads: Vec<Option<&'a LoadWaveform>>,
}

impl<'a> WindowPlan<'a> {
    /// Checks the inputs of the window from `state` to `t1_ns`.
    pub fn check(
        model: &Model,
        state: &State,
        memory: &WindowMemory,
        limits: &Limits,
        t1_ns: u64,
        window: &WindowInputsRef<'a>,
    ) -> Result<Self, Refusal> {
        let join = ContinuityCheck { model, state, memory, limits };
        let mut motions = vec![None; model.driven.len()];
        for MotionInput { body, waveform, allow_jump } in window.motions {
            let d = find(model, body)?;
            if motions[d].is_some() {
                return Err(Refusal::input(body, "one waveform", "two"));
            }
            waveform.check(body, state.time_ns, t1_ns)?;
            if !allow_jump {
                join.check(d, waveform)?;
            }
            motions[d] = Some(waveform);
        }
        for d in (0..motions.len()).filter(|d| motions[*d].is_none()) {
            join.check_still(d)?;
        }
        let mut loads = vec![None; model.mounted_count()];
        for LoadInput { body, waveform } in window.loads {
            let d = find(model, body)?;
            let Some(load) = loads.get_mut(d) else {
                let found = "one whose motion is imposed";
                return Err(Refusal::input(body, "a body that loads can move", found));
            };
            if load.is_some() {
                return Err(Refusal::input(body, "one load", "two"));
            }
            waveform.check(body, state.time_ns, t1_ns)?;
            *load = Some(waveform);
        }
        Ok(Self { motions, loads })
    }

    /// Where each driven body, or its mount, is at the end of the step after `state` `[nd]`.
    pub fn targets(&self, model: &Model, state: &State) -> Vec<Pose> {
        let end = state.time_ns + model.stepping.step_ns;
        let target = |(d, waveform): (usize, &Option<&Waveform>)| {
            waveform.map_or_else(|| state.imposed(model, d), |w| w.pose(end))
        };
        self.motions.iter().enumerate().map(target).collect()
    }

    /// The loads of that step `[nm]`: those of its middle.
    pub fn loads(&self, model: &Model, state: &State) -> Vec<Load> {
        let middle = state.time_ns + model.stepping.step_ns / 2;
        self.loads.iter().map(|w| w.map_or_else(Load::zero, |w| w.load(middle))).collect()
    }

    /// In which twist each driven body, or its mount, is at a time: a cubic motion tells, and one without a motion
    /// stays `[nd]`.
    pub fn twists(&self, time_ns: u64) -> Vec<Option<Twist>> {
        let still = Some(Twist::default());
        self.motions.iter().map(|w| w.map_or(still, |w| w.twist(time_ns))).collect()
    }
}

fn find(model: &Model, body: &str) -> Result<usize, Refusal> {
    model.driven_index(body).ok_or_else(|| {
        let known = model.driven.iter().map(|d| d.name.clone()).collect();
        Refusal::UnknownBody { known, found: body.into() }
    })
}

/// Where a window has to begin.
struct ContinuityCheck<'a> {
    model: &'a Model,
    state: &'a State,
    memory: &'a WindowMemory,
    limits: &'a Limits,
}

impl ContinuityCheck<'_> {
    /// A body without input stays; one that has left the last window moving cannot.
    fn check_still(&self, d: usize) -> Result<(), Refusal> {
        let twist = self.memory.twist[d].unwrap_or_default();
        if twist.velocity.norm() <= self.limits.join_speed
            && twist.angular_velocity.norm() <= self.limits.join_angular_velocity
        {
            return Ok(());
        }
        Err(Refusal::Jump {
            body: self.model.driven[d].name.clone(),
            expected: "an input that goes on so, or a rebase: it left the last window moving"
                .into(),
            found: format!("none, at {}", twist.text()),
        })
    }

    /// Whether a waveform begins where its body, or the body's mount, is.
    fn check(&self, d: usize, waveform: &Waveform) -> Result<(), Refusal> {
        let (limits, now) = (self.limits, self.state.time_ns);
        let jump = |expected: String, found: String| {
            Err(Refusal::Jump { body: self.model.driven[d].name.clone(), expected, found })
        };
        let (is, starts) = (self.state.imposed(self.model, d), waveform.pose(now));
        let distance = (starts.position - is.position).norm();
        let angle = rotation::log(&(starts.orientation * is.orientation.inverse())).norm();
        if !(distance <= limits.join_distance && angle <= limits.join_angle) {
            let within = format!(
                "a start within {:.1e} m and {:.1e} rad of where it is",
                limits.join_distance, limits.join_angle
            );
            return jump(within, format!("{distance:.3e} m and {angle:.3e} rad away"));
        }
        let (Some(was), Some(becomes)) = (self.memory.twist[d], waveform.twist(now)) else {
            return Ok(());
        };
        let speed = (becomes.velocity - was.velocity).norm();
        let angular_velocity = (becomes.angular_velocity - was.angular_velocity).norm();
        if speed <= limits.join_speed && angular_velocity <= limits.join_angular_velocity {
            return Ok(());
        }
        jump(format!("{} as at the end of the last window", was.text()), becomes.text())
    }
}
