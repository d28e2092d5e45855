//! The recording of a run that others drive.
//!
//! Contract: what `ballast verify` computes from the case's bed on is what is recorded: windows as they were
//! in the end. A redone window stands there once, one that a deadline has cut short as the shorter window
//! that it was, one that was taken back not at all. Where the run goes elsewhere (restore, reset) the file
//! ends, and the next one begins: NAME.2.mcap, NAME.3.mcap.

use crate::args::ScheduleName;
use crate::case::Case;
use crate::exit::Outcome;
use ballast::state::State;
use ballast_mcap::{Drive, Meta, Tape};
use ballast_protocol::lockstep::{Kind, Lockstep};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Status};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The open recording.
pub struct Recording {
    path: PathBuf,
    parts: u32,
    case: Case,
    tape: Tape,
    /// Recorded windows refer to the run by the hash of its start: the same run leaves the same bytes.
    run: String,
    /// The last window, which may still be redone, and the state that it has led to.
    last: Option<(AdvanceRequest, AdvanceReply, Arc<State>)>,
}

impl Recording {
    pub fn create(path: &Path, case: &Case, lockstep: &Lockstep) -> Outcome<Self> {
        let (tape, run) = start(path, case, lockstep)?;
        Ok(Self { path: path.into(), parts: 1, case: case.clone(), tape, run, last: None })
    }

    pub fn window(
        &mut self,
        lockstep: &Lockstep,
        kind: Kind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> Outcome {
        if kind == Kind::Advance {
            self.settle(lockstep)?;
        } else {
            self.last = None;
        }
        if matches!(reply.status, Status::Discard | Status::Error | Status::Fatal) {
            let text = format!("window {} taken back: {}", reply.seq, reply.message);
            self.tape.log(lockstep.component().now_ns(), &text)?;
            return Ok(());
        }
        let whole = AdvanceRequest {
            run_id: self.run.clone(),
            t1_ns: reply.t1_ns,
            deadline_ms: 0,
            deadline_policy: Default::default(),
            ..request.clone()
        };
        let status = match reply.status {
            Status::Early if reply.solver.steps_not_converged > 0 => Status::Warn,
            Status::Early => Status::Ok,
            other => other,
        };
        let reply = AdvanceReply { run_id: self.run.clone(), status, ..reply.clone() };
        self.last = Some((whole, reply, lockstep.component().save()));
        Ok(())
    }

    /// The run goes on from another state.
    pub fn part(&mut self, lockstep: &Lockstep) -> Outcome {
        self.settle(lockstep)?;
        self.parts += 1;
        let path = self.path.with_extension(format!("{}.mcap", self.parts));
        let (tape, run) = start(&path, &self.case, lockstep)?;
        std::mem::replace(&mut self.tape, tape).finish()?;
        self.run = run;
        Ok(())
    }

    /// Nothing changes the last window any more.
    fn settle(&mut self, lockstep: &Lockstep) -> Outcome {
        let Some((request, reply, state)) = self.last.take() else { return Ok(()) };
        Ok(self.tape.window(lockstep.component().model(), &state, &request, &reply)?)
    }

    pub fn finish(mut self, lockstep: &Lockstep) -> Outcome {
        self.settle(lockstep)?;
        Ok(self.tape.finish()?)
    }
}

fn start(path: &Path, case: &Case, lockstep: &Lockstep) -> Outcome<(Tape, String)> {
    let (model, state) = (lockstep.component().model(), lockstep.component().state());
    let initial_hash = ballast_hdf5::state_hash(model, state).into();
    let meta = Meta {
        program: concat!("ballast ", env!("CARGO_PKG_VERSION")).into(),
        case_name: case.plan.name.clone(),
        case_key: case.bed_key(),
        step_ns: model.stepping.step_ns,
        schedule: ScheduleName::from(model.solver.schedule).name(),
        drive: Drive::Inputs,
        choices: case.choices.notes(),
        initial_hash,
    };
    Ok((Tape::create(path, &meta, model, state)?, initial_hash.to_string()))
}
