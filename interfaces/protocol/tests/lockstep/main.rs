//! Lockstep without a network: owners, sequences, retries, deadlines, failures, and a line that loses and
//! repeats.

#[path = "../../../../tests/common/mod.rs"]
mod common;
#[path = "../shaken/mod.rs"]
mod shaken;

mod endings;
mod order;
mod owners;
mod refusals;
mod states;

use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_protocol::lockstep::{AttachRequest, Lockstep, RequestError, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Digest};
use std::ops::ControlFlow;
use std::sync::Arc;

const MS: i64 = 1_000_000;

fn hash(_: &Model, state: &State) -> u128 {
    u128::from_be_bytes(Digest::of(format!("{state:?}").as_bytes()).0)
}

/// A heap on a floor that can be shaken.
fn component() -> Component {
    let mut scene = common::heap::falling(2, MS as u64).scheduled(Schedule::Synchronous, [2, 1, 1]);
    scene.model.solver.max_iterations = 50;
    scene.model.solver.tolerance = Some(1e-4);
    Component::new(Arc::new(scene.model), scene.state, Limits::default()).expect("a scene")
}

/// Its lockstep, and the ticket of its owner.
fn lockstep() -> (Lockstep, String) {
    let mut lockstep = Lockstep::new(component(), "run-1", hash);
    let ticket = attach(&mut lockstep, "driver").expect("there is no owner yet");
    (lockstep, ticket)
}

fn attach(lockstep: &mut Lockstep, client: &str) -> Result<String, RequestError> {
    let ask = AttachRequest { client: client.into(), ..AttachRequest::default() };
    lockstep.attach(&ask, format!("ticket of {client}"), 1000).map(|a| a.ticket)
}

/// Window `seq` of 5 ms, one after the other from 0.
fn window(seq: u64) -> AdvanceRequest {
    let t0_ns = (seq as i64 - 1) * 5 * MS;
    let t1_ns = t0_ns + 5 * MS;
    let motions = shaken::through(t0_ns, t1_ns);
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
) -> Result<AdvanceReply, RequestError> {
    lockstep.window(kind, request, ticket, &|| 0, &mut |_| ControlFlow::Continue(()))
}

/// The reply to windows 1 to `last`, one after the other.
fn straight(last: u64) -> AdvanceReply {
    let (mut lockstep, ticket) = lockstep();
    let replies =
        (1..=last).map(|seq| ask(&mut lockstep, WindowKind::Advance, &window(seq), &ticket));
    replies.last().expect("a window").expect("good windows")
}
