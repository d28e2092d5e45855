//! One window: in its turn, computed, answered, and its answer kept.

use super::cost::{PhaseTimer, WallClock};
use super::{ErrorCode, Lockstep, RequestError, WindowProgress, panic_message};
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

/// Whether a window is new or the last one again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum WindowKind {
    Advance,
    Redo,
}

/// What is asked between the steps of a window, and within those that take long, by whichever thread is at it.
pub type WindowPoll<'a> = &'a mut (dyn FnMut(&WindowProgress) -> WindowControl + Send);

/// How a window is to go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum WindowControl {
    Continue,
    /// The time allowed has passed: what happens now is for the request's policy to say.
    DeadlineExceeded,
    /// Nobody waits for the window any more: it is taken back, as if it had never been asked for.
    Cancel,
}

impl Lockstep {
    /// Computes a window, or the last one again; `clock` tells the wall time, ns.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::WrongRun`], [`ErrorCode::OutOfSequence`], [`ErrorCode::NothingToRedo`], [`ErrorCode::ErrorState`],
    /// [`ErrorCode::ShuttingDown`], [`ErrorCode::Cancelled`] if `watch` says so, and what
    /// [`advance_to`](ballast::component::Component::advance_to) refuses.
    /// What goes wrong while computing is told by the reply.
    pub fn window(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        ticket: &str,
        clock: WallClock,
        watch: WindowPoll,
    ) -> Result<AdvanceReply, RequestError> {
        self.check_owner(ticket)?;
        if request.run_id != self.run_id {
            return Err(self.wrong_run(&request.run_id));
        }
        let content = request.digest()?;
        let is_last = request.seq == self.seq;
        // With other parameters since then, a redo is more than a retry.
        let is_known = kind == WindowKind::Advance || !self.is_outdated;
        if let Some((known, reply)) = &self.answered
            && is_last
            && is_known
            && *known == content
        {
            return Ok(reply.clone());
        }
        self.check_sound()?;
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
        if kind == WindowKind::Advance && is_nothing(request) {
            self.idle_since_ms = clock() / NS_PER_MS;
            return self.pass(request, content);
        }
        self.check_series(request)?;
        let before = self.component.save();
        let mut watched = WindowMonitor {
            progress: WindowProgress {
                seq: request.seq,
                steps: self.steps(request),
                ..WindowProgress::default()
            },
            policy: request.deadline_policy,
            begin: clock(),
            clock,
            watch,
            laps: PhaseTimer::begin(clock),
            series: request.record_steps.then(|| StepSeries::begin(self.component.model())),
        };
        let result = self.compute(kind, request, &mut watched);
        let WindowMonitor { laps, series, .. } = watched;
        // What was refused has cost nothing.
        self.cost = laps.end(request.seq).or(self.cost.take());
        self.idle_since_ms = clock() / NS_PER_MS;
        let reply = match result {
            Ok(outcome) => {
                let outcome = outcome?;
                self.hash_again();
                let model = self.component.model();
                let mut reply = AdvanceReply::of(request, model, &outcome, self.hash_now);
                if outcome.error.is_none()
                    && matches!(reply.status, ReplyStatus::Early | ReplyStatus::Discard)
                {
                    (reply.code, reply.message) = self.overdue(request, outcome.steps);
                }
                // Of what was taken back there is nothing to tell.
                reply.step_series = series.filter(|_| outcome.steps > 0).unwrap_or_default();
                reply
            }
            Err(panic) => {
                self.component.recover(before)?;
                self.failure = Some(panic.clone());
                self.failed(request, panic)
            }
        };
        if kind == WindowKind::Redo {
            self.lose_durable();
        }
        self.answer(request.seq, content, &reply);
        Ok(reply)
    }

    fn answer(&mut self, seq: u64, content: Digest, reply: &AdvanceReply) {
        self.seq = seq;
        self.is_outdated = false;
        self.computed_windows += 1;
        self.answered = Some((content, reply.clone()));
    }

    /// A window that was taken back when it was computed first: it takes its number, and there is nothing to redo.
    fn pass(
        &mut self,
        request: &AdvanceRequest,
        content: Digest,
    ) -> Result<AdvanceReply, RequestError> {
        self.component.restore(self.component.save())?;
        let reply = AdvanceReply {
            status: ReplyStatus::Discard,
            code: "deadline".into(),
            message: "deadline: expected steps, found a window without any".into(),
            ..self.unchanged(request)
        };
        self.answer(request.seq, content, &reply);
        Ok(reply)
    }

    /// The outcome or its refusal; or what a panic panic_message.
    fn compute(
        &mut self,
        kind: WindowKind,
        request: &AdvanceRequest,
        watched: &mut WindowMonitor,
    ) -> Result<Result<WindowResult, RequestError>, String> {
        let inputs = match request.inputs() {
            Ok(inputs) => inputs,
            Err(e) => return Ok(Err(e.into())),
        };
        let window = WindowInputsRef { motions: &inputs.motions, loads: &inputs.loads };
        let component = &mut self.component;
        let result = catch_unwind(AssertUnwindSafe(|| match kind {
            WindowKind::Advance => component.advance_observed(inputs.t1_ns, window, watched),
            WindowKind::Redo => component.redo_observed(window, watched),
        }));
        match result {
            Ok(outcome) => Ok(outcome.map_err(RequestError::from)),
            Err(panic) => Err(panic_message(panic.as_ref())),
        }
    }

    /// Whether a redo asks for the times of the last window; of none, the component says so.
    fn is_last_window(&self, request: &AdvanceRequest) -> bool {
        let asked = [request.t0_ns, request.t1_ns];
        self.component.last_window().is_none_or(|times| times.map(ns) == asked)
    }

    /// ErrorCode and message of a window that only ran out of time, of which so many steps are kept.
    fn overdue(&self, request: &AdvanceRequest, kept: u64) -> (String, String) {
        let (steps, ms) = (self.steps(request), request.deadline_ms);
        let text = format!("expected {steps} steps within {ms} ms, found fewer; {kept} are kept");
        ("deadline".into(), format!("deadline: {text}"))
    }

    /// How many steps a window has that is on the grid.
    pub fn steps(&self, request: &AdvanceRequest) -> u64 {
        let ahead = core_ns(request.t1_ns.saturating_sub(request.t0_ns));
        ahead / self.component.model().stepping.step_ns
    }

    /// Refuses a series that would not fit into a message.
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

    /// The reply to a window in which the program failed; the state is that of its beginning.
    fn failed(&self, request: &AdvanceRequest, panic: String) -> AdvanceReply {
        let (status, code) = (ReplyStatus::Error, "internal_error".into());
        AdvanceReply { status, code, message: panic, ..self.unchanged(request) }
    }

    /// The reply to a window that has changed nothing.
    fn unchanged(&self, request: &AdvanceRequest) -> AdvanceReply {
        let now = ns(self.component.now_ns());
        AdvanceReply {
            run_id: request.run_id.clone(),
            seq: request.seq,
            t0_ns: now,
            t1_ns: now,
            hash: self.hash_now,
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

/// How far a window is, what it tells, and who is asked whether it goes on.
struct WindowMonitor<'a> {
    progress: WindowProgress,
    policy: DeadlinePolicy,
    /// Wall time of its beginning, ns.
    begin: u64,
    clock: WallClock<'a>,
    watch: WindowPoll<'a>,
    laps: PhaseTimer<'a>,
    series: Option<StepSeries>,
}

impl WindowMonitor<'_> {
    /// A step is done.
    fn note(&mut self, report: &StepReport) {
        let elapsed_ms = self.elapsed_ms();
        let progress = &mut self.progress;
        progress.step += 1;
        progress.iterations = Some(report.iterations);
        progress.residual_qm16 = Some(report.residuals.qm16());
        let left = progress.steps.saturating_sub(progress.step);
        progress.remaining_ms = Some(elapsed_ms.saturating_mul(left) / progress.step);
    }

    /// How the window is to end, if it is to.
    fn ask(&mut self) -> Option<StopReason> {
        self.progress.elapsed_ms = self.elapsed_ms();
        match ((self.watch)(&self.progress), self.policy) {
            (WindowControl::Cancel, _) => Some(StopReason::Cancel),
            // Done is not late.
            (WindowControl::DeadlineExceeded, _) if self.progress.step == self.progress.steps => {
                None
            }
            (WindowControl::DeadlineExceeded, DeadlinePolicy::Discard) => Some(StopReason::Discard),
            (WindowControl::DeadlineExceeded, DeadlinePolicy::Early) => Some(StopReason::Early),
            (WindowControl::DeadlineExceeded, DeadlinePolicy::Finish)
            | (WindowControl::Continue, _) => None,
        }
    }

    fn elapsed_ms(&self) -> u64 {
        (self.clock)().saturating_sub(self.begin) / NS_PER_MS
    }
}

impl StepObserver for WindowMonitor<'_> {
    fn phase_finished(&mut self, phase: Phase) {
        self.laps.phase_finished(phase);
    }
    fn cancelled(&mut self) -> Option<StopReason> {
        self.ask()
    }

    fn step_finished(&mut self, state: &State, report: &StepReport) -> ControlFlow<StopReason> {
        if let Some(series) = &mut self.series {
            series.take(state, report);
        }
        self.note(report);
        self.ask().map_or(ControlFlow::Continue(()), ControlFlow::Break)
    }
}

/// Whether a window asks for no time at all, and to be taken back if that does not suffice.
fn is_nothing(request: &AdvanceRequest) -> bool {
    request.t1_ns == request.t0_ns && request.deadline_policy == DeadlinePolicy::Discard
}
