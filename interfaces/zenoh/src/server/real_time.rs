//! Real-time mode, on the computing thread.

use super::Service;
use crate::keys::key_segment;
use ballast_protocol::lockstep::{ErrorCode, ParameterUpdate, RequestError, WindowKind};
use ballast_protocol::messages::{AdvanceRequest, BodyMotion, ReplyStatus};
use ballast_protocol::pacer::{NextAction, Pacer};
use std::time::Duration;

impl Service<'_> {
    /// Creates the pacer of a request that starts the real-time mode.
    pub(super) fn new_pacer(
        &self,
        ask: &ParameterUpdate,
        ticket: &str,
    ) -> Result<Option<Pacer>, RequestError> {
        let Some(Some(running)) = &ask.real_time else { return Ok(None) };
        self.check_not_real_time()?;
        self.lockstep.check_ready(ticket)?;
        let component = self.lockstep.component();
        Pacer::new(running.clone(), component, self.shared.now_ns()).map(Some)
    }

    /// Returns an error while the real-time mode is active.
    pub(super) fn check_not_real_time(&self) -> Result<(), RequestError> {
        if self.pacer.is_some() { Err(real_time_active()) } else { Ok(()) }
    }

    /// Stops the real-time mode.
    pub(super) fn stop_real_time(&mut self, why: &str) {
        if self.pacer.take().is_some() {
            self.log(&format!("real-time mode stopped: {why}"));
        }
    }

    /// Performs the next action of the real-time mode and returns the time until the one after it.
    pub(super) fn advance_real_time(&mut self) -> Option<Duration> {
        let wall_ns = self.shared.now_ns();
        let (heard, unread) = self.inputs.take();
        let pacer = self.pacer.as_mut()?;
        pacer.count_unreadable(unread);
        for (part, knot, at_ns) in heard {
            let body = pacer.bodies().iter().find(|body| key_segment(body) == part).cloned();
            pacer.add_sample(&body.unwrap_or(part), knot, at_ns);
        }
        match pacer.next_action(wall_ns) {
            NextAction::Compute { t1_ns, motions } => {
                self.compute_real_time_window(t1_ns, motions);
                Some(Duration::ZERO)
            }
            NextAction::WaitUntil(at_ns) => {
                self.publish_status();
                Some(Duration::from_nanos(at_ns.saturating_sub(wall_ns)))
            }
            NextAction::WaitForSamples => {
                self.publish_status();
                Some(Duration::MAX)
            }
        }
    }

    fn compute_real_time_window(&mut self, t1_ns: u64, motions: Vec<BodyMotion>) {
        let place = self.lockstep.position();
        let empty = AdvanceRequest::of(place.run_id, place.seq + 1, [place.now_ns, t1_ns]);
        let request = AdvanceRequest { motions, ..empty };
        let ticket = self.lockstep.owner().ticket().unwrap_or_default().to_string();
        let before = self.lockstep.computed_windows();
        let result = self.compute(WindowKind::Advance, &request, &ticket);
        self.publish(WindowKind::Advance, &request, &result, before);
        match result {
            Ok(reply) if matches!(reply.status, ReplyStatus::Ok | ReplyStatus::Warn) => {
                if let Some(pacer) = &mut self.pacer {
                    pacer.window_finished(self.lockstep.component().now_ns());
                }
            }
            Ok(reply) => {
                let why = format!("window {}: {}: {}", reply.seq, reply.code, reply.message);
                self.stop_real_time(&why);
            }
            Err(fault) => self.stop_real_time(&fault.to_string()),
        }
        self.publish_status();
    }
}

fn real_time_active() -> RequestError {
    let message = "the real-time mode is active; stop it with `param` {\"real_time\": null}";
    RequestError::new(ErrorCode::RealTimeActive, message)
}
