//! The recording of a run while it goes.

use crate::entry::Entry;
use crate::error::{Error, Result};
use crate::meta::Meta;
use crate::window;
use crate::writer::Writer;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::Malformed;
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyInput, Log, Status, Time, ns};
use std::path::{Path, PathBuf};

/// A recording that windows are added to.
pub struct Tape {
    path: PathBuf,
    writer: Writer,
    run_id: String,
    /// Number of the last window.
    seq: u64,
}

impl Tape {
    /// Starts the recording of a run that begins at `state`.
    ///
    /// # Errors
    /// The system refuses.
    pub fn create(path: &Path, meta: &Meta, model: &Model, state: &State) -> Result<Self> {
        let writer = Writer::create(path, Some(meta))?;
        // Not fresh for every run: the same run leaves the same bytes.
        let run_id = meta.initial_hash.to_string();
        let mut tape = Self { path: path.into(), writer, run_id, seq: 0 };
        tape.write_all(window::configuration(model, state))?;
        Ok(tape)
    }

    /// The request of the window that comes next.
    pub fn request(&self, t0_ns: u64, t1_ns: u64, motions: Vec<BodyInput>) -> AdvanceRequest {
        AdvanceRequest {
            run_id: self.run_id.clone(),
            seq: self.seq + 1,
            t0_ns: ns(t0_ns),
            t1_ns: ns(t1_ns),
            motions,
            ..AdvanceRequest::default()
        }
    }

    /// A window as it can be computed again: up to where it ended, without a deadline, in the run of this recording.
    pub(crate) fn repeatable(
        &self,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> (AdvanceRequest, AdvanceReply) {
        let request = AdvanceRequest {
            run_id: self.run_id.clone(),
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
        (request, AdvanceReply { run_id: self.run_id.clone(), status, ..reply.clone() })
    }

    /// Adds a window that has led to `state`.
    ///
    /// # Errors
    /// The system refuses.
    pub fn window(
        &mut self,
        model: &Model,
        state: &State,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> Result<()> {
        self.seq = request.seq;
        self.write_all(window::entries(model, state, request, reply))
    }

    /// Adds a line to the log, at a time of the run (ns).
    ///
    /// # Errors
    /// The system refuses.
    pub fn log(&mut self, time_ns: u64, text: &str) -> Result<()> {
        let log = Log {
            stamp: Time::from_ns(time_ns),
            level: 20,
            name: "ballast".into(),
            msg: text.into(),
            ..Log::default()
        };
        self.write_all(Entry::of("/log", time_ns, &log).map(|entry| vec![entry]))
    }

    /// Adds other messages, such as pictures.
    ///
    /// # Errors
    /// The system refuses; messages that cannot be written.
    pub fn write_all(&mut self, entries: std::result::Result<Vec<Entry>, Malformed>) -> Result<()> {
        let entries = entries.map_err(|e| Error::Refused(e, self.path.clone()))?;
        entries.iter().try_for_each(|entry| self.writer.write(entry))
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(self) -> Result<()> {
        self.writer.finish()
    }
}
