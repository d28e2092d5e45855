//! Lockstep without a network: owners, sequences, retries, deadlines, failures, and a line that loses and
//! repeats.

#[path = "../../../tests/common/mod.rs"]
mod common;

use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_protocol::lockstep::{
    Activity, Attach, Code, Fault, Kept, Lockstep, Named, Pace, Progress, SetParameters, WindowKind,
};
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, BodyInput, DeadlinePolicy, Digest, Interpolation, Knot, Point,
    Pose, Quaternion, Status, StepSeries, Twist, Vector3,
};
use common::scene::Random;
use std::f64::consts::TAU;
use std::sync::Arc;

const MS: i64 = 1_000_000;

fn hash(_: &Model, state: &State) -> u128 {
    u128::from_be_bytes(Digest::of(format!("{state:?}").as_bytes()).0)
}

/// A heap on a floor that can be shaken.
fn component() -> Component {
    let mut scene = common::heap::falling(2, MS as u64).scheduled(Schedule::Synchronous, [2, 1, 1]);
    scene.model.solver.iterations = 50;
    scene.model.solver.tolerance = Some(1e-4);
    Component::new(Arc::new(scene.model), scene.state, Limits::default()).expect("a scene")
}

/// Its lockstep, and the ticket of its owner.
fn lockstep() -> (Lockstep, String) {
    let mut lockstep = Lockstep::new(component(), "run-1", hash);
    let ticket = attach(&mut lockstep, "driver").expect("nobody drives yet");
    (lockstep, ticket)
}

fn attach(lockstep: &mut Lockstep, client: &str) -> Result<String, Fault> {
    let ask = Attach { client: client.into(), ..Attach::default() };
    lockstep.attach(&ask, format!("ticket of {client}"), 1000).map(|a| a.ticket)
}

fn knot(time_ns: i64) -> Knot {
    let (t, w) = (time_ns as f64 * 1e-9, TAU * 10.0);
    Knot {
        time_ns,
        pose: Pose {
            position: Point { x: 0.0, y: 0.0, z: -2e-3 * (1.0 - (w * t).cos()) },
            orientation: Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 },
        },
        twist: Twist {
            linear: Vector3 { x: 0.0, y: 0.0, z: -2e-3 * w * (w * t).sin() },
            ..Twist::default()
        },
    }
}

/// Window `seq` of 5 ms, one after the other from 0.
fn window(seq: u64) -> AdvanceRequest {
    let t0_ns = (seq as i64 - 1) * 5 * MS;
    let t1_ns = t0_ns + 5 * MS;
    let floor = BodyInput {
        body: "floor".into(),
        interpolation: Interpolation::Hermite,
        rebase: false,
        knots: vec![knot(t0_ns), knot(t1_ns)],
    };
    let motions = vec![floor];
    AdvanceRequest {
        run_id: "run-1".into(),
        seq,
        t0_ns,
        t1_ns,
        motions,
        ..AdvanceRequest::default()
    }
}

fn ask(
    lockstep: &mut Lockstep,
    kind: WindowKind,
    request: &AdvanceRequest,
    ticket: &str,
) -> Result<AdvanceReply, Fault> {
    lockstep.window(kind, request, ticket, &|| 0, &mut |_| Pace::GoOn)
}

/// The reply to windows 1 to `last`, one after the other.
fn straight(last: u64) -> AdvanceReply {
    let (mut lockstep, ticket) = lockstep();
    let replies =
        (1..=last).map(|seq| ask(&mut lockstep, WindowKind::Advance, &window(seq), &ticket));
    replies.last().expect("a window").expect("good windows")
}

#[test]
fn a_retry_is_answered_from_memory_and_computes_nothing() {
    let (mut lockstep, ticket) = lockstep();
    let first = ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
    assert!(matches!(first.status, Status::Ok | Status::Warn) && first.steps == 5, "{first:?}");
    let mut steps = 0;
    let again = lockstep.window(WindowKind::Advance, &window(1), &ticket, &|| 0, &mut |_| {
        steps += 1;
        Pace::GoOn
    });
    assert_eq!((again.unwrap(), steps), (first.clone(), 0));
    assert_eq!(lockstep.answered_count(), 1);
    assert_eq!(lockstep.place().hash, first.hash.to_string());
    assert_eq!(lockstep.component().now_ns(), 5 * MS as u64);
}

#[test]
fn what_is_out_of_sequence_is_told_the_number_and_changes_nothing() {
    let (mut lockstep, ticket) = lockstep();
    let redo = ask(&mut lockstep, WindowKind::Redo, &window(0), &ticket).unwrap_err();
    assert_eq!((redo.code, redo.expected_seq), (Code::NothingToRedo, Some(0)));
    ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
    let before = lockstep.place();
    let late = AdvanceRequest { t0_ns: 4 * MS, ..window(2) };
    let other = AdvanceRequest { t1_ns: 4 * MS, ..window(1) };
    for wrong in [window(3), window(0), late, other, AdvanceRequest { seq: u64::MAX, ..window(2) }]
    {
        let fault = ask(&mut lockstep, WindowKind::Advance, &wrong, &ticket).unwrap_err();
        assert_eq!(fault.code, Code::OutOfSequence, "{fault}");
        assert_eq!((fault.expected_seq, fault.now_ns), (Some(2), Some(5 * MS as u64)));
        assert!(fault.message.contains("window 2 from 5000000 ns"), "{fault}");
        assert_eq!(lockstep.place(), before);
    }
    let run = AdvanceRequest { run_id: "run-0".into(), ..window(2) };
    let fault = ask(&mut lockstep, WindowKind::Advance, &run, &ticket).unwrap_err();
    assert!(fault.code == Code::WrongRun && fault.message.contains("run-0"), "{fault}");
}

#[test]
fn bad_inputs_keep_the_number() {
    let (mut lockstep, ticket) = lockstep();
    let before = lockstep.place();
    let mut jump = window(1);
    jump.motions[0].knots[0].pose.position.x += 0.01;
    let mut unknown = window(1);
    unknown.motions[0].body = "flor".into();
    let mut turned = window(1);
    turned.motions[0].knots[1].pose.orientation.w = 2.0;
    let grid = AdvanceRequest { t1_ns: 5 * MS + 1, ..window(1) };
    let past = AdvanceRequest { t1_ns: -1, ..window(1) };
    for (bad, code) in [
        (jump, Code::InputJump),
        (unknown, Code::UnknownBody),
        (turned, Code::Malformed),
        (grid, Code::TimeGrid),
        (past, Code::Malformed),
    ] {
        let fault = ask(&mut lockstep, WindowKind::Advance, &bad, &ticket).unwrap_err();
        assert_eq!(fault.code, code, "{fault}");
        assert_eq!(lockstep.place(), before);
    }
    ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
}

#[test]
fn a_redo_takes_the_place_of_the_window() {
    let (mut lockstep, ticket) = lockstep();
    ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
    let first = ask(&mut lockstep, WindowKind::Advance, &window(2), &ticket).unwrap();
    let mut other = window(2);
    other.motions[0].knots[1].pose.position.z += 1e-4;
    let changed = ask(&mut lockstep, WindowKind::Redo, &other, &ticket).unwrap();
    assert_ne!(changed.hash, first.hash);
    assert_eq!((changed.seq, changed.t1_ns), (2, 10 * MS));
    // A retry of the redo is answered; the window itself is not the last one any more.
    assert_eq!(ask(&mut lockstep, WindowKind::Redo, &other, &ticket).unwrap(), changed);
    assert_eq!(
        ask(&mut lockstep, WindowKind::Advance, &window(2), &ticket).unwrap_err().code,
        Code::OutOfSequence
    );
    assert_eq!(ask(&mut lockstep, WindowKind::Redo, &window(2), &ticket).unwrap(), first);
    assert_eq!(ask(&mut lockstep, WindowKind::Advance, &window(3), &ticket).unwrap(), straight(3));
}

#[test]
fn one_drives_and_others_cannot() {
    let (mut lockstep, ticket) = lockstep();
    let busy = attach(&mut lockstep, "other").unwrap_err();
    assert_eq!((busy.code, busy.owner.as_deref()), (Code::Busy, Some("driver")));
    let before = lockstep.place();
    let name = Named { name: "here".into() };
    for wrong in ["", "ticket", "ticket of other"] {
        let faults = [
            ask(&mut lockstep, WindowKind::Advance, &window(1), wrong).unwrap_err(),
            lockstep.reset("run-2".into(), wrong, 0).unwrap_err(),
            lockstep.save(&name, wrong).unwrap_err(),
            lockstep.restore(&name, wrong).unwrap_err(),
            lockstep.drop_state(&name, wrong).unwrap_err(),
            lockstep.detach(wrong).unwrap_err(),
            lockstep.shut_down(wrong).unwrap_err(),
        ];
        assert!(faults.iter().all(|f| f.code == Code::NotOwner), "{faults:?}");
        let found = if wrong.is_empty() { "none" } else { "another" };
        let is_told = |f: &Fault| {
            f.finding.as_ref().is_some_and(|f| (&f.place[..], &f.found[..]) == ("ticket", found))
        };
        assert!(faults.iter().all(is_told), "{faults:?}");
        assert!(!format!("{faults:?}").contains("ticket of driver"), "the ticket stays secret");
    }
    assert_eq!(lockstep.place(), before);
    // The owner's own client that has lost its line shows its ticket and gets a new one.
    let again = Attach { client: "driver".into(), resume: None, ticket: Some(ticket.clone()) };
    let fresh = lockstep.attach(&again, "fresh".into(), 2000).unwrap().ticket;
    assert_eq!(lockstep.detach(&ticket).unwrap_err().code, Code::NotOwner);
    ask(&mut lockstep, WindowKind::Advance, &window(1), &fresh).unwrap();
    // Gone, and another one goes on with the run.
    assert!(!lockstep.lost("other") && lockstep.lost("driver"));
    assert_eq!(
        ask(&mut lockstep, WindowKind::Advance, &window(2), &fresh).unwrap_err().code,
        Code::NotOwner
    );
    let wrong = Attach { client: "other".into(), resume: Some("run-9".into()), ticket: None };
    assert_eq!(lockstep.attach(&wrong, "t".into(), 0).unwrap_err().code, Code::WrongRun);
    let right = Attach { resume: Some("run-1".into()), ..wrong };
    let attached = lockstep.attach(&right, "t".into(), 0).unwrap();
    assert_eq!((attached.place.seq, attached.place.now_ns), (1, 5 * MS as u64));
    assert_eq!(ask(&mut lockstep, WindowKind::Advance, &window(2), "t").unwrap(), straight(2));
}

#[test]
fn states_are_kept_by_name() {
    let (mut lockstep, ticket) = lockstep();
    ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
    let name = Named { name: "after-1".into() };
    let kept = lockstep.save(&name, &ticket).unwrap();
    let second = ask(&mut lockstep, WindowKind::Advance, &window(2), &ticket).unwrap();
    let back = lockstep.restore(&name, &ticket).unwrap();
    assert_eq!((back.now_ns, &back.hash, back.seq), (kept.now_ns, &kept.hash, 2));
    // Numbers go on; the last window is not there to be redone or asked for again.
    assert_eq!(
        ask(&mut lockstep, WindowKind::Redo, &window(2), &ticket).unwrap_err().code,
        Code::NothingToRedo
    );
    let again = AdvanceRequest { seq: 3, ..window(2) };
    let reply = ask(&mut lockstep, WindowKind::Advance, &again, &ticket).unwrap();
    assert_eq!((reply.hash, reply.seq), (second.hash, 3));
    lockstep.drop_state(&name, &ticket).unwrap();
    let fault = lockstep.restore(&name, &ticket).unwrap_err();
    assert!(fault.code == Code::UnknownState && fault.message.contains("after-1"), "{fault}");
    for bad in ["", "a/b", "ü", &"x".repeat(201)] {
        let fault = lockstep.save(&Named { name: bad.into() }, &ticket).unwrap_err();
        assert_eq!(fault.code, Code::Malformed, "{fault}");
    }
    for k in 0..64 {
        lockstep.save(&Named { name: format!("s{k}") }, &ticket).unwrap();
    }
    assert_eq!(lockstep.save(&name, &ticket).unwrap_err().code, Code::TooManyStates);
    lockstep.save(&Named { name: "s3".into() }, &ticket).unwrap();
    let fresh = lockstep.reset("run-2".into(), &ticket, 0).unwrap();
    assert_eq!((fresh.run_id.as_str(), fresh.seq, fresh.now_ns), ("run-2", 0, 0));
    assert_eq!(lockstep.restore(&name, &ticket).unwrap_err().code, Code::UnknownState);
    let first = AdvanceRequest { run_id: "run-2".into(), ..window(1) };
    assert_eq!(
        ask(&mut lockstep, WindowKind::Advance, &first, &ticket).unwrap().hash,
        straight(1).hash
    );
}

#[test]
fn a_deadline_ends_a_window_as_it_asks() {
    for (policy, status, steps) in [
        (DeadlinePolicy::Finish, Status::Ok, 5),
        (DeadlinePolicy::Early, Status::Early, 2),
        (DeadlinePolicy::Discard, Status::Discard, 0),
    ] {
        let (mut lockstep, ticket) = lockstep();
        let start = lockstep.place().hash;
        let request = AdvanceRequest { deadline_policy: policy, ..window(1) };
        let mut late = |p: &Progress| if p.step >= 2 { Pace::TimeIsUp } else { Pace::GoOn };
        let reply =
            lockstep.window(WindowKind::Advance, &request, &ticket, &|| 0, &mut late).unwrap();
        let same = reply.status == status || (status == Status::Ok && reply.status == Status::Warn);
        assert!(same && reply.steps == steps, "{policy:?}: {reply:?}");
        assert_eq!(reply.t1_ns, steps as i64 * MS);
        assert_eq!(reply.hash.to_string() == start, policy == DeadlinePolicy::Discard);
        let code = if policy == DeadlinePolicy::Finish { "" } else { "deadline" };
        assert_eq!(reply.code, code);
        assert_eq!(
            reply.message.contains(&format!("{steps} are kept")),
            !code.is_empty(),
            "{reply:?}"
        );
        // It is answered: a retry gets the same, and a redo makes it whole.
        assert_eq!(ask(&mut lockstep, WindowKind::Advance, &request, &ticket).unwrap(), reply);
        let whole = ask(&mut lockstep, WindowKind::Redo, &window(1), &ticket).unwrap();
        assert_eq!(whole, straight(1), "{policy:?}");
    }
}

/// The refusal of window 1 with a change.
fn refused(change: impl FnOnce(&mut AdvanceRequest)) -> Fault {
    let (mut lockstep, ticket) = lockstep();
    let mut request = window(1);
    change(&mut request);
    let before = lockstep.place();
    let fault = ask(&mut lockstep, WindowKind::Advance, &request, &ticket).unwrap_err();
    assert_eq!(lockstep.place(), before, "{fault}");
    fault
}

#[test]
fn a_refusal_has_its_code_and_says_where_what_was_expected_and_found() {
    let cases = [
        (refused(|r| r.t1_ns += 1), Code::TimeGrid, "t1_ns", "5000001 ns"),
        (refused(|r| r.motions[0].knots[0].time_ns = MS), Code::InputGap, "floor", "from 1000000"),
        (refused(|r| r.motions[0].knots[0].pose.position.x = 0.1), Code::InputJump, "floor", "m"),
        (
            refused(|r| r.motions[0].knots[1].twist.linear.x = f64::NAN),
            Code::InputInvalid,
            "floor",
            "NaN",
        ),
        (refused(|r| r.motions[0].body = "door".into()), Code::UnknownBody, "body", "door"),
        (refused(|r| r.t1_ns = -1), Code::Malformed, "t1_ns", "-1"),
        (refused(|r| r.run_id = "run-0".into()), Code::WrongRun, "run_id", "run-0"),
        (refused(|r| r.seq = 5), Code::OutOfSequence, "seq", "window 5"),
    ];
    for (fault, code, place, found) in cases {
        assert_eq!(fault.code, code, "{fault}");
        let finding = fault.finding.clone().unwrap_or_default();
        assert_eq!(finding.place, place, "{fault}");
        assert!(!finding.expected.is_empty() && finding.found.contains(found), "{finding:?}");
        let nearest = (code == Code::TimeGrid).then_some([5_000_000, 6_000_000]);
        assert_eq!(finding.nearest_ns, nearest);
        // As partners get it.
        let text = serde_json::to_string(&fault).unwrap();
        assert!(text.contains("\"place\"") && !text.contains("finding"), "{text}");
        assert_eq!(serde_json::from_str::<Fault>(&text).unwrap(), fault);
    }
    let (mut lockstep, ticket) = lockstep();
    let deepest = SetParameters { penetration: Some(-1.0), ..SetParameters::default() };
    let fault = lockstep.set_parameters(&deepest, &ticket).unwrap_err();
    assert_eq!(fault.code, Code::ParameterInvalid, "{fault}");
    assert!(fault.finding.is_some_and(|f| f.place.contains("penetration") && f.found == "-1"));
    // What was refused is not the last window that was computed.
    ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
    ask(
        &mut lockstep,
        WindowKind::Advance,
        &AdvanceRequest { t1_ns: 11 * MS + 1, ..window(2) },
        &ticket,
    )
    .unwrap_err();
    assert_eq!(lockstep.status(0).last_window.map(|cost| (cost.seq, cost.steps)), Some((1, 5)));
    // One without parts comes through, too.
    let plain = Fault::new(Code::Busy, "someone drives");
    let text = serde_json::to_string(&plain).unwrap();
    assert_eq!(serde_json::from_str::<Fault>(&text).unwrap(), plain);
}

#[test]
fn a_window_that_cannot_be_computed_is_taken_back_and_says_why() {
    let (mut lockstep, ticket) = lockstep();
    let start = lockstep.place();
    let mut fast = window(1);
    fast.motions[0].interpolation = Interpolation::Linear;
    fast.motions[0].knots[1].pose.position.x = 10.0;
    let reply = ask(&mut lockstep, WindowKind::Advance, &fast, &ticket).unwrap();
    assert_eq!((reply.status, &reply.code[..]), (Status::Discard, "over_speed"));
    assert!(reply.message.contains("floor"), "{}", reply.message);
    assert_eq!(lockstep.place().hash, start.hash);
    let deepest = SetParameters { penetration: Some(1e-12), ..SetParameters::default() };
    lockstep.set_parameters(&deepest, &ticket).unwrap();
    // Long enough for the stones to come down.
    let fall = AdvanceRequest { seq: 2, t1_ns: 300 * MS, motions: vec![], ..window(1) };
    let reply = ask(&mut lockstep, WindowKind::Advance, &fall, &ticket).unwrap();
    assert_eq!((reply.status, &reply.code[..]), (Status::Discard, "penetration"));
    assert_eq!(lockstep.place().hash, start.hash);
}

#[test]
fn a_window_is_told_step_by_step_where_that_is_asked_for() {
    let (mut lockstep, ticket) = lockstep();
    let asked = AdvanceRequest { series: true, ..window(1) };
    let reply = ask(&mut lockstep, WindowKind::Advance, &asked, &ticket).unwrap();
    assert_eq!(reply.series.time_ns, [1, 2, 3, 4, 5].map(|k| k * MS));
    assert_eq!(
        reply.series.iterations.iter().map(|i| u64::from(*i)).sum::<u64>(),
        reply.solver.iterations
    );
    assert_eq!(
        reply.series.residual_qm16.iter().copied().fold(0.0, f64::max),
        reply.solver.residual_qm16
    );
    assert_eq!(reply.series.bodies.len(), reply.bodies.len());
    for (series, body) in reply.series.bodies.iter().zip(&reply.bodies) {
        assert_eq!((&series.body, series.impulse.len()), (&body.body, 5));
        let sum = |of: fn(&Vector3) -> f64, all: &[Vector3]| all.iter().map(of).sum::<f64>();
        assert_eq!(sum(|v| v.z, &series.impulse), body.impulse.z);
        assert_eq!(sum(|v| v.x, &series.angular_impulse), body.angular_impulse.x);
    }
    // It changes nothing else, and without asking there is none.
    let plain = straight(1);
    assert_eq!(plain.series, StepSeries::default());
    assert_eq!(AdvanceReply { series: StepSeries::default(), ..reply }, plain);
    // One that would not fit is refused before anything is computed.
    let t1_ns = 5 * MS + 20_000 * MS;
    let long = AdvanceRequest { series: true, t1_ns, ..window(2) };
    let fault = ask(&mut lockstep, WindowKind::Advance, &long, &ticket).unwrap_err();
    assert!(fault.code == Code::TooLarge && fault.message.contains("20000 steps"), "{fault}");
    assert_eq!(lockstep.place().seq, 1);
    // Nor is anything told of what was taken back.
    let request =
        AdvanceRequest { series: true, deadline_policy: DeadlinePolicy::Discard, ..window(2) };
    let mut late = |p: &Progress| if p.step >= 2 { Pace::TimeIsUp } else { Pace::GoOn };
    let reply = lockstep.window(WindowKind::Advance, &request, &ticket, &|| 0, &mut late).unwrap();
    assert_eq!(reply.series, StepSeries::default());
}

#[test]
fn a_redo_is_of_the_times_of_the_last_window() {
    let (mut lockstep, ticket) = lockstep();
    ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
    let asked = window(1);
    for (t0_ns, t1_ns) in
        [(asked.t0_ns, 2 * asked.t1_ns), (77 * MS, 3 * MS), (asked.t1_ns, 2 * asked.t1_ns)]
    {
        let other = AdvanceRequest { t0_ns, t1_ns, ..window(1) };
        let fault = ask(&mut lockstep, WindowKind::Redo, &other, &ticket).unwrap_err();
        assert_eq!(fault.code, Code::OutOfSequence);
        assert!(fault.to_string().contains("from 0 to"), "{fault}");
    }
}

#[test]
fn parameters_are_the_owners_to_set_and_go_with_kept_states() {
    // Long enough for the stones to fall onto the floor.
    let long = |seq: u64, deadline_ms: u32| {
        let mut request = AdvanceRequest { seq, t1_ns: 100 * MS, deadline_ms, ..window(1) };
        request.motions[0].knots = (0..=20).map(|k| knot(k * 5 * MS)).collect();
        request
    };
    let (mut other, ticket) = lockstep();
    let usually = ask(&mut other, WindowKind::Advance, &long(1, 0), &ticket).unwrap().hash;
    let (mut lockstep, ticket) = lockstep();
    let name = Named { name: "usual".into() };
    lockstep.save(&name, &ticket).unwrap();
    let hasty = SetParameters { iterations: Some(2), tolerance: Some(0.0), ..Default::default() };
    let fault = lockstep.set_parameters(&hasty, "ticket of other").unwrap_err();
    assert_eq!(fault.code, Code::NotOwner);
    for bad in [
        SetParameters { iterations: Some(0), ..Default::default() },
        SetParameters { tolerance: Some(-1.0), ..Default::default() },
        SetParameters { penetration: Some(-1e-3), ..Default::default() },
    ] {
        let fault = lockstep.set_parameters(&bad, &ticket).unwrap_err();
        assert_eq!(fault.code, Code::ParameterInvalid, "{fault}");
        assert_eq!(lockstep.component().parameters().iterations, 50);
    }
    lockstep.set_parameters(&hasty, &ticket).unwrap();
    let reply = ask(&mut lockstep, WindowKind::Advance, &long(1, 0), &ticket).unwrap();
    assert!(reply.solver.iterations <= 200, "{:?}", reply.solver);
    assert_ne!(reply.hash, usually);
    // The window again, as well as usual.
    let usual = SetParameters { iterations: Some(50), tolerance: Some(1e-4), ..Default::default() };
    lockstep.set_parameters(&usual, &ticket).unwrap();
    // A lost reply is still a lost reply; a redo of the same content is computed, once.
    let again = ask(&mut lockstep, WindowKind::Advance, &long(1, 0), &ticket).unwrap();
    assert_eq!(again.hash, reply.hash);
    let redone = ask(&mut lockstep, WindowKind::Redo, &long(1, 0), &ticket).unwrap();
    assert_eq!(redone.hash, usually);
    let count = lockstep.answered_count();
    assert_eq!(ask(&mut lockstep, WindowKind::Redo, &long(1, 0), &ticket).unwrap(), redone);
    assert_eq!(lockstep.answered_count(), count);
    // The penetration that is allowed is in no hash.
    let strict = SetParameters { penetration: Some(1e-12), ..Default::default() };
    lockstep.set_parameters(&strict, &ticket).unwrap();
    let refused = ask(&mut lockstep, WindowKind::Redo, &long(1, 0), &ticket).unwrap();
    assert_eq!(refused.status, Status::Discard);
    let generous = SetParameters { penetration: Some(1.0), ..Default::default() };
    lockstep.set_parameters(&generous, &ticket).unwrap();
    assert_eq!(ask(&mut lockstep, WindowKind::Redo, &long(1, 0), &ticket).unwrap().hash, usually);
    lockstep.set_parameters(&hasty, &ticket).unwrap();
    lockstep.restore(&name, &ticket).unwrap();
    let reply = ask(&mut lockstep, WindowKind::Advance, &long(2, 0), &ticket).unwrap();
    assert_eq!(reply.hash, usually);
    lockstep.set_parameters(&hasty, &ticket).unwrap();
    lockstep.reset("run-2".into(), &ticket, 0).unwrap();
    let first = AdvanceRequest { run_id: "run-2".into(), ..long(1, 0) };
    assert_eq!(ask(&mut lockstep, WindowKind::Advance, &first, &ticket).unwrap().hash, usually);
}

#[test]
fn what_is_not_configured_waits_for_init_and_keeps_its_owner() {
    let mut lockstep = Lockstep::unconfigured(hash).unwrap();
    let ticket = attach(&mut lockstep, "driver").unwrap();
    let status = lockstep.status(0);
    assert_eq!(status.activity, Activity::Unconfigured);
    assert_eq!(status.waiting_for.as_deref(), Some("init from driver"));
    let request = AdvanceRequest { run_id: "unconfigured".into(), ..window(1) };
    let name = Named { name: "here".into() };
    for fault in [
        ask(&mut lockstep, WindowKind::Advance, &request, &ticket).unwrap_err(),
        lockstep.save(&name, &ticket).unwrap_err(),
        lockstep.reset("run-1".into(), &ticket, 0).unwrap_err(),
        lockstep.set_parameters(&SetParameters::default(), &ticket).unwrap_err(),
    ] {
        assert_eq!(fault.code, Code::Unconfigured, "{fault}");
    }
    assert_eq!(lockstep.check_init("ticket of other").unwrap_err().code, Code::NotOwner);
    lockstep.check_init(&ticket).unwrap();
    let place = lockstep.begin(component(), "run-1".into(), 0);
    assert_eq!((place.run_id.as_str(), place.seq, place.now_ns), ("run-1", 0, 0));
    assert_eq!(lockstep.status(0).activity, Activity::Paused);
    assert_eq!(ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap(), straight(1));
    // Prepared anew: another run, nothing of the old one is left.
    lockstep.save(&name, &ticket).unwrap();
    lockstep.begin(component(), "run-2".into(), 0);
    assert_eq!(lockstep.restore(&name, &ticket).unwrap_err().code, Code::UnknownState);
    let first = AdvanceRequest { run_id: "run-2".into(), ..window(1) };
    assert_eq!(
        ask(&mut lockstep, WindowKind::Advance, &first, &ticket).unwrap().hash,
        straight(1).hash
    );
}

#[test]
fn a_failure_inside_is_told_and_got_over() {
    let (mut lockstep, ticket) = lockstep();
    let name = Named { name: "before".into() };
    lockstep.save(&name, &ticket).unwrap();
    let mut fail = |_: &Progress| panic!("a fault in the program");
    let reply =
        lockstep.window(WindowKind::Advance, &window(1), &ticket, &|| 0, &mut fail).unwrap();
    assert_eq!((reply.status, reply.code.as_str()), (Status::Error, "failed_inside"));
    assert!(reply.message.contains("a fault in the program"), "{}", reply.message);
    let status = lockstep.status(0);
    assert_eq!(status.activity, Activity::Error);
    assert!(status.trouble.unwrap().contains("a fault"));
    let fault =
        ask(&mut lockstep, WindowKind::Advance, &AdvanceRequest { seq: 2, ..window(1) }, &ticket);
    assert_eq!(fault.unwrap_err().code, Code::InError);
    assert_eq!(lockstep.save(&name, &ticket).unwrap_err().code, Code::InError);
    lockstep.restore(&name, &ticket).unwrap();
    let again = AdvanceRequest { seq: 2, ..window(1) };
    let reply = ask(&mut lockstep, WindowKind::Advance, &again, &ticket).unwrap();
    assert_eq!(reply.hash, straight(1).hash);
}

#[test]
fn a_component_that_quits_computes_nothing_more() {
    let (mut lockstep, ticket) = lockstep();
    lockstep.shut_down(&ticket).unwrap();
    assert_eq!(lockstep.status(0).activity, Activity::Quitting);
    assert_eq!(
        ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap_err().code,
        Code::Quitting
    );
    assert_eq!(attach(&mut lockstep, "other").unwrap_err().code, Code::Quitting);
}

#[test]
fn a_window_that_is_abandoned_is_taken_back_and_keeps_its_number() {
    for kind in [WindowKind::Advance, WindowKind::Redo] {
        let (mut lockstep, ticket) = lockstep();
        let last = ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap();
        let before = lockstep.place();
        let mut other = window(if kind == WindowKind::Redo { 1 } else { 2 });
        other.motions[0].knots[1].pose.position.z += 1e-4;
        let mut stop = |p: &Progress| if p.step == 3 { Pace::Abandon } else { Pace::GoOn };
        let fault = lockstep.window(kind, &other, &ticket, &|| 0, &mut stop).unwrap_err();
        assert_eq!(fault.code, Code::Abandoned, "{kind:?}");
        assert_eq!((lockstep.place(), lockstep.status(0).activity), (before, Activity::Paused));
        assert_eq!(lockstep.place().hash, last.hash.to_string());
        // What was answered before stays answered, and can be asked for and redone as if nothing had been.
        assert_eq!(ask(&mut lockstep, WindowKind::Advance, &window(1), &ticket).unwrap(), last);
        let (mut undisturbed, t) = self::lockstep();
        ask(&mut undisturbed, WindowKind::Advance, &window(1), &t).unwrap();
        let replies = [(&mut lockstep, &ticket), (&mut undisturbed, &t)]
            .map(|(lockstep, ticket)| ask(lockstep, kind, &other, ticket).unwrap());
        assert_eq!(replies[0], replies[1], "{kind:?}");
    }
}

#[test]
fn a_run_is_taken_up_from_its_checkpoint() {
    let (mut first, ticket) = lockstep();
    for seq in 1..=3 {
        ask(&mut first, WindowKind::Advance, &window(seq), &ticket).unwrap();
    }
    first.note_durable();
    assert_eq!(first.status(0).durable_seq, 3);
    let kept = Kept::of(first.component());
    let (mut second, ticket) = lockstep();
    second.resume("run-1", 3, kept, first.answered().cloned()).unwrap();
    assert_eq!(second.place(), first.place());
    // The last window was answered by a process that is gone; a retry is answered all the same.
    assert_eq!(ask(&mut second, WindowKind::Advance, &window(3), &ticket).unwrap(), straight(3));
    assert_eq!(second.answered_count(), 0);
    // How it began is not known to this one.
    let redo = AdvanceRequest { motions: vec![], ..window(3) };
    let fault = ask(&mut second, WindowKind::Redo, &redo, &ticket).unwrap_err();
    assert_eq!(fault.code, Code::NothingToRedo, "{fault}");
    assert_eq!(ask(&mut second, WindowKind::Advance, &window(4), &ticket).unwrap(), straight(4));
    // Nor is a state taken up that is none of this model's.
    let mut foreign = Kept::of(first.component());
    Arc::make_mut(&mut foreign.state).velocity.pop();
    let fault = second.resume("run-1", 3, foreign, None).unwrap_err();
    assert_eq!(fault.code, Code::StateInvalid, "{fault}");
    assert_eq!(second.place().seq, 4);
}

#[test]
fn a_line_that_loses_and_repeats_changes_nothing() {
    let last = 12;
    let undisturbed = straight(last);
    for seed in 0..20 {
        let mut random = Random(seed);
        let (mut lockstep, ticket) = lockstep();
        let mut old: Vec<AdvanceRequest> = vec![];
        let mut seq = 1;
        let mut reply = None;
        while seq <= last {
            // Something that was sent long ago arrives now.
            if !old.is_empty() && random.next() < 0.3 {
                let k = (random.next() * old.len() as f64) as usize;
                let _ = ask(&mut lockstep, WindowKind::Advance, &old[k], &ticket);
            }
            if random.next() < 0.2 {
                let _ =
                    ask(&mut lockstep, WindowKind::Advance, &window(seq), "ticket of a stranger");
            }
            if random.next() < 0.3 {
                continue; // the request is lost
            }
            let answer = ask(&mut lockstep, WindowKind::Advance, &window(seq), &ticket);
            if random.next() < 0.3 {
                continue; // the reply is lost
            }
            reply = Some(answer.expect("the next window, or the last one again"));
            old.push(window(seq));
            seq += 1;
        }
        assert_eq!(reply.as_ref(), Some(&undisturbed), "seed {seed}");
    }
}
