//! Time that runs by itself, on the computing thread.

use super::Service;
use crate::keys::chunk;
use ballast_protocol::lockstep::{Code, Fault, SetParameters, WindowKind};
use ballast_protocol::messages::{AdvanceRequest, BodyInput, Status};
use ballast_protocol::pacer::{Due, Pacer};
use std::time::Duration;

impl Service<'_> {
    /// What a request for parameters asks of time: a pacer of its own, if it is to run.
    pub(super) fn pacer(&self, ask: &SetParameters, ticket: &str) -> Result<Option<Pacer>, Fault> {
        let Some(Some(running)) = &ask.free_running else { return Ok(None) };
        self.check_stands()?;
        self.lockstep.check_ready(ticket)?;
        let component = self.lockstep.component();
        Pacer::new(running.clone(), component, self.shared.now_ns()).map(Some)
    }

    /// Refuses what cannot be done while time runs by itself.
    pub(super) fn check_stands(&self) -> Result<(), Fault> {
        if self.pacer.is_some() { Err(stop_first()) } else { Ok(()) }
    }

    /// Time runs by itself no more.
    pub(super) fn stop_running(&mut self, why: &str) {
        if self.pacer.take().is_some() {
            self.say(&format!("time runs by itself no more: {why}"));
        }
    }

    /// Does what is due while time runs by itself; how long nothing will be.
    pub(super) fn run_on(&mut self) -> Option<Duration> {
        let wall_ns = self.shared.now_ns();
        let (heard, unread) = self.inputs.take();
        let pacer = self.pacer.as_mut()?;
        pacer.drop_unread(unread);
        for (part, knot, at_ns) in heard {
            let body = pacer.bodies().iter().find(|body| chunk(body) == part).cloned();
            pacer.take(&body.unwrap_or(part), knot, at_ns);
        }
        match pacer.due(wall_ns) {
            Due::Window { t1_ns, motions } => {
                self.run_window(t1_ns, motions);
                Some(Duration::ZERO)
            }
            Due::At(at_ns) => {
                self.show();
                Some(Duration::from_nanos(at_ns.saturating_sub(wall_ns)))
            }
            Due::Starved => {
                self.show();
                Some(Duration::MAX)
            }
        }
    }

    fn run_window(&mut self, t1_ns: u64, motions: Vec<BodyInput>) {
        let place = self.lockstep.place();
        let bare = AdvanceRequest::of(place.run_id, place.seq + 1, [place.now_ns, t1_ns]);
        let request = AdvanceRequest { motions, ..bare };
        let ticket = self.lockstep.owner().ticket().unwrap_or_default().to_string();
        let before = self.lockstep.answered_count();
        let result = self.compute(WindowKind::Advance, &request, &ticket);
        self.tell(WindowKind::Advance, &request, &result, before);
        match result {
            Ok(reply) if matches!(reply.status, Status::Ok | Status::Warn) => {
                if let Some(pacer) = &mut self.pacer {
                    pacer.done(self.lockstep.component().now_ns());
                }
            }
            Ok(reply) => {
                let why = format!("window {}: {}: {}", reply.seq, reply.code, reply.message);
                self.stop_running(&why);
            }
            Err(fault) => self.stop_running(&fault.to_string()),
        }
        self.show();
    }
}

fn stop_first() -> Fault {
    let message = "time runs by itself; `param` with {\"free_running\": null} stops it";
    Fault::new(Code::FreeRunning, message)
}
