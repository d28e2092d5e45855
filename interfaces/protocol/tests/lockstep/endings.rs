//! Ends of windows: deadlines, cancellation, internal errors, and their step series.

use crate::{MS, ask, lockstep, straight, window};
use ballast_protocol::lockstep::WindowKind::{Advance, Redo};
use ballast_protocol::lockstep::{
    ComponentState, ErrorCode, Lockstep, ParameterUpdate, StateName, WindowProgress,
};
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, DeadlinePolicy, InterpolationMode, ReplyStatus, StepSeries,
    Vector3,
};
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicU64, Ordering};

/// Computes the next window, with a deadline of 1 ms that passes as soon as `is_late`.
fn overdue(
    lockstep: &mut Lockstep,
    request: &AdvanceRequest,
    ticket: &str,
    mut is_late: impl FnMut(&WindowProgress) -> bool + Send,
) -> AdvanceReply {
    assert_eq!(request.deadline_ms, 1);
    let now = AtomicU64::new(0);
    let mut poll = |p: &WindowProgress| {
        if is_late(p) {
            now.store(MS as u64, Ordering::Relaxed);
        }
        ControlFlow::Continue(())
    };
    let clock = || now.load(Ordering::Relaxed);
    lockstep.window(Advance, request, ticket, &clock, &mut poll).unwrap()
}

#[test]
fn a_deadline_ends_a_window_as_it_asks() {
    for (policy, status, steps) in [
        (DeadlinePolicy::Finish, ReplyStatus::Ok, 5),
        (DeadlinePolicy::Early, ReplyStatus::Early, 2),
        (DeadlinePolicy::Discard, ReplyStatus::Discard, 0),
    ] {
        let (mut lockstep, ticket) = lockstep();
        let start = lockstep.position().hash;
        let request = AdvanceRequest { deadline_ms: 1, deadline_policy: policy, ..window(1) };
        let reply = overdue(&mut lockstep, &request, &ticket, |p| {
            assert!(
                p.iterations.is_some() && p.residual_qm16.is_some() && p.remaining_ms.is_some()
            );
            p.step >= 2
        });
        let same = reply.status == status
            || (status == ReplyStatus::Ok && reply.status == ReplyStatus::Warn);
        assert!(same && reply.steps == steps, "{policy:?}: {reply:?}");
        assert_eq!(reply.t1_ns, steps as i64 * MS);
        assert_eq!(reply.hash.to_string() == start, policy == DeadlinePolicy::Discard);
        let code = if policy == DeadlinePolicy::Finish { "" } else { "deadline" };
        assert_eq!(reply.code, code);
        assert_eq!(
            reply.message.contains(&format!("{steps} steps are kept")),
            !code.is_empty(),
            "{reply:?}"
        );
        // It is answered: a retry gets the same, and a redo makes it whole.
        assert_eq!(ask(&mut lockstep, Advance, &request, &ticket).unwrap(), reply);
        let whole = ask(&mut lockstep, Redo, &window(1), &ticket).unwrap();
        assert_eq!(whole, straight(1), "{policy:?}");
    }
}

#[test]
fn a_window_that_cannot_be_computed_is_taken_back_and_says_why() {
    let (mut lockstep, ticket) = lockstep();
    let start = lockstep.position();
    let mut fast = window(1);
    fast.motions[0].interpolation = InterpolationMode::Linear;
    fast.motions[0].knots[1].pose.position.x = 10.0;
    let reply = ask(&mut lockstep, Advance, &fast, &ticket).unwrap();
    assert_eq!((reply.status, &reply.code[..]), (ReplyStatus::Discard, "over_speed"));
    assert!(reply.message.contains("floor"), "{}", reply.message);
    assert_eq!(lockstep.position().hash, start.hash);
    let deepest = ParameterUpdate { max_penetration: Some(1e-12), ..ParameterUpdate::default() };
    lockstep.set_parameters(&deepest, &ticket).unwrap();
    // Long enough for the stones to come down.
    let fall = AdvanceRequest { seq: 2, t1_ns: 300 * MS, motions: vec![], ..window(1) };
    let reply = ask(&mut lockstep, Advance, &fall, &ticket).unwrap();
    assert_eq!((reply.status, &reply.code[..]), (ReplyStatus::Discard, "penetration"));
    assert_eq!(lockstep.position().hash, start.hash);
}

#[test]
fn a_window_is_told_step_by_step_where_that_is_asked_for() {
    let (mut lockstep, ticket) = lockstep();
    let asked = AdvanceRequest { record_steps: true, ..window(1) };
    let reply = ask(&mut lockstep, Advance, &asked, &ticket).unwrap();
    assert_eq!(reply.step_series.time_ns, [1, 2, 3, 4, 5].map(|k| k * MS));
    assert_eq!(
        reply.step_series.iterations.iter().map(|i| u64::from(*i)).sum::<u64>(),
        reply.solver.iterations
    );
    assert_eq!(
        reply.step_series.residual_qm16.iter().copied().fold(0.0, f64::max),
        reply.solver.residual_qm16
    );
    assert_eq!(reply.step_series.bodies.len(), reply.bodies.len());
    for (series, body) in reply.step_series.bodies.iter().zip(&reply.bodies) {
        assert_eq!((&series.body, series.impulse.len()), (&body.body, 5));
        let sum = |of: fn(&Vector3) -> f64, all: &[Vector3]| all.iter().map(of).sum::<f64>();
        assert_eq!(sum(|v| v.z, &series.impulse), body.impulse.z);
        assert_eq!(sum(|v| v.x, &series.angular_impulse), body.angular_impulse.x);
    }
    // It changes nothing else, and without asking there is none.
    let plain = straight(1);
    assert_eq!(plain.step_series, StepSeries::default());
    assert_eq!(AdvanceReply { step_series: StepSeries::default(), ..reply }, plain);
    // One that would not fit is refused before anything is computed.
    let t1_ns = 5 * MS + 20_000 * MS;
    let long = AdvanceRequest { record_steps: true, t1_ns, ..window(2) };
    let fault = ask(&mut lockstep, Advance, &long, &ticket).unwrap_err();
    assert!(fault.code == ErrorCode::TooLarge && fault.message.contains("20000 steps"), "{fault}");
    assert_eq!(lockstep.position().seq, 1);
    // A rolled-back window has no step series.
    let request = AdvanceRequest {
        record_steps: true,
        deadline_ms: 1,
        deadline_policy: DeadlinePolicy::Discard,
        ..window(2)
    };
    let reply = overdue(&mut lockstep, &request, &ticket, |p| p.step >= 2);
    assert_eq!(reply.step_series, StepSeries::default());
}

#[test]
fn a_failure_inside_is_told_and_got_over() {
    let (mut lockstep, ticket) = lockstep();
    let name = StateName { name: "before".into() };
    lockstep.save(&name, &ticket).unwrap();
    let mut fail = |_: &WindowProgress| panic!("a fault in the program");
    let reply = lockstep.window(Advance, &window(1), &ticket, &|| 0, &mut fail).unwrap();
    assert_eq!((reply.status, reply.code.as_str()), (ReplyStatus::Error, "internal_error"));
    assert!(reply.message.contains("a fault in the program"), "{}", reply.message);
    let status = lockstep.status(0);
    assert_eq!(status.state, ComponentState::Error);
    assert!(status.error.unwrap().contains("a fault"));
    let fault = ask(&mut lockstep, Advance, &AdvanceRequest { seq: 2, ..window(1) }, &ticket);
    assert_eq!(fault.unwrap_err().code, ErrorCode::ErrorState);
    assert_eq!(lockstep.save(&name, &ticket).unwrap_err().code, ErrorCode::ErrorState);
    lockstep.restore(&name, &ticket).unwrap();
    let again = AdvanceRequest { seq: 2, ..window(1) };
    let reply = ask(&mut lockstep, Advance, &again, &ticket).unwrap();
    assert_eq!(reply.hash, straight(1).hash);
}

#[test]
fn a_cancelled_window_is_rolled_back_and_keeps_its_number() {
    for kind in [Advance, Redo] {
        let (mut lockstep, ticket) = lockstep();
        let last = ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
        let before = lockstep.position();
        let mut other = window(if kind == Redo { 1 } else { 2 });
        other.motions[0].knots[1].pose.position.z += 1e-4;
        let mut stop = |p: &WindowProgress| {
            if p.step == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let fault = lockstep.window(kind, &other, &ticket, &|| 0, &mut stop).unwrap_err();
        assert_eq!(fault.code, ErrorCode::Cancelled, "{kind:?}");
        assert_eq!((lockstep.position(), lockstep.status(0).state), (before, ComponentState::Idle));
        assert_eq!(lockstep.position().hash, last.hash.to_string());
        // What was answered before stays answered, and can be asked for and redone as if nothing had been.
        assert_eq!(ask(&mut lockstep, Advance, &window(1), &ticket).unwrap(), last);
        let (mut undisturbed, t) = crate::lockstep();
        ask(&mut undisturbed, Advance, &window(1), &t).unwrap();
        let replies = [(&mut lockstep, &ticket), (&mut undisturbed, &t)]
            .map(|(lockstep, ticket)| ask(lockstep, kind, &other, ticket).unwrap());
        assert_eq!(replies[0], replies[1], "{kind:?}");
    }
}

#[test]
fn a_step_without_end_is_ended_like_any_other() {
    let (mut lockstep, ticket) = lockstep();
    // Long enough for the stones to come down.
    let fall = AdvanceRequest { t1_ns: 300 * MS, motions: vec![], ..window(1) };
    ask(&mut lockstep, Advance, &fall, &ticket).unwrap();
    let start = lockstep.position();
    let before = lockstep.component().parameters();
    let set = |iterations, tolerance| ParameterUpdate {
        max_iterations: Some(iterations),
        tolerance: Some(tolerance),
        ..ParameterUpdate::default()
    };
    lockstep.set_parameters(&set(u32::MAX, 1e-300), &ticket).unwrap();
    let on = AdvanceRequest { t0_ns: 300 * MS, t1_ns: 302 * MS, motions: vec![], ..window(2) };
    let mut gone = |_: &WindowProgress| ControlFlow::Break(());
    let fault = lockstep.window(Advance, &on, &ticket, &|| 0, &mut gone).unwrap_err();
    assert_eq!((fault.code, lockstep.position().seq), (ErrorCode::Cancelled, 1));
    for (seq, policy) in [(2, DeadlinePolicy::Discard), (3, DeadlinePolicy::Early)] {
        let mut asked = 0;
        let request = AdvanceRequest { seq, deadline_ms: 1, deadline_policy: policy, ..on.clone() };
        let reply = overdue(&mut lockstep, &request, &ticket, |p| {
            asked += 1;
            assert_eq!(p.step, 0);
            asked > 3
        });
        // No step was done that could be kept.
        let told = (reply.status, &reply.code[..], reply.steps, reply.t1_ns);
        assert_eq!(told, (ReplyStatus::Discard, "deadline", 0, 300 * MS));
        assert_eq!(asked, 4);
    }
    lockstep.set_parameters(&set(before.iterations, before.tolerance.unwrap()), &ticket).unwrap();
    assert_eq!(lockstep.position().hash, start.hash);
    let request = AdvanceRequest { seq: 4, ..on };
    assert_eq!(ask(&mut lockstep, Advance, &request, &ticket).unwrap().steps, 2);
}
