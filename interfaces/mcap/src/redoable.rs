//! The recording of windows that may be redone.

use crate::error::Result;
use crate::scene;
use crate::tape::Tape;
use ballast::math::Vec3;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use std::sync::Arc;

/// Polyhedra, which are many times larger, stand beside every so many pictures of points.
const POINTS_PER_SCENE: u64 = 10;

/// A recording whose last window waits until nothing changes it any more.
///
/// Contract: what stands in it is what is computed from its beginning on: windows as they were in the end. A
/// redone window stands there once, one that was cut short as the shorter window that it was, one that was
/// taken back not at all. One that is dropped ends as a finished one does, but for what goes wrong.
pub struct Redoable {
    /// There until it is finished.
    tape: Option<Tape>,
    /// A fork of it has the same file, and is not to write in it.
    process: u32,
    /// The last window, and the state that it has led to.
    last: Option<Last>,
    /// Between pictures, ns; 0: there are none.
    picture_ns: u64,
    /// Of points, so far.
    pictures: u64,
}

/// A window: what was asked and answered, the model that it was computed with, the state that it has led to.
struct Last {
    request: AdvanceRequest,
    reply: AdvanceReply,
    model: Arc<Model>,
    state: Arc<State>,
}

impl Redoable {
    /// A recording of windows on a tape that begins at `state`, with pictures `picture_ns` of simulated time apart;
    /// 0: without.
    ///
    /// # Errors
    /// The system refuses.
    pub fn new(tape: Tape, picture_ns: u64, model: &Model, state: &State) -> Result<Self> {
        let (tape, process) = (Some(tape), std::process::id());
        let mut recording = Self { tape, process, last: None, picture_ns, pictures: 0 };
        if picture_ns > 0 {
            recording.picture(model, state, &[])?;
        }
        Ok(recording)
    }

    fn picture(&mut self, model: &Model, state: &State, forces: &[Vec3]) -> Result<()> {
        let whole = self.pictures.is_multiple_of(POINTS_PER_SCENE);
        self.pictures += 1;
        self.tape().write_all(scene::pictures(model, state, forces, whole))
    }

    pub fn tape(&mut self) -> &mut Tape {
        self.tape.as_mut().expect("finishing takes the recording itself")
    }

    /// Whether this process began it, and not one that it was forked from.
    pub fn is_of_this_process(&self) -> bool {
        self.process == std::process::id()
    }

    /// Takes a window of `model` that has led to `state`; a redo takes the place of the last one.
    ///
    /// # Errors
    /// The system refuses.
    pub fn window(
        &mut self,
        model: Arc<Model>,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
        state: Arc<State>,
    ) -> Result<()> {
        if kind == WindowKind::Advance {
            self.settle()?;
        }
        self.last = reply.status.is_kept().then(|| {
            let (request, reply) = self.tape().repeatable(request, reply);
            Last { request, reply, model, state }
        });
        Ok(())
    }

    /// Writes the last window: nothing changes it any more.
    ///
    /// # Errors
    /// The system refuses.
    pub fn settle(&mut self) -> Result<()> {
        let Some(Last { request, reply, model, state }) = self.last.take() else { return Ok(()) };
        self.tape().window(&model, &state, &request, &reply)?;
        let frame = |time_ns: i64| u64::try_from(time_ns).ok()?.checked_div(self.picture_ns);
        if frame(reply.t1_ns) > frame(reply.t0_ns) {
            let forces: Vec<Vec3> =
                reply.bodies.iter().map(|body| body.moving_average.force.into()).collect();
            self.picture(&model, &state, &forces)?;
        }
        Ok(())
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(mut self) -> Result<()> {
        self.settle()?;
        self.end()
    }

    fn end(&mut self) -> Result<()> {
        self.tape.take().map_or(Ok(()), Tape::finish)
    }
}

/// A recording that is let go: its last window is as good as the others.
impl Drop for Redoable {
    fn drop(&mut self) {
        if self.is_of_this_process() {
            // Nobody is left to tell.
            let _ = self.settle().and_then(|()| self.end());
        } else {
            // What is dropped writes the file's end.
            std::mem::forget(self.tape.take());
        }
    }
}
