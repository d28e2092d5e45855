//! Ownership, and requests before the bed is prepared.

use crate::{MS, ask, attach, component, hash, lockstep, straight, window};
use ballast_protocol::lockstep::WindowKind::Advance;
use ballast_protocol::lockstep::{
    AttachRequest, ComponentState, ErrorCode, Lockstep, ParameterUpdate, RequestError, StateName,
};
use ballast_protocol::messages::AdvanceRequest;

#[test]
fn one_drives_and_others_cannot() {
    let (mut lockstep, ticket) = lockstep();
    let busy = attach(&mut lockstep, "other").unwrap_err();
    assert_eq!((busy.code, busy.owner.as_deref()), (ErrorCode::Busy, Some("driver")));
    let before = lockstep.position();
    let name = StateName { name: "here".into() };
    for wrong in ["", "ticket", "ticket of other"] {
        let faults = [
            ask(&mut lockstep, Advance, &window(1), wrong).unwrap_err(),
            lockstep.reset("run-2".into(), wrong, 0).unwrap_err(),
            lockstep.save(&name, wrong).unwrap_err(),
            lockstep.restore(&name, wrong).unwrap_err(),
            lockstep.drop_state(&name, wrong).unwrap_err(),
            lockstep.detach(wrong).unwrap_err(),
            lockstep.shut_down(wrong).unwrap_err(),
        ];
        assert!(faults.iter().all(|f| f.code == ErrorCode::NotOwner), "{faults:?}");
        let found = if wrong.is_empty() { "none" } else { "another" };
        let is_told = |f: &RequestError| {
            f.details.as_ref().is_some_and(|f| (&f.place[..], &f.found[..]) == ("ticket", found))
        };
        assert!(faults.iter().all(is_told), "{faults:?}");
        assert!(!format!("{faults:?}").contains("ticket of driver"), "the ticket stays secret");
    }
    assert_eq!(lockstep.position(), before);
    // The owner's own client that has lost its line shows its ticket and gets a new one.
    let again =
        AttachRequest { client: "driver".into(), run_id: None, ticket: Some(ticket.clone()) };
    let fresh = lockstep.attach(&again, "fresh".into(), 2000).unwrap().ticket;
    assert_eq!(lockstep.detach(&ticket).unwrap_err().code, ErrorCode::NotOwner);
    ask(&mut lockstep, Advance, &window(1), &fresh).unwrap();
    // After the disconnection another client continues the run.
    assert!(!lockstep.client_disconnected("other") && lockstep.client_disconnected("driver"));
    assert_eq!(
        ask(&mut lockstep, Advance, &window(2), &fresh).unwrap_err().code,
        ErrorCode::NotOwner
    );
    let wrong =
        AttachRequest { client: "other".into(), run_id: Some("run-9".into()), ticket: None };
    assert_eq!(lockstep.attach(&wrong, "t".into(), 0).unwrap_err().code, ErrorCode::WrongRun);
    let right = AttachRequest { run_id: Some("run-1".into()), ..wrong };
    let attached = lockstep.attach(&right, "t".into(), 0).unwrap();
    assert_eq!((attached.position.seq, attached.position.now_ns), (1, 5 * MS as u64));
    assert_eq!(ask(&mut lockstep, Advance, &window(2), "t").unwrap(), straight(2));
}

#[test]
fn what_is_not_configured_waits_for_init_and_keeps_its_owner() {
    let mut lockstep = Lockstep::unconfigured(hash).unwrap();
    let ticket = attach(&mut lockstep, "driver").unwrap();
    let status = lockstep.status(0);
    assert_eq!(status.state, ComponentState::Unconfigured);
    assert_eq!(status.waiting_for.as_deref(), Some("init from driver"));
    let request = AdvanceRequest { run_id: "unconfigured".into(), ..window(1) };
    let name = StateName { name: "here".into() };
    for fault in [
        ask(&mut lockstep, Advance, &request, &ticket).unwrap_err(),
        lockstep.save(&name, &ticket).unwrap_err(),
        lockstep.reset("run-1".into(), &ticket, 0).unwrap_err(),
        lockstep.set_parameters(&ParameterUpdate::default(), &ticket).unwrap_err(),
    ] {
        assert_eq!(fault.code, ErrorCode::Unconfigured, "{fault}");
    }
    assert_eq!(lockstep.check_init("ticket of other").unwrap_err().code, ErrorCode::NotOwner);
    lockstep.check_init(&ticket).unwrap();
    let place = lockstep.begin_run(component(), "run-1".into(), 0);
    assert_eq!((place.run_id.as_str(), place.seq, place.now_ns), ("run-1", 0, 0));
    assert_eq!(lockstep.status(0).state, ComponentState::Idle);
    assert_eq!(ask(&mut lockstep, Advance, &window(1), &ticket).unwrap(), straight(1));
    // Prepared again: a new run without anything of the old one.
    lockstep.save(&name, &ticket).unwrap();
    lockstep.begin_run(component(), "run-2".into(), 0);
    assert_eq!(lockstep.restore(&name, &ticket).unwrap_err().code, ErrorCode::UnknownState);
    let first = AdvanceRequest { run_id: "run-2".into(), ..window(1) };
    assert_eq!(ask(&mut lockstep, Advance, &first, &ticket).unwrap().hash, straight(1).hash);
}

#[test]
fn a_component_that_quits_computes_nothing_more() {
    let (mut lockstep, ticket) = lockstep();
    lockstep.shut_down(&ticket).unwrap();
    assert_eq!(lockstep.status(0).state, ComponentState::ShuttingDown);
    assert_eq!(
        ask(&mut lockstep, Advance, &window(1), &ticket).unwrap_err().code,
        ErrorCode::ShuttingDown
    );
    assert_eq!(attach(&mut lockstep, "other").unwrap_err().code, ErrorCode::ShuttingDown);
}
