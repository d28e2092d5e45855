//! SavedState states, the parameters that go with them, and checkpoints.

use crate::{MS, ask, attach, lockstep, shaken, straight, window};
use ballast_protocol::lockstep::WindowKind::{Advance, Redo};
use ballast_protocol::lockstep::{ErrorCode, ParameterUpdate, ResumeInfo, SavedState, StateName};
use ballast_protocol::messages::{AdvanceRequest, ReplyStatus};
use std::sync::Arc;

#[test]
fn states_are_kept_by_name() {
    let (mut lockstep, ticket) = lockstep();
    ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
    let name = StateName { name: "after-1".into() };
    let kept = lockstep.save(&name, &ticket).unwrap();
    let second = ask(&mut lockstep, Advance, &window(2), &ticket).unwrap();
    let back = lockstep.restore(&name, &ticket).unwrap();
    assert_eq!((back.now_ns, &back.hash, back.seq), (kept.now_ns, &kept.hash, 2));
    // Numbers continue; the last window is not there to be redone or asked for again.
    assert_eq!(
        ask(&mut lockstep, Redo, &window(2), &ticket).unwrap_err().code,
        ErrorCode::NothingToRedo
    );
    let again = AdvanceRequest { seq: 3, ..window(2) };
    let reply = ask(&mut lockstep, Advance, &again, &ticket).unwrap();
    assert_eq!((reply.hash, reply.seq), (second.hash, 3));
    lockstep.drop_state(&name, &ticket).unwrap();
    let fault = lockstep.restore(&name, &ticket).unwrap_err();
    assert!(fault.code == ErrorCode::UnknownState && fault.message.contains("after-1"), "{fault}");
    for bad in ["", "a/b", "ü", &"x".repeat(201)] {
        let fault = lockstep.save(&StateName { name: bad.into() }, &ticket).unwrap_err();
        assert_eq!(fault.code, ErrorCode::Malformed, "{fault}");
    }
    for k in 0..64 {
        lockstep.save(&StateName { name: format!("s{k}") }, &ticket).unwrap();
    }
    assert_eq!(lockstep.save(&name, &ticket).unwrap_err().code, ErrorCode::TooManyStates);
    lockstep.save(&StateName { name: "s3".into() }, &ticket).unwrap();
    let fresh = lockstep.reset("run-2".into(), &ticket, 0).unwrap();
    assert_eq!((fresh.run_id.as_str(), fresh.seq, fresh.now_ns), ("run-2", 0, 0));
    assert_eq!(lockstep.restore(&name, &ticket).unwrap_err().code, ErrorCode::UnknownState);
    let first = AdvanceRequest { run_id: "run-2".into(), ..window(1) };
    assert_eq!(ask(&mut lockstep, Advance, &first, &ticket).unwrap().hash, straight(1).hash);
}

#[test]
fn states_of_clients_that_are_gone_make_room() {
    let (mut lockstep, mut ticket) = lockstep();
    let named = |client: usize, k: usize| StateName { name: format!("{client}-{k}") };
    for client in 1..=70 {
        lockstep.save(&named(client, 1), &ticket).unwrap();
        lockstep.save(&named(client, 2), &ticket).unwrap();
        lockstep.detach(&ticket).unwrap();
        ticket = attach(&mut lockstep, &format!("client-{client}")).unwrap();
    }
    // The last ones are still there, for whoever comes next.
    lockstep.restore(&named(70, 1), &ticket).unwrap();
    lockstep.restore(&named(39, 1), &ticket).unwrap();
    assert_eq!(lockstep.restore(&named(38, 2), &ticket).unwrap_err().code, ErrorCode::UnknownState);
    // A connected client keeps its states and gets an error when there are too many.
    (0..64).for_each(|k| drop(lockstep.save(&named(0, k), &ticket).unwrap()));
    assert_eq!(lockstep.save(&named(0, 64), &ticket).unwrap_err().code, ErrorCode::TooManyStates);
    lockstep.restore(&named(0, 0), &ticket).unwrap();
}

#[test]
fn parameters_are_the_owners_to_set_and_go_with_kept_states() {
    // Long enough for the stones to fall onto the floor.
    let long = |seq: u64, deadline_ms: u32| {
        let mut request = AdvanceRequest { seq, t1_ns: 100 * MS, deadline_ms, ..window(1) };
        request.motions[0].knots = (0..=20).map(|k| shaken::floor(k * 5 * MS)).collect();
        request
    };
    let (mut other, ticket) = lockstep();
    let usually = ask(&mut other, Advance, &long(1, 0), &ticket).unwrap().hash;
    let (mut lockstep, ticket) = lockstep();
    let name = StateName { name: "usual".into() };
    lockstep.save(&name, &ticket).unwrap();
    let hasty =
        ParameterUpdate { max_iterations: Some(2), tolerance: Some(0.0), ..Default::default() };
    let fault = lockstep.set_parameters(&hasty, "ticket of other").unwrap_err();
    assert_eq!(fault.code, ErrorCode::NotOwner);
    for bad in [
        ParameterUpdate { max_iterations: Some(0), ..Default::default() },
        ParameterUpdate { tolerance: Some(-1.0), ..Default::default() },
        ParameterUpdate { max_penetration: Some(-1e-3), ..Default::default() },
    ] {
        let fault = lockstep.set_parameters(&bad, &ticket).unwrap_err();
        assert_eq!(fault.code, ErrorCode::ParameterInvalid, "{fault}");
        assert_eq!(lockstep.component().parameters().iterations, 50);
    }
    lockstep.set_parameters(&hasty, &ticket).unwrap();
    let reply = ask(&mut lockstep, Advance, &long(1, 0), &ticket).unwrap();
    assert!(reply.solver.iterations <= 200, "{:?}", reply.solver);
    assert_ne!(reply.hash, usually);
    // The window again, as well as usual.
    let usual =
        ParameterUpdate { max_iterations: Some(50), tolerance: Some(1e-4), ..Default::default() };
    lockstep.set_parameters(&usual, &ticket).unwrap();
    // A lost reply is still a lost reply; a redo of the same content is computed, once.
    let again = ask(&mut lockstep, Advance, &long(1, 0), &ticket).unwrap();
    assert_eq!(again.hash, reply.hash);
    let redone = ask(&mut lockstep, Redo, &long(1, 0), &ticket).unwrap();
    assert_eq!(redone.hash, usually);
    let count = lockstep.computed_windows();
    assert_eq!(ask(&mut lockstep, Redo, &long(1, 0), &ticket).unwrap(), redone);
    assert_eq!(lockstep.computed_windows(), count);
    // The penetration that is allowed is in no hash.
    let strict = ParameterUpdate { max_penetration: Some(1e-12), ..Default::default() };
    lockstep.set_parameters(&strict, &ticket).unwrap();
    let refused = ask(&mut lockstep, Redo, &long(1, 0), &ticket).unwrap();
    assert_eq!(refused.status, ReplyStatus::Discard);
    let generous = ParameterUpdate { max_penetration: Some(1.0), ..Default::default() };
    lockstep.set_parameters(&generous, &ticket).unwrap();
    assert_eq!(ask(&mut lockstep, Redo, &long(1, 0), &ticket).unwrap().hash, usually);
    lockstep.set_parameters(&hasty, &ticket).unwrap();
    lockstep.restore(&name, &ticket).unwrap();
    let reply = ask(&mut lockstep, Advance, &long(2, 0), &ticket).unwrap();
    assert_eq!(reply.hash, usually);
    lockstep.set_parameters(&hasty, &ticket).unwrap();
    lockstep.reset("run-2".into(), &ticket, 0).unwrap();
    let first = AdvanceRequest { run_id: "run-2".into(), ..long(1, 0) };
    assert_eq!(ask(&mut lockstep, Advance, &first, &ticket).unwrap().hash, usually);
}

#[test]
fn a_checkpoint_knows_who_has_driven_and_what_an_answer_is_worth() {
    let (mut first, ticket) = lockstep();
    let strict = ParameterUpdate { max_penetration: Some(1e-12), ..Default::default() };
    first.set_parameters(&strict, &ticket).unwrap();
    // Until the stones lie on each other.
    let mut windows = (1..40).map(|seq| ask(&mut first, Advance, &window(seq), &ticket).unwrap());
    let refused =
        windows.find(|reply| reply.status == ReplyStatus::Discard).expect("it is pressed");
    let last = window(refused.seq);
    // In no hash.
    first
        .set_parameters(&ParameterUpdate { max_penetration: Some(0.0), ..strict }, &ticket)
        .unwrap();
    let (mut second, driver) = lockstep();
    second.detach(&driver).unwrap();
    second
        .resume("run-1", last.seq, SavedState::of(first.component()), first.resume_info())
        .unwrap();
    let ticket = attach(&mut second, "another").unwrap();
    assert_eq!(second.resume_info().owner_count, 2);
    // Not the old answer: it held under another limit.
    let redo = ask(&mut second, Redo, &last, &ticket).unwrap_err();
    assert_eq!(redo.code, ErrorCode::NothingToRedo, "{redo}");
    // A retry of what was asked then is answered as it was.
    assert_eq!(ask(&mut second, Advance, &last, &ticket).unwrap(), refused);
}

#[test]
fn a_run_is_taken_up_from_its_checkpoint() {
    let (mut first, ticket) = lockstep();
    for seq in 1..=3 {
        ask(&mut first, Advance, &window(seq), &ticket).unwrap();
    }
    first.note_durable();
    assert_eq!(first.status(0).durable_seq, 3);
    let kept = SavedState::of(first.component());
    let (mut second, ticket) = lockstep();
    second.resume("run-1", 3, kept, first.resume_info()).unwrap();
    assert_eq!(second.position(), first.position());
    // The last window was answered by a process that is gone; a retry is answered all the same.
    assert_eq!(ask(&mut second, Advance, &window(3), &ticket).unwrap(), straight(3));
    assert_eq!(second.computed_windows(), 0);
    // How it began is not known to this one.
    let redo = AdvanceRequest { motions: vec![], ..window(3) };
    let fault = ask(&mut second, Redo, &redo, &ticket).unwrap_err();
    assert_eq!(fault.code, ErrorCode::NothingToRedo, "{fault}");
    assert_eq!(ask(&mut second, Advance, &window(4), &ticket).unwrap(), straight(4));
    // Nor is a state taken up that is none of this model's.
    let mut foreign = SavedState::of(first.component());
    Arc::make_mut(&mut foreign.state).velocity.pop();
    let fault = second.resume("run-1", 3, foreign, ResumeInfo::default()).unwrap_err();
    assert_eq!(fault.code, ErrorCode::StateInvalid, "{fault}");
    assert_eq!(second.position().seq, 4);
}
