//! Windows of a run that survive a crash, according to lockstep.

#[path = "../../../tests/common/mod.rs"]
mod common;

use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_protocol::lockstep::{
    AttachRequest, ErrorCode, Lockstep, ParameterUpdate, RequestError, StateName, WindowKind,
};
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, DeadlinePolicy, Digest, ReplyStatus,
};
use std::ops::ControlFlow;
use std::sync::Arc;

const MS: i64 = 1_000_000;
const TICKET: &str = "ticket";

fn hash(_: &Model, state: &State) -> u128 {
    u128::from_be_bytes(Digest::of(format!("{state:?}").as_bytes()).0)
}

/// Falling grains after some windows, all of which are in a checkpoint.
fn kept(windows: u64) -> Lockstep {
    let scene = common::heap::falling(2, MS as u64).scheduled(Schedule::Synchronous, [2, 1, 1]);
    let component = Component::new(Arc::new(scene.model), scene.state, Limits::default());
    let mut lockstep = Lockstep::new(component.expect("a scene"), "run-1", hash);
    let ask = AttachRequest { client: "driver".into(), ..AttachRequest::default() };
    lockstep.attach(&ask, TICKET.into(), 0).expect("there is no owner yet");
    for seq in 1..=windows {
        window(&mut lockstep, WindowKind::Advance, &request(seq)).expect("a good window");
    }
    lockstep.note_durable();
    assert_eq!(lockstep.durable_seq(), windows);
    lockstep
}

fn request(seq: u64) -> AdvanceRequest {
    let (t0_ns, t1_ns) = ((seq as i64 - 1) * MS, seq as i64 * MS);
    AdvanceRequest { run_id: "run-1".into(), seq, t0_ns, t1_ns, ..AdvanceRequest::default() }
}

fn window(
    lockstep: &mut Lockstep,
    kind: WindowKind,
    request: &AdvanceRequest,
) -> Result<AdvanceReply, RequestError> {
    lockstep.window(kind, request, TICKET, &|| 0, &mut |_| ControlFlow::Continue(()))
}

#[test]
fn a_window_that_leads_elsewhere_now_is_not_said_to_survive() {
    let mut lockstep = kept(3);
    // Requested with other parameters, so that it is computed.
    let again = AdvanceRequest { deadline_ms: 60_000, ..request(3) };
    window(&mut lockstep, WindowKind::Redo, &again).unwrap();
    assert_eq!(lockstep.durable_seq(), 2);
    lockstep.note_durable();
    // From memory: nothing was computed.
    window(&mut lockstep, WindowKind::Redo, &again).unwrap();
    assert_eq!(lockstep.durable_seq(), 3);
    // A window after the checkpoint is none of its.
    window(&mut lockstep, WindowKind::Advance, &request(4)).unwrap();
    window(&mut lockstep, WindowKind::Redo, &AdvanceRequest { deadline_ms: 1, ..request(4) })
        .unwrap();
    assert_eq!(lockstep.durable_seq(), 3);
}

#[test]
fn neither_is_a_state_that_was_left_nor_one_with_other_parameters() {
    let mut lockstep = kept(2);
    let name = StateName { name: "here".into() };
    lockstep.save(&name, TICKET).unwrap();
    window(&mut lockstep, WindowKind::Advance, &request(3)).unwrap();
    lockstep.note_durable();
    lockstep.restore(&name, TICKET).unwrap();
    assert_eq!((lockstep.position().seq, lockstep.durable_seq()), (3, 2));
    let mut lockstep = kept(2);
    let set =
        |iterations| ParameterUpdate { max_iterations: Some(iterations), ..Default::default() };
    lockstep.set_parameters(&set(7), TICKET).unwrap();
    assert_eq!(lockstep.durable_seq(), 1);
    lockstep.note_durable();
    lockstep.set_parameters(&set(7), TICKET).unwrap();
    assert_eq!(lockstep.durable_seq(), 2, "as they were");
}

#[test]
fn a_window_without_time_that_may_be_discarded_takes_its_number_and_no_more() {
    let mut lockstep = kept(2);
    let before = lockstep.position();
    let nothing = AdvanceRequest { t1_ns: 2 * MS, ..request(3) };
    let fault = window(&mut lockstep, WindowKind::Advance, &nothing).unwrap_err();
    assert_eq!(fault.code, ErrorCode::TimeGrid, "{fault}");
    let nothing = AdvanceRequest { deadline_policy: DeadlinePolicy::Discard, ..nothing };
    let reply = window(&mut lockstep, WindowKind::Advance, &nothing).unwrap();
    assert_eq!((reply.status, reply.seq, reply.t1_ns), (ReplyStatus::Discard, 3, 2 * MS));
    assert_eq!(reply.hash.to_string(), before.hash);
    assert_eq!(window(&mut lockstep, WindowKind::Advance, &nothing).unwrap(), reply);
    // There is nothing in it to be done again, nor is it the window before.
    for again in [nothing, request(2), AdvanceRequest { seq: 3, ..request(2) }] {
        let fault = window(&mut lockstep, WindowKind::Redo, &again).err();
        assert!(
            fault.is_none_or(|f| matches!(
                f.code,
                ErrorCode::NothingToRedo | ErrorCode::OutOfSequence
            ))
        );
    }
    assert_eq!(lockstep.position().hash, before.hash);
    let next = AdvanceRequest { seq: 4, ..request(3) };
    let reply = window(&mut lockstep, WindowKind::Advance, &next).unwrap();
    assert_eq!(reply.hash, window(&mut kept(2), WindowKind::Advance, &request(3)).unwrap().hash);
}
