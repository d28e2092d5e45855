//! The recording of a session, in an MCAP file.

use crate::case::{self, Case};
use crate::console::Console;
use crate::engine::{Engine, Stepped};
use crate::exit::Outcome;
use ballast::component::{self, MotionInput};
use ballast::drive::SpeedLimit;
use ballast::math::Pose;
use ballast::model::{DrivenBody, Role, Schedule};
use ballast::observe::{SqueezeMeter, Zone};
use ballast::track::{self, TampingPhase};
use ballast_hdf5::checkpoint;
use ballast_mcap::{Drive, Meta, Tape, scene};
use ballast_protocol::messages::{
    AdvanceReply, BodyMotion, InterpolationMode, MotionKnot, Twist, ns,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Says so where what is recorded cannot be computed again to the same bytes.
pub fn warn_unless_repeatable(case: &Case, console: Console) {
    if case.plan.run.solver.schedule == Schedule::Asynchronous {
        console.warning("--record: steps are solved asynchronously: `ballast verify` cannot repeat the recording");
    }
}

/// An open recording.
pub struct Taping {
    path: PathBuf,
    tape: Tape,
    /// Phase of the last step.
    phase: TampingPhase,
    /// Whether there are pictures.
    frames: bool,
    recent: component::ReactionHistory,
    squeezes: SqueezeMeter,
    speed_limit: SpeedLimit,
}

impl Taping {
    /// Starts a recording of the session that `engine` begins.
    pub fn create(path: &Path, case: &Case, engine: &Engine) -> Outcome<Self> {
        let drive = match engine.playback() {
            Some(playback) if !playback.is_of_the_machine() => Drive::Inputs,
            _ => Drive::Case,
        };
        let (model, state) = (engine.model(), engine.state());
        let meta = Meta::of(
            case.identity(),
            case.overrides.to_notes(),
            model,
            drive,
            engine.hash().into(),
        );
        let tape = Tape::begin(path, &case.plan, &meta, model, state, || {
            let kept = case.checkpoint(model, &engine.whole_state(), BTreeMap::new());
            checkpoint::to_bytes(path, &kept)
        })?;
        let frames = case.plan.run.output_ns > 0;
        let rule = track::squeezes(&case.plan, model).map_err(|e| case::invalid(case, e))?;
        let (recent, squeezes) = component::remembered(state, model.driven.len(), &Arc::new(rule));
        let speed_limit = SpeedLimit::new(model);
        let (path, phase) = (path.to_owned(), engine.phase());
        let mut taping = Self { path, tape, phase, frames, recent, squeezes, speed_limit };
        taping
            .tape
            .log(state.time_ns, &format!("{}: {} grains", case.plan.name, model.grains.len()))?;
        if frames {
            taping.tape.write_all(scene::pictures(model, state, &[], true))?;
        }
        Ok(taping)
    }

    /// Records a step; `zones` are measured where an observation is due.
    pub fn step(&mut self, engine: &Engine, stepped: &Stepped, zones: Option<&[Zone]>) -> Outcome {
        let (model, state) = (engine.model(), engine.state());
        let [t0_ns, t1_ns] = [stepped.t0_ns, state.time_ns];
        // What a recording that is replayed gave the step; nothing where the machine of the case moves the bodies.
        let given = engine.playback().map(|playback| playback.inputs_of(t0_ns, t1_ns));
        let (given, loads) = given.unwrap_or_default();
        let mut request = self.tape.request(t0_ns, t1_ns, motions(engine, stepped, &given));
        request.loads = loads.iter().map(Into::into).collect();
        self.recent.take(&stepped.report.reactions, model.stepping.step_ns);
        self.squeezes.take(model, state, &stepped.report);
        let end = component::WindowEnd {
            model,
            state,
            zones: zones.unwrap_or_default(),
            recent: &self.recent,
            squeezes: self.squeezes.tell(),
            speed_limit: &self.speed_limit,
        };
        let outcome = component::WindowResult::of_step(&stepped.report, end);
        let reply = AdvanceReply::of(&request, model, &outcome, engine.hash().into());
        self.tape.window(model, state, &request, &reply)?;
        let phase = engine.phase();
        let changed = phase != self.phase;
        if changed {
            self.tape.log(state.time_ns, &format!("phase: {}", phase.name()))?;
            self.phase = phase;
        }
        // Polyhedra where a phase begins.
        if self.frames && (zones.is_some() || changed) {
            let forces: Vec<_> = outcome.bodies.iter().map(|b| b.moving_average_force).collect();
            self.tape.write_all(scene::pictures(model, state, &forces, changed))?;
        }
        Ok(())
    }

    /// Ends the recording; where it is.
    pub fn finish(self) -> Outcome<PathBuf> {
        self.tape.finish()?;
        Ok(self.path)
    }
}

/// The motions of a step as inputs: where a recording is replayed what was given, as it was; otherwise those of tines and
/// sleepers always, of other bodies where they move.
fn motions(engine: &Engine, stepped: &Stepped, given: &[MotionInput]) -> Vec<BodyMotion> {
    let times = [stepped.t0_ns, engine.state().time_ns];
    let input = |body: &DrivenBody, poses: &[Pose; 2]| {
        if let Some(input) = given.iter().find(|input| input.body == body.name) {
            return Some(input.into());
        }
        // What was given no motion is remembered to be at rest; a motion that stands still says less of the next window.
        if engine.playback().is_some() {
            return None;
        }
        let knot = |i: usize| MotionKnot {
            time_ns: ns(times[i]),
            pose: poses[i].into(),
            twist: Twist::default(),
        };
        (body.role != Role::Boundary || poses[0] != poses[1]).then(|| BodyMotion {
            body: body.name.clone(),
            interpolation: InterpolationMode::Linear,
            allow_jump: false,
            knots: vec![knot(0), knot(1)],
        })
    };
    let bodies = engine.model().driven.iter().zip(&stepped.imposed);
    bodies.filter_map(|(body, poses)| input(body, poses)).collect()
}
