//! Time that runs by itself, on the computing thread.

use super::Service;
use crate::keys::chunk;
use ballast_protocol::lockstep::{ErrorCode, ParameterUpdate, RequestError, WindowKind};
use ballast_protocol::messages::{AdvanceRequest, BodyMotion, ReplyStatus};
use ballast_protocol::pacer::{NextAction, Pacer};
use std::time::Duration;

impl Service<'_> {
    /// What a request for parameters asks of time: a pacer of its own, if it is to run.
    pub(super) fn pacer(
        &self,
        ask: &ParameterUpdate,
        ticket: &str,
    ) -> Result<Option<Pacer>, RequestError> {
        let Some(Some(running)) = &ask.real_time else { return Ok(None) };
        self.check_stands()?;
        self.lockstep.check_ready(ticket)?;
        let component = self.lockstep.component();
        Pacer::new(running.clone(), component, self.shared.now_ns()).map(Some)
    }

    /// Refuses what cannot be done while time runs by itself.
    pub(super) fn check_stands(&self) -> Result<(), RequestError> {
        if self.pacer.is_some() { Err(stop_first()) } else { Ok(()) }
    }

    /// Time runs by itself no more.
    pub(super) fn stop_real_time(&mut self, why: &str) {
        if self.pacer.take().is_some() {
            self.say(&format!("time runs by itself no more: {why}"));
        }
    }

    /// Does what is due while time runs by itself; how long nothing will be.
    pub(super) fn run_on(&mut self) -> Option<Duration> {
        let wall_ns = self.shared.now_ns();
        let (heard, unread) = self.inputs.take();
        let pacer = self.pacer.as_mut()?;
        pacer.count_unreadable(unread);
        for (part, knot, at_ns) in heard {
            let body = pacer.bodies().iter().find(|body| chunk(body) == part).cloned();
            pacer.take(&body.unwrap_or(part), knot, at_ns);
        }
        match pacer.due(wall_ns) {
            NextAction::Compute { t1_ns, motions } => {
                self.run_window(t1_ns, motions);
                Some(Duration::ZERO)
            }
            NextAction::WaitUntil(at_ns) => {
                self.show();
                Some(Duration::from_nanos(at_ns.saturating_sub(wall_ns)))
            }
            NextAction::WaitForSamples => {
                self.show();
                Some(Duration::MAX)
            }
        }
    }

    fn run_window(&mut self, t1_ns: u64, motions: Vec<BodyMotion>) {
        let place = self.lockstep.position();
        let bare = AdvanceRequest::of(place.run_id, place.seq + 1, [place.now_ns, t1_ns]);
        let request = AdvanceRequest { motions, ..bare };
        let ticket = self.lockstep.owner().ticket().unwrap_or_default().to_string();
        let before = self.lockstep.computed_windows();
        let result = self.compute(WindowKind::Advance, &request, &ticket);
        self.tell(WindowKind::Advance, &request, &result, before);
        match result {
            Ok(reply) if matches!(reply.status, ReplyStatus::Ok | ReplyStatus::Warn) => {
                if let Some(pacer) = &mut self.pacer {
                    pacer.done(self.lockstep.component().now_ns());
                }
            }
            Ok(reply) => {
                let why = format!("window {}: {}: {}", reply.seq, reply.code, reply.message);
                self.stop_real_time(&why);
            }
            Err(fault) => self.stop_real_time(&fault.to_string()),
        }
        self.show();
    }
}

fn stop_first() -> RequestError {
    let message = "time runs by itself; `param` with {\"real_time\": null} stops it";
    RequestError::new(ErrorCode::RealTimeActive, message)
}
