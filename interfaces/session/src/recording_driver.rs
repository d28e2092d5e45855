//! Recordings as drivers: the inputs of a replay, step by step.

use crate::{Failure, Result as Outcome};
use ballast::component::{Component, Parameters, WindowInputs, WindowInputsRef};
use ballast_mcap::Drive;
use ballast_mcap::messages::Truncation;
use ballast_mcap::motion::RecordedMotion;
use ballast_mcap::recording::WindowReader;
use std::path::{Path, PathBuf};

/// Driver that moves bodies as a recording says.
pub struct RecordingDriver {
    path: PathBuf,
    script: Script,
    /// True if the current inputs have not been checked as a whole.
    is_new: bool,
}

/// Content of a recording.
enum Script {
    /// Windows of a Ballast recording: the inputs that were given.
    Windows {
        windows: Box<WindowReader>,
        end_ns: u64,
        inputs: WindowInputs,
        /// Parameters that hold from the current window on, until they are set.
        parameters: Option<Parameters>,
    },
    /// Poses of any recording.
    Motion { motion: RecordedMotion, inputs: WindowInputs },
}

impl RecordingDriver {
    /// Builds the driver of the windows of a Ballast recording.
    pub fn from_windows(windows: WindowReader) -> Self {
        let path = windows.path().to_path_buf();
        let (windows, inputs) = (Box::new(windows), WindowInputs::default());
        let script = Script::Windows { windows, end_ns: 0, inputs, parameters: None };
        Self { path, script, is_new: false }
    }

    /// Builds the driver of recorded poses; with `allow_jump`, the bodies are moved to them from wherever they are.
    pub fn from_motion(path: &Path, mut motion: RecordedMotion, allow_jump: bool) -> Self {
        motion.inputs.iter_mut().for_each(|input| input.allow_jump = allow_jump);
        let inputs = WindowInputs { motions: motion.inputs.clone(), loads: Vec::new() };
        Self { path: path.into(), script: Script::Motion { motion, inputs }, is_new: true }
    }

    /// Returns the path of the recording.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns a failure with the path of the recording.
    pub fn failure(&self, what: impl std::fmt::Display) -> Failure {
        Failure::at(&self.path, what)
    }

    /// Returns true if the case's cycle moved the bodies when this was recorded.
    pub fn is_of_the_cycle(&self) -> bool {
        matches!(&self.script, Script::Windows { windows, .. } if windows.meta().drive == Drive::Case)
    }

    /// Returns the end of the recording, ns, if it is known beforehand.
    pub fn end_ns(&self) -> Option<u64> {
        match &self.script {
            Script::Windows { .. } => None,
            Script::Motion { motion, .. } => Some(motion.end_ns),
        }
    }

    /// Returns the end of the recording as its summary states it, ns; for the display of progress.
    pub fn stated_end_ns(&self) -> Option<u64> {
        match &self.script {
            Script::Windows { windows, .. } => windows.end_time_hint_ns(),
            Script::Motion { motion, .. } => Some(motion.end_ns),
        }
    }

    /// Returns why the recording ends early, if it does.
    pub fn lost(&self) -> Option<&Truncation> {
        match &self.script {
            Script::Windows { windows, .. } => windows.truncation(),
            Script::Motion { motion, .. } => motion.truncation.as_ref(),
        }
    }

    /// Refuses a recording that cannot move the bodies of `component` through the next step.
    ///
    /// # Errors
    /// A recording that ends before the step, or whose inputs are refused.
    pub fn check_first_step(&mut self, component: &Component) -> Outcome {
        let (t0_ns, stepping) = (component.now_ns(), &component.model().stepping);
        let t1_ns = t0_ns.saturating_add(stepping.step_ns);
        if !self.advance(t0_ns, t1_ns)? {
            return Err(self.too_short(t0_ns, stepping.h()));
        }
        self.check_new(component, t1_ns, self.advice())
    }

    /// Returns the inputs of the step of `component` that ends at `end_ns`; `None` at the end of the recording.
    ///
    /// # Errors
    /// A damaged recording, windows that do not follow each other, refused inputs.
    pub fn inputs(&mut self, component: &Component, end_ns: u64) -> Outcome<Option<WindowInputs>> {
        let now_ns = component.now_ns();
        if !self.advance(now_ns, end_ns)? {
            return Ok(None);
        }
        self.check_new(component, end_ns, "")?;
        // Only the knots around the step: a step costs the same, however long the inputs are.
        let WindowInputsRef { motions, loads } = self.current().into();
        Ok(Some(WindowInputs {
            motions: motions.iter().map(|input| input.cut(now_ns, end_ns)).collect(),
            loads: loads.iter().map(|load| load.cut(now_ns, end_ns)).collect(),
        }))
    }

    /// Returns the parameters that the recording sets before the current step, once.
    pub fn parameters(&mut self) -> Option<Parameters> {
        match &mut self.script {
            Script::Windows { parameters, .. } => parameters.take(),
            Script::Motion { .. } => None,
        }
    }

    /// Checks new inputs as a whole, once.
    fn check_new(&mut self, component: &Component, end_ns: u64, advice: &str) -> Outcome {
        if !std::mem::take(&mut self.is_new) {
            return Ok(());
        }
        let checked = component.check(end_ns, self.current());
        checked.map_err(|e| self.failure(format!("{e}{advice}")))
    }

    /// Returns the inputs of the current step and of others.
    fn current(&self) -> &WindowInputs {
        match &self.script {
            Script::Motion { inputs, .. } | Script::Windows { inputs, .. } => inputs,
        }
    }

    /// Advances to the step from `t0_ns` to `t1_ns`; returns false if there is none.
    fn advance(&mut self, t0_ns: u64, t1_ns: u64) -> Outcome<bool> {
        let Self { path, script, is_new } = self;
        let Script::Windows { windows, end_ns, inputs, parameters } = script else {
            return Ok(self.end_ns().is_some_and(|end| t1_ns <= end));
        };
        if *end_ns <= t0_ns {
            let Some(window) = windows.next()? else { return Ok(false) };
            let record = window.record;
            if u64::try_from(record.t0_ns) != Ok(t0_ns) {
                let what = format!(
                    "window {}: expected one from {t0_ns} ns on, found {} ns",
                    record.seq, record.t0_ns
                );
                return Err(Failure::at(path, what));
            }
            *parameters = window.parameters.map(Into::into);
            // The time up to which it was computed, not the requested one.
            *end_ns = u64::try_from(record.t1_ns).unwrap_or_default();
            let requested = record.request.inputs();
            let requested =
                requested.map_err(|e| Failure::at(path, format!("window {}: {e}", record.seq)))?;
            *inputs = WindowInputs { motions: requested.motions, loads: requested.loads };
            *is_new = true;
        }
        if t1_ns > *end_ns {
            let what = format!("expected a window of whole steps, found an end at {end_ns} ns");
            return Err(Failure::at(path, what));
        }
        Ok(true)
    }

    /// Returns the failure of a recording that is too short for a step.
    fn too_short(&self, now_ns: u64, h: f64) -> Failure {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let end =
            self.end_ns().map_or("none".into(), |end| format!("an end at {:.9} s", seconds(end)));
        let lost = self.lost().map_or(String::new(), |lost| format!("; {lost}"));
        let expected =
            format!("motions from {:.9} s on for a step of {h} s at least", seconds(now_ns));
        let is_still = matches!(&self.script, Script::Motion { motion, .. } if motion.start_ns == motion.end_ns);
        let advice = if is_still { "; a body needs two poses to move" } else { "" };
        self.failure(format!("expected {expected}, found {end}{lost}{advice}"))
    }

    /// Returns a hint for a refused first step.
    fn advice(&self) -> &'static str {
        match &self.script {
            Script::Windows { .. } => {
                "; in another case than its own `--map /BODY/pose=BODY` for each body, with --allow-jump, replays its poses"
            }
            Script::Motion { motion, .. } if motion.inputs.iter().any(|input| input.allow_jump) => {
                "; poses are taken in m, in the bed's frame (docs/src/guide/recordings.md)"
            }
            Script::Motion { .. } => {
                "; poses are taken in m, in the bed's frame (docs/src/guide/recordings.md); --allow-jump lets motions begin elsewhere"
            }
        }
    }
}
