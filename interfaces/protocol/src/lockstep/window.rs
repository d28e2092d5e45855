//! Windows: sequence check, computation, and the stored reply.

use super::timing::{PhaseTimer, WallClock};
use super::{ErrorCode, Lockstep, RequestError, WindowKind, WindowProgress, panic_message};
use crate::messages::{
    AdvanceReply, AdvanceRequest, DeadlinePolicy, Digest, MAX_SERIES_ENTRIES, ReplyStatus,
    StepSeries, core_ns, ns,
};
use ballast::component::{StopReason, WindowInputsRef, WindowResult};
use ballast::state::State;
use ballast::step::{Phase, StepObserver, StepReport};
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};

const NS_PER_MS: u64 = 1_000_000;

/// Callback polled between the steps of a window and during long steps, from any worker thread.
///
/// `Break` means that the client no longer waits: the window is rolled back as if it had not been requested.
pub type WindowPoll<'a> = &'a mut (dyn FnMut(&WindowProgress) -> ControlFlow<()> + Send);

impl Lockstep {
    /// Computes the next window, or the last one again; `clock` returns the wall time, ns, and decides on the deadline.
    ///
    /// Problems during the computation are part of the reply, not errors.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::WrongRun`], [`ErrorCode::OutOfSequence`], [`ErrorCode::NothingToRedo`], [`ErrorCode::ErrorState`],
    /// [`ErrorCode::ShuttingDown`], [`ErrorCode::Cancelled`] if `poll` cancels the window, and the errors of
    /// [`advance_to`](ballast::component::Component::advance_to).
    pub fn window(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        ticket: &str,
        clock: WallClock,
        poll: WindowPoll,
    ) -> Result<AdvanceReply, RequestError> {
        self.check_owner(ticket)?;
        if request.run_id != self.run_id {
            return Err(self.wrong_run(&request.run_id));
        }
        let content = request.digest()?;
        let is_last = request.seq == self.seq;
        // A redo after a change of parameters is not a retry.
        let is_known = kind == WindowKind::Advance || !self.is_outdated;
        if let Some((known, reply)) = &self.answered
            && is_last
            && is_known
            && *known == content
        {
            return Ok(reply.clone());
        }
        self.check_operational()?;
        if kind == WindowKind::Redo && self.answered.is_none() {
            let expected = "a window since the run was taken up";
            let fault = RequestError::expected(ErrorCode::NothingToRedo, "seq", expected, "none");
            let (seq, now_ns) = (Some(self.seq), Some(self.component.now_ns()));
            return Err(RequestError { expected_seq: seq, now_ns, ..fault });
        }
        let in_order = match kind {
            WindowKind::Advance => {
                Some(request.seq) == self.seq.checked_add(1)
                    && u64::try_from(request.t0_ns) == Ok(self.component.now_ns())
            }
            WindowKind::Redo => is_last && self.is_last_window(request),
        };
        if !in_order {
            return Err(self.out_of_sequence(kind, request));
        }
        if kind == WindowKind::Advance && is_placeholder(request) {
            self.idle_since_ms = clock() / NS_PER_MS;
            return self.skip(request, content);
        }
        self.check_series(request)?;
        let before = self.component.save();
        let start_ns = clock();
        let allowed_ns = NS_PER_MS * u64::from(request.deadline_ms);
        let mut monitor = WindowMonitor {
            progress: WindowProgress {
                seq: request.seq,
                steps: self.steps(request),
                ..WindowProgress::default()
            },
            deadline_policy: request.deadline_policy,
            start_ns,
            deadline_ns: (allowed_ns > 0).then(|| start_ns.saturating_add(allowed_ns)),
            clock,
            poll,
            timer: PhaseTimer::start(clock),
            series: request.record_steps.then(|| StepSeries::new(self.component.model())),
        };
        let result = self.compute(kind, request, &mut monitor);
        let WindowMonitor { timer, series, .. } = monitor;
        // A refused window has no timing.
        self.last_timing = timer.finish(request.seq).or(self.last_timing.take());
        self.idle_since_ms = clock() / NS_PER_MS;
        let reply = match result {
            Ok(outcome) => {
                let outcome = outcome?;
                self.update_hash();
                let model = self.component.model();
                let mut reply = AdvanceReply::of(request, model, &outcome, self.state_hash);
                if outcome.error.is_none()
                    && matches!(reply.status, ReplyStatus::Early | ReplyStatus::Discard)
                {
                    (reply.code, reply.message) = self.deadline_message(request, outcome.steps);
                }
                // A rolled-back window has no steps.
                reply.step_series = series.filter(|_| outcome.steps > 0).unwrap_or_default();
                reply
            }
            Err(panic) => {
                self.component.recover(before)?;
                self.failure = Some(panic.clone());
                self.internal_error_reply(request, panic)
            }
        };
        if kind == WindowKind::Redo {
            self.invalidate_last_checkpoint();
        }
        self.store_reply(request.seq, content, &reply);
        Ok(reply)
    }

    fn store_reply(&mut self, seq: u64, content: Digest, reply: &AdvanceReply) {
        self.seq = seq;
        self.is_outdated = false;
        self.computed_windows += 1;
        self.answered = Some((content, reply.clone()));
    }

    /// Skips a window that was rolled back when it was first computed: it takes its number and cannot be redone.
    fn skip(
        &mut self,
        request: &AdvanceRequest,
        content: Digest,
    ) -> Result<AdvanceReply, RequestError> {
        self.component.restore(self.component.save())?;
        let reply = AdvanceReply {
            status: ReplyStatus::Discard,
            code: "deadline".into(),
            message: "deadline: expected steps, found a window without any".into(),
            ..self.unchanged_reply(request)
        };
        self.store_reply(request.seq, content, &reply);
        Ok(reply)
    }

    /// Returns the result or the refusal of a window, or the message of a panic.
    fn compute(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        monitor: &mut WindowMonitor,
    ) -> Result<Result<WindowResult, RequestError>, String> {
        let inputs = match request.inputs() {
            Ok(inputs) => inputs,
            Err(e) => return Ok(Err(e.into())),
        };
        let window = WindowInputsRef { motions: &inputs.motions, loads: &inputs.loads };
        let component = &mut self.component;
        let result = catch_unwind(AssertUnwindSafe(|| match kind {
            WindowKind::Advance => component.advance_observed(inputs.t1_ns, window, monitor),
            WindowKind::Redo => component.redo_observed(window, monitor),
        }));
        match result {
            Ok(outcome) => Ok(outcome.map_err(RequestError::from)),
            Err(panic) => Err(panic_message(panic.as_ref())),
        }
    }

    /// Returns true if a redo has the times of the last window, or if there is no last window.
    fn is_last_window(&self, request: &AdvanceRequest) -> bool {
        let asked = [request.t0_ns, request.t1_ns];
        self.component.last_window().is_none_or(|times| times.map(ns) == asked)
    }

    /// Returns code and message of a window that exceeded its deadline and keeps `kept` steps.
    fn deadline_message(&self, request: &AdvanceRequest, kept: u64) -> (String, String) {
        let (steps, ms) = (self.steps(request), request.deadline_ms);
        let text =
            format!("expected {steps} steps within {ms} ms, found fewer; {kept} steps are kept");
        ("deadline".into(), format!("deadline: {text}"))
    }

    /// Returns the number of steps of a window on the time grid.
    pub fn steps(&self, request: &AdvanceRequest) -> u64 {
        let ahead = core_ns(request.t1_ns.saturating_sub(request.t0_ns));
        ahead / self.component.model().stepping.step_ns
    }

    /// Returns an error if the step series would exceed the size of a message.
    fn check_series(&self, request: &AdvanceRequest) -> Result<(), RequestError> {
        let (steps, bodies) = (self.steps(request), self.component.model().driven.len() as u64);
        if !request.record_steps || steps.saturating_mul(bodies) <= MAX_SERIES_ENTRIES {
            return Ok(());
        }
        let expected =
            format!("at most {MAX_SERIES_ENTRIES} steps times bodies; ask for shorter windows");
        let found = format!("{steps} steps of {bodies} bodies");
        Err(RequestError::expected(ErrorCode::TooLarge, "record_steps", expected, found))
    }

    /// Returns the reply after an internal error; the state is that of the window's beginning.
    fn internal_error_reply(&self, request: &AdvanceRequest, panic: String) -> AdvanceReply {
        let (status, code) = (ReplyStatus::Error, "internal_error".into());
        AdvanceReply { status, code, message: panic, ..self.unchanged_reply(request) }
    }

    /// Returns the reply to a window that leaves the state unchanged.
    fn unchanged_reply(&self, request: &AdvanceRequest) -> AdvanceReply {
        let now = ns(self.component.now_ns());
        AdvanceReply {
            run_id: request.run_id.clone(),
            seq: request.seq,
            t0_ns: now,
            t1_ns: now,
            hash: self.state_hash,
            ..AdvanceReply::default()
        }
    }

    fn out_of_sequence(&self, kind: WindowKind, request: &AdvanceRequest) -> RequestError {
        let (seq, now) = (self.seq, self.component.now_ns());
        let expected = match (kind, self.component.last_window()) {
            (WindowKind::Advance, _) => format!("window {} from {now} ns", seq.saturating_add(1)),
            (WindowKind::Redo, Some([t0, t1])) => {
                format!("window {seq} again, from {t0} to {t1} ns")
            }
            (WindowKind::Redo, None) => format!("window {seq} again"),
        };
        let AdvanceRequest { seq: asked, t0_ns, t1_ns, .. } = request;
        let found = format!("window {asked} from {t0_ns} to {t1_ns} ns");
        let next = if kind == WindowKind::Redo { seq } else { seq.saturating_add(1) };
        let place = if *asked == next { "t0_ns" } else { "seq" };
        RequestError {
            expected_seq: Some(next),
            now_ns: Some(now),
            ..RequestError::expected(ErrorCode::OutOfSequence, place, expected, found)
        }
    }
}

/// Observer of a running window: measures, records and polls.
struct WindowMonitor<'a> {
    progress: WindowProgress,
    deadline_policy: DeadlinePolicy,
    /// Wall time at the start of the window, ns.
    start_ns: u64,
    /// Wall time after which the window is late, ns; `None` without a deadline.
    deadline_ns: Option<u64>,
    clock: WallClock<'a>,
    poll: WindowPoll<'a>,
    timer: PhaseTimer<'a>,
    series: Option<StepSeries>,
}

impl WindowMonitor<'_> {
    /// Updates the progress after a finished step.
    fn update_progress(&mut self, report: &StepReport) {
        let elapsed_ms = self.elapsed_ms();
        let progress = &mut self.progress;
        progress.step += 1;
        progress.iterations = Some(report.iterations);
        progress.residual_qm16 = Some(report.residuals.qm16());
        let left = progress.steps.saturating_sub(progress.step);
        progress.remaining_ms = Some(elapsed_ms.saturating_mul(left) / progress.step);
    }

    /// Polls the caller and returns the reason to end the window, if any.
    fn poll_stop(&mut self) -> Option<StopReason> {
        self.progress.elapsed_ms = self.elapsed_ms();
        if (self.poll)(&self.progress).is_break() {
            return Some(StopReason::Cancel);
        }
        let is_finished = self.progress.step == self.progress.steps;
        let is_late = self.deadline_ns.is_some_and(|deadline| (self.clock)() >= deadline);
        match self.deadline_policy {
            DeadlinePolicy::Discard if is_late && !is_finished => Some(StopReason::Discard),
            DeadlinePolicy::Early if is_late && !is_finished => Some(StopReason::Early),
            _ => None,
        }
    }

    fn elapsed_ms(&self) -> u64 {
        (self.clock)().saturating_sub(self.start_ns) / NS_PER_MS
    }
}

impl StepObserver for WindowMonitor<'_> {
    fn phase_finished(&mut self, phase: Phase) {
        self.timer.phase_finished(phase);
    }
    fn cancelled(&mut self) -> Option<StopReason> {
        self.poll_stop()
    }

    fn step_finished(&mut self, state: &State, report: &StepReport) -> ControlFlow<StopReason> {
        if let Some(series) = &mut self.series {
            series.push(state, report);
        }
        self.update_progress(report);
        self.poll_stop().map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }
}

/// Returns true for the empty window that stands for a rolled-back one in a repeated sequence.
fn is_placeholder(request: &AdvanceRequest) -> bool {
    request.t1_ns == request.t0_ns && request.deadline_policy == DeadlinePolicy::Discard
}
