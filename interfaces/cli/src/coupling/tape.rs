//! The recording of a run that others drive.
//!
//! Contract: what `ballast verify` computes from the case's bed on is what is recorded, see [`Redoable`]. Where
//! the run goes elsewhere (restore, reset) the file ends, and the next one begins: NAME.2.mcap, NAME.3.mcap.

use crate::case::Case;
use crate::exit::Outcome;
use ballast_mcap::{Drive, Meta, Redoable, Tape};
use ballast_protocol::lockstep::{Kind, Lockstep};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Status};
use std::path::{Path, PathBuf};

/// The open recording.
pub struct Recording {
    path: PathBuf,
    parts: u32,
    case: Case,
    windows: Redoable,
}

impl Recording {
    pub fn create(path: &Path, case: &Case, lockstep: &Lockstep) -> Outcome<Self> {
        let windows = start(path, case, lockstep)?;
        Ok(Self { path: path.into(), parts: 1, case: case.clone(), windows })
    }

    pub fn window(
        &mut self,
        lockstep: &Lockstep,
        kind: Kind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> Outcome {
        let component = lockstep.component();
        let (model, state) = (component.model(), component.save());
        self.windows.window(model, kind == Kind::Redo, request, reply, state)?;
        if matches!(reply.status, Status::Discard | Status::Error | Status::Fatal) {
            let text = format!("window {} taken back: {}", reply.seq, reply.message);
            self.windows.tape().log(component.now_ns(), &text)?;
        }
        Ok(())
    }

    /// The run goes on from another state.
    pub fn part(&mut self, lockstep: &Lockstep) -> Outcome {
        let model = lockstep.component().model();
        self.windows.settle(model)?;
        self.parts += 1;
        let path = self.path.with_extension(format!("{}.mcap", self.parts));
        let next = start(&path, &self.case, lockstep)?;
        Ok(std::mem::replace(&mut self.windows, next).finish(model)?)
    }

    pub fn finish(self, lockstep: &Lockstep) -> Outcome {
        Ok(self.windows.finish(lockstep.component().model())?)
    }
}

fn start(path: &Path, case: &Case, lockstep: &Lockstep) -> Outcome<Redoable> {
    let (model, state) = (lockstep.component().model(), lockstep.component().state());
    let names = [case.plan.name.clone(), case.bed_key()];
    let hash = ballast_hdf5::state_hash(model, state).into();
    let meta = Meta::of(names, case.choices.notes(), model, Drive::Inputs, hash);
    Ok(Redoable::new(Tape::create(path, &meta, model, state)?))
}
