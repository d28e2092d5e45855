//! The stepping component: windows of time, inputs as waveforms, redo, save and restore.
//!
//! Reads: a model, a state, inputs of each window. Writes: the state, an [`Outcome`] per window.
//! Contract: a window is a function. Same state, same inputs: same outcome, bit for bit; how a stretch
//! of time is cut into windows changes nothing. A refused window leaves the state as it was.
//!
//! Every face of the program (library, network, recordings, Python) is to drive this one thing.

mod outcome;
mod refusal;
mod waveform;

pub use outcome::{BodyOutcome, Outcome, SolverOutcome, Status};
pub use refusal::Refusal;
pub use waveform::{Interpolation, Knot, Waveform};

use crate::drive::Inputs;
use crate::error::Error;
use crate::math::{Pose, rotation};
use crate::model::{Model, Part};
use crate::state::State;
use crate::step::{StepReport, Stopwatch, step};
use crate::workspace::Workspace;
use outcome::Account;
use std::ops::ControlFlow;
use std::sync::Arc;
use waveform::Twist;

/// The motion of one driven body, or of its mount, through a window.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// The body's name.
    pub body: String,
    pub waveform: Waveform,
    /// The window need not join the one before: the body is moved there within the first step.
    pub rebase: bool,
}

/// What to do when a window cannot be computed to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OnTrouble {
    /// Give back the state at its beginning.
    #[default]
    Discard,
    /// Keep what was computed before the trouble.
    Early,
}

/// What a component accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How far apart two windows may be where they join: m, rad, m/s, rad/s.
    pub join_distance: f64,
    pub join_angle: f64,
    pub join_speed: f64,
    pub join_spin: f64,
    /// Deepest penetration of a sound step, m; infinite: any.
    pub penetration: f64,
    pub on_trouble: OnTrouble,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            join_distance: 1e-6,
            join_angle: 1e-6,
            join_speed: 1e-3,
            join_spin: 1e-3,
            penetration: f64::INFINITY,
            on_trouble: OnTrouble::Discard,
        }
    }
}

/// Everything that the next window depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    pub state: State,
    /// With what velocity and spin each driven body left the last window, where it said so `[nd]`.
    twist: Vec<Option<Twist>>,
}

impl Snapshot {
    /// A snapshot of a state that comes from elsewhere: how its bodies move is not known.
    pub fn of(state: State) -> Self {
        Self { state, twist: Vec::new() }
    }
}

/// A model that is stepped in windows.
#[derive(Debug)]
pub struct Component {
    model: Arc<Model>,
    limits: Limits,
    now: Snapshot,
    /// The beginning of the last window, and its end, ns.
    last: Option<(Snapshot, u64)>,
    workspace: Workspace,
    /// Largest distance of a point of each driven body from its reference point `[nd]`, m.
    reach: Vec<f64>,
    /// Farthest that a point of a driven body may move in a step, m.
    farthest: f64,
}

impl Component {
    /// A component at `state`.
    ///
    /// # Errors
    /// A model or a state that cannot be stepped.
    pub fn new(model: Arc<Model>, state: State, limits: Limits) -> Result<Self, Refusal> {
        model.check()?;
        state.check(&model)?;
        let reach = model.driven.iter().map(|d| reach(&model, &d.parts)).collect();
        // Half of the smallest grain: a faster tool would pass through grains unseen.
        let diameter = |s: &u32| model.shapes[*s as usize].nominal_diameter();
        let farthest = 0.5 * model.grains.shape.iter().map(diameter).fold(f64::INFINITY, f64::min);
        let mut now = Snapshot::of(state);
        now.twist.resize(model.driven.len(), None);
        Ok(Self {
            model,
            limits,
            now,
            last: None,
            workspace: Workspace::default(),
            reach,
            farthest,
        })
    }

    pub fn model(&self) -> &Model {
        &self.model
    }

    pub fn state(&self) -> &State {
        &self.now.state
    }

    /// Contacts of the last step, and what observables read.
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// Simulated time, ns.
    pub fn now_ns(&self) -> u64 {
        self.now.state.time_ns
    }

    /// Advances to `t1_ns`. A body without input stays where it is.
    ///
    /// # Errors
    /// What is wrong with the request; the state is as before. What goes wrong while computing is told
    /// by the outcome's status.
    pub fn advance_to(&mut self, t1_ns: u64, inputs: &[Input]) -> Result<Outcome, Refusal> {
        self.advance_watched(t1_ns, inputs, &mut |_, _| ControlFlow::Continue(()))
    }

    /// The same; `watch` sees every step and may end the window after it.
    pub fn advance_watched(
        &mut self,
        t1_ns: u64,
        inputs: &[Input],
        watch: &mut dyn FnMut(&State, &StepReport) -> ControlFlow<()>,
    ) -> Result<Outcome, Refusal> {
        self.advance_timed(t1_ns, inputs, watch, &mut ())
    }

    /// The same, with the caller's stopwatch on the phases of the steps.
    pub fn advance_timed(
        &mut self,
        t1_ns: u64,
        inputs: &[Input],
        watch: &mut dyn FnMut(&State, &StepReport) -> ControlFlow<()>,
        stopwatch: &mut impl Stopwatch,
    ) -> Result<Outcome, Refusal> {
        let steps = self.steps_to(t1_ns)?;
        let drive = self.drive(t1_ns, inputs)?;
        let before = self.now.clone();
        let mut account = Account::new(&self.model, before.state.time_ns);
        let mut trouble = None;
        let mut stopped = false;
        for _ in 0..steps {
            match self.one_step(&drive, stopwatch) {
                Ok(report) => {
                    account.take(&report, &self.now.state, self.model.stepping.h());
                    if watch(&self.now.state, &report).is_break() {
                        stopped = self.now_ns() < t1_ns;
                        break;
                    }
                }
                Err(error) => {
                    trouble = Some(error);
                    break;
                }
            }
        }
        let discarded = trouble.is_some()
            && (self.limits.on_trouble == OnTrouble::Discard || account.steps() == 0);
        if discarded {
            self.now = before;
            return Ok(Account::new(&self.model, self.now_ns()).close(
                Status::Discard,
                trouble,
                &self.now.state,
            ));
        }
        for (d, waveform) in drive.iter().enumerate() {
            self.now.twist[d] = waveform.and_then(|w| w.twist(self.now_ns()));
        }
        self.last = Some((before, t1_ns));
        let status = match (&trouble, stopped, account.is_sound()) {
            (Some(_), ..) | (None, true, _) => Status::Early,
            (None, false, true) => Status::Ok,
            (None, false, false) => Status::Warn,
        };
        Ok(account.close(status, trouble, &self.now.state))
    }

    /// Computes the last window again from its beginning, with other inputs.
    ///
    /// # Errors
    /// There is no window to redo, or as for [`Component::advance_to`]; the state is as before.
    pub fn redo(&mut self, inputs: &[Input]) -> Result<Outcome, Refusal> {
        let (before, t1) = self.last.clone().ok_or(Refusal::NothingToRedo)?;
        let after = std::mem::replace(&mut self.now, before);
        let result = self.advance_to(t1, inputs);
        if result.is_err() {
            self.now = after;
        }
        result
    }

    /// What [`Component::restore`] needs to go on from here.
    pub fn save(&self) -> Snapshot {
        self.now.clone()
    }

    /// Goes back, or on, to a snapshot of the same model.
    ///
    /// # Errors
    /// A snapshot that does not fit the model; the state is as before.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), Refusal> {
        snapshot.state.check(&self.model)?;
        self.now = snapshot.clone();
        self.now.twist.resize(self.model.driven.len(), None);
        self.last = None;
        Ok(())
    }

    /// Another component that goes on from here on its own.
    pub fn fork(&self) -> Self {
        Self {
            model: Arc::clone(&self.model),
            limits: self.limits,
            now: self.now.clone(),
            last: self.last.clone(),
            workspace: Workspace::default(),
            reach: self.reach.clone(),
            farthest: self.farthest,
        }
    }

    /// Number of steps to a time on the grid.
    fn steps_to(&self, t1_ns: u64) -> Result<u64, Refusal> {
        let (now, step) = (self.now_ns(), self.model.stepping.step_ns);
        let ahead = t1_ns.saturating_sub(now);
        if ahead > 0 && ahead % step == 0 {
            return Ok(ahead / step);
        }
        let below = now.saturating_add((ahead / step).max(1) * step);
        Err(Refusal::Time {
            now_ns: now,
            step_ns: step,
            nearest_ns: [below, below.saturating_add(step)],
            found_ns: t1_ns,
        })
    }

    /// The waveform of each driven body `[nd]`, all checked.
    fn drive<'a>(
        &self,
        t1_ns: u64,
        inputs: &'a [Input],
    ) -> Result<Vec<Option<&'a Waveform>>, Refusal> {
        let mut drive = vec![None; self.model.driven.len()];
        for Input { body, waveform, rebase } in inputs {
            let Some(d) = self.model.driven_index(body) else {
                let known = self.model.driven.iter().map(|d| d.name.clone()).collect();
                return Err(Refusal::UnknownBody { known, found: body.clone() });
            };
            if drive[d].is_some() {
                return Err(Refusal::input(body, "one waveform", "two"));
            }
            waveform.check(body, self.now_ns(), t1_ns)?;
            if !rebase {
                self.check_join(d, waveform)?;
            }
            drive[d] = Some(waveform);
        }
        for (d, input) in drive.iter().enumerate() {
            if input.is_none() {
                self.check_still(d)?;
            }
        }
        Ok(drive)
    }

    /// A body without input stays; one that has left the last window moving cannot.
    fn check_still(&self, d: usize) -> Result<(), Refusal> {
        let twist = self.now.twist.get(d).copied().flatten().unwrap_or_default();
        if twist.velocity.norm() <= self.limits.join_speed
            && twist.spin.norm() <= self.limits.join_spin
        {
            return Ok(());
        }
        Err(Refusal::Jump {
            body: self.model.driven[d].name.clone(),
            expected: "an input: it left the last window moving".into(),
            found: format!("none, at {}", twist.text()),
        })
    }

    /// Whether a waveform begins where its body, or the body's mount, is.
    fn check_join(&self, d: usize, waveform: &Waveform) -> Result<(), Refusal> {
        let (limits, now) = (&self.limits, self.now_ns());
        let jump = |expected: String, found: String| {
            Err(Refusal::Jump { body: self.model.driven[d].name.clone(), expected, found })
        };
        let (is, starts) = (self.now.state.imposed(&self.model, d), waveform.pose(now));
        let distance = (starts.position - is.position).norm();
        let angle = rotation::log(&(starts.orientation * is.orientation.inverse())).norm();
        if !(distance <= limits.join_distance && angle <= limits.join_angle) {
            let within = format!(
                "a start within {:.1e} m and {:.1e} rad of where it is",
                limits.join_distance, limits.join_angle
            );
            return jump(within, format!("{distance:.3e} m and {angle:.3e} rad away"));
        }
        let twists = (self.now.twist.get(d).copied().flatten(), waveform.twist(now));
        let (Some(was), Some(becomes)) = twists else { return Ok(()) };
        let speed = (becomes.velocity - was.velocity).norm();
        let spin = (becomes.spin - was.spin).norm();
        if speed <= limits.join_speed && spin <= limits.join_spin {
            return Ok(());
        }
        jump(format!("{} as at the end of the last window", was.text()), becomes.text())
    }

    /// One step along the waveforms.
    fn one_step(
        &mut self,
        drive: &[Option<&Waveform>],
        stopwatch: &mut impl Stopwatch,
    ) -> Result<StepReport, Error> {
        let end = self.now_ns() + self.model.stepping.step_ns;
        let imposed = |d: usize| self.now.state.imposed(&self.model, d);
        let targets: Vec<Pose> = drive
            .iter()
            .enumerate()
            .map(|(d, waveform)| waveform.map_or_else(|| imposed(d), |w| w.pose(end)))
            .collect();
        for (d, target) in targets.iter().enumerate() {
            let from = imposed(d);
            let turn = rotation::log(&(target.orientation * from.orientation.inverse())).norm();
            let way = (target.position - from.position).norm() + turn * self.reach[d];
            if way > self.farthest {
                return Err(Error::Step {
                    time_s: self.now.state.time(),
                    place: format!("{:?}", self.model.driven[d].name),
                    expected: format!(
                        "at most {:.3e} m in a step, half of the smallest grain",
                        self.farthest
                    ),
                    found: format!("{way:.3e} m"),
                });
            }
        }
        // A step is refused before it changes anything, or taken: so penetration is judged on a copy.
        let before = self.limits.penetration.is_finite().then(|| self.now.state.clone());
        let inputs = Inputs { targets: &targets };
        let report =
            step(&self.model, &mut self.now.state, &inputs, &mut self.workspace, stopwatch)?;
        if let Some(before) = before.filter(|_| report.max_penetration > self.limits.penetration) {
            let time_s = before.time();
            self.now.state = before;
            return Err(Error::Step {
                time_s,
                place: "penetration".into(),
                expected: format!("at most {:.3e} m", self.limits.penetration),
                found: format!("{:.3e} m", report.max_penetration),
            });
        }
        Ok(report)
    }
}

/// Largest distance of a point of a body's convex parts from its origin, m.
fn reach(model: &Model, parts: &[Part]) -> f64 {
    let corners = parts.iter().flat_map(|part| match part {
        Part::Convex { shape, pose } => {
            let vertices = &model.shapes[*shape as usize].vertices;
            vertices.iter().map(|v| pose.point(v).norm()).collect::<Vec<_>>()
        }
        Part::HalfSpace { .. } => Vec::new(),
    });
    corners.fold(0.0, f64::max)
}
