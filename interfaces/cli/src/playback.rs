//! The inputs of a replay, step by step, from a recording.

use crate::exit::{Failure, Outcome};
use ballast::component::{LoadInput, MotionInput, WindowInputsRef};
use ballast_mcap::Drive;
use ballast_mcap::messages::Lost;
use ballast_mcap::motion::Motion;
use ballast_mcap::recording::Windows;
use ballast_protocol::messages::{AdvanceInputs, SolverParameters};
use std::path::{Path, PathBuf};

/// A recording that moves bodies.
pub struct Playback {
    path: PathBuf,
    script: Script,
    /// Whether the inputs at hand have not been looked at as a whole.
    is_new: bool,
}

enum Script {
    /// Our own windows: the inputs that were given.
    Windows {
        windows: Box<Windows>,
        end_ns: u64,
        asked: AdvanceInputs,
        /// Set before the window at hand, and not asked for yet.
        parameters: Option<SolverParameters>,
    },
    /// Poses from any file.
    Motion(Motion),
}

impl Playback {
    /// The windows of a recording of ours.
    pub fn of_windows(windows: Windows) -> Self {
        let path = windows.path().to_path_buf();
        let windows = Box::new(windows);
        let (end_ns, asked, parameters) = (0, AdvanceInputs::default(), None);
        Self { path, script: Script::Windows { windows, end_ns, asked, parameters }, is_new: false }
    }

    /// Poses; with `rebase`, the bodies are moved to them from wherever they are.
    pub fn of_motion(path: &Path, mut motion: Motion, rebase: bool) -> Self {
        motion.inputs.iter_mut().for_each(|input| input.allow_jump = rebase);
        Self { path: path.into(), script: Script::Motion(motion), is_new: true }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the case's machine moved the bodies when this was recorded.
    pub fn is_of_the_machine(&self) -> bool {
        matches!(&self.script, Script::Windows { windows, .. } if windows.meta().drive == Drive::Case)
    }

    /// Where the recording ends, ns, if that is known beforehand.
    pub fn end_ns(&self) -> Option<u64> {
        match &self.script {
            Script::Windows { .. } => None,
            Script::Motion(motion) => Some(motion.end_ns),
        }
    }

    /// Where the recording says that it ends, ns: for those who wait.
    pub fn told_end_ns(&self) -> Option<u64> {
        match &self.script {
            Script::Windows { windows, .. } => windows.told_end_ns(),
            Script::Motion(motion) => Some(motion.end_ns),
        }
    }

    /// Why the recording ends early, if it does.
    pub fn lost(&self) -> Option<&Lost> {
        match &self.script {
            Script::Windows { windows, .. } => windows.lost(),
            Script::Motion(motion) => motion.lost.as_ref(),
        }
    }

    /// Why not a single step can be taken.
    pub fn too_short(&self, now_ns: u64, h: f64) -> Failure {
        let seconds = |ns: u64| ns as f64 * 1e-9;
        let end =
            self.end_ns().map_or("none".into(), |end| format!("an end at {:.9} s", seconds(end)));
        let lost = self.lost().map_or(String::new(), |lost| format!("; {lost}"));
        let expected =
            format!("motions from {:.9} s on for a step of {h} s at least", seconds(now_ns));
        Failure::at(&self.path, format!("expected {expected}, found {end}{lost}"))
    }

    /// What may help where the first step is refused.
    pub fn advice(&self) -> &'static str {
        match &self.script {
            Script::Windows { .. } => {
                "; in another case than its own `--map /BODY/pose=BODY` for each body, with --allow-jump, replays its poses"
            }
            Script::Motion(motion) if motion.inputs.iter().any(|input| input.allow_jump) => {
                "; poses are taken in m, in the bed's frame (docs/src/guide/recordings.md)"
            }
            Script::Motion(_) => {
                "; poses are taken in m, in the bed's frame (docs/src/guide/recordings.md); --allow-jump lets motions begin elsewhere"
            }
        }
    }

    /// Goes on to the step from `t0_ns` to `t1_ns`; whether there is one.
    pub fn reach(&mut self, t0_ns: u64, t1_ns: u64) -> Outcome<bool> {
        let Self { path, script, is_new } = self;
        match script {
            Script::Motion(motion) => Ok(t1_ns <= motion.end_ns),
            Script::Windows { windows, end_ns, asked, parameters } => {
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
                    *parameters = window.parameters;
                    // As far as it was computed, not as far as it was asked for.
                    *end_ns = u64::try_from(record.t1_ns).unwrap_or_default();
                    *asked = record
                        .request
                        .inputs()
                        .map_err(|e| Failure::at(path, format!("window {}: {e}", record.seq)))?;
                    *is_new = true;
                }
                if t1_ns > *end_ns {
                    let what =
                        format!("expected a window of whole steps, found an end at {end_ns} ns");
                    return Err(Failure::at(path, what));
                }
                Ok(true)
            }
        }
    }

    /// What the recording has set before the step at hand, once.
    pub fn parameters(&mut self) -> Option<SolverParameters> {
        match &mut self.script {
            Script::Windows { parameters, .. } => parameters.take(),
            Script::Motion(_) => None,
        }
    }

    /// Whether [`Self::inputs`] are others than when this was last asked.
    pub fn has_new_inputs(&mut self) -> bool {
        std::mem::take(&mut self.is_new)
    }

    /// Of the inputs what the step from `t0_ns` to `t1_ns` depends on: however long they are, a step costs the same.
    pub fn inputs_of(&self, t0_ns: u64, t1_ns: u64) -> (Vec<MotionInput>, Vec<LoadInput>) {
        let WindowInputsRef { motions, loads } = self.inputs();
        let motions = motions.iter().map(|input| input.cut(t0_ns, t1_ns)).collect();
        (motions, loads.iter().map(|load| load.cut(t0_ns, t1_ns)).collect())
    }

    /// The inputs at hand, of the step and of others.
    pub fn inputs(&self) -> WindowInputsRef<'_> {
        match &self.script {
            Script::Motion(motion) => WindowInputsRef::from(&motion.inputs[..]),
            Script::Windows { asked, .. } => {
                WindowInputsRef { motions: &asked.motions, loads: &asked.loads }
            }
        }
    }
}
