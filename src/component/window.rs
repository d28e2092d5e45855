//! Inputs of a window: motions and loads of bodies, checked, and evaluated for each step.

use super::limits::Limits;
use super::load::LoadWaveform;
use super::refusal::Refusal;
use super::waveform::{Twist, Waveform, around};
use crate::drive::Load;
use crate::math::{Pose, rotation};
use crate::model::Model;
use crate::state::State;

/// Motion of one driven body, or of its mount, through a window.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionInput {
    /// The body's name.
    pub body: String,
    /// Motion as a function of time.
    pub waveform: Waveform,
    /// True if the motion need not continue the window before: the body is moved to it within the first step.
    pub allow_jump: bool,
}

impl MotionInput {
    /// Returns the motion with the knots that the interval from `t0_ns` to `t1_ns` depends on; there it is equal to the
    /// bit.
    pub fn cut(&self, t0_ns: u64, t1_ns: u64) -> Self {
        let Waveform { interpolation, knots } = &self.waveform;
        let knots = around(knots, |k| k.time_ns, t0_ns, t1_ns).to_vec();
        let waveform = Waveform { interpolation: *interpolation, knots };
        Self { body: self.body.clone(), waveform, allow_jump: self.allow_jump }
    }
}

/// Load on one mounted body through a window, besides its weight along free directions.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadInput {
    /// The body's name.
    pub body: String,
    /// Load as a function of time.
    pub waveform: LoadWaveform,
}

impl LoadInput {
    /// Returns the load with the knots that the interval from `t0_ns` to `t1_ns` depends on.
    pub fn cut(&self, t0_ns: u64, t1_ns: u64) -> Self {
        let LoadWaveform { is_held, knots } = &self.waveform;
        let knots = around(knots, |k| k.time_ns, t0_ns, t1_ns).to_vec();
        Self { body: self.body.clone(), waveform: LoadWaveform { is_held: *is_held, knots } }
    }
}

/// Inputs of a window, as a driver gives them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WindowInputs {
    /// Motions of driven bodies, or of their mounts.
    pub motions: Vec<MotionInput>,
    /// Loads on mounted bodies.
    pub loads: Vec<LoadInput>,
}

impl<'a> From<&'a WindowInputs> for WindowInputsRef<'a> {
    fn from(inputs: &'a WindowInputs) -> Self {
        Self { motions: &inputs.motions, loads: &inputs.loads }
    }
}

/// Borrowed inputs of a window. A body without motion stays where it is, or where its mount is; one without
/// load has none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WindowInputsRef<'a> {
    /// Motions of driven bodies, or of their mounts.
    pub motions: &'a [MotionInput],
    /// Loads on mounted bodies.
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

/// Waveforms of a window by body.
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
        limits: &Limits,
        t1_ns: u64,
        window: &WindowInputsRef<'a>,
    ) -> Result<Self, Refusal> {
        let join = ContinuityCheck { model, state, limits };
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

    /// Returns the pose of each driven body, or of its mount, at the end of the step after `state` `[nd]`.
    pub fn targets(&self, model: &Model, state: &State) -> Vec<Pose> {
        let end = state.time_ns + model.stepping.step_ns;
        let target = |(d, waveform): (usize, &Option<&Waveform>)| {
            waveform.map_or_else(|| state.imposed(model, d), |w| w.pose(end))
        };
        self.motions.iter().enumerate().map(target).collect()
    }

    /// Returns the loads in the middle of the step after `state` `[nm]`.
    pub fn loads(&self, model: &Model, state: &State) -> Vec<Load> {
        let middle = state.time_ns + model.stepping.step_ns / 2;
        self.loads.iter().map(|w| w.map_or_else(Load::zero, |w| w.load(middle))).collect()
    }

    /// Returns the twist of each driven body, or of its mount, at a time `[nd]`: that of a cubic motion, zero without a
    /// motion, unknown otherwise.
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

/// Check that the inputs of a window continue the window before.
struct ContinuityCheck<'a> {
    model: &'a Model,
    state: &'a State,
    limits: &'a Limits,
}

impl ContinuityCheck<'_> {
    /// Refuses a body without motion that moved at the end of the last window.
    fn check_still(&self, d: usize) -> Result<(), Refusal> {
        let twist = self.state.end_twist(d).unwrap_or_default();
        if twist.velocity.norm() <= self.limits.join_speed
            && twist.angular_velocity.norm() <= self.limits.join_angular_velocity
        {
            return Ok(());
        }
        Err(Refusal::Jump {
            body: self.model.driven[d].name.clone(),
            expected: "a motion that continues it, or one with allow_jump: it moved at the end of the last window"
                .into(),
            found: format!("none, at {}", twist.text()),
        })
    }

    /// Refuses a waveform that does not begin at its body, or at the body's mount.
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
        let (Some(was), Some(becomes)) = (self.state.end_twist(d), waveform.twist(now)) else {
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
