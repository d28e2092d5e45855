//! Refused requests and their errors.

use crate::{MS, ask, lockstep, window};
use ballast_protocol::lockstep::WindowKind::Advance;
use ballast_protocol::lockstep::{ErrorCode, ParameterUpdate, RequestError};
use ballast_protocol::messages::AdvanceRequest;

#[test]
fn bad_inputs_keep_the_number() {
    let (mut lockstep, ticket) = lockstep();
    let before = lockstep.position();
    let mut jump = window(1);
    jump.motions[0].knots[0].pose.position.x += 0.01;
    let mut unknown = window(1);
    unknown.motions[0].body = "flor".into();
    let mut turned = window(1);
    turned.motions[0].knots[1].pose.orientation.w = 2.0;
    let grid = AdvanceRequest { t1_ns: 5 * MS + 1, ..window(1) };
    let past = AdvanceRequest { t1_ns: -1, ..window(1) };
    for (bad, code) in [
        (jump, ErrorCode::InputJump),
        (unknown, ErrorCode::UnknownBody),
        (turned, ErrorCode::Malformed),
        (grid, ErrorCode::TimeGrid),
        (past, ErrorCode::Malformed),
    ] {
        let fault = ask(&mut lockstep, Advance, &bad, &ticket).unwrap_err();
        assert_eq!(fault.code, code, "{fault}");
        assert_eq!(lockstep.position(), before);
    }
    ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
}

/// The refusal of window 1 with a change.
fn refused(change: impl FnOnce(&mut AdvanceRequest)) -> RequestError {
    let (mut lockstep, ticket) = lockstep();
    let mut request = window(1);
    change(&mut request);
    let before = lockstep.position();
    let fault = ask(&mut lockstep, Advance, &request, &ticket).unwrap_err();
    assert_eq!(lockstep.position(), before, "{fault}");
    fault
}

#[test]
fn a_refusal_has_its_code_and_says_where_what_was_expected_and_found() {
    let cases = [
        (refused(|r| r.t1_ns += 1), ErrorCode::TimeGrid, "t1_ns", "5000001 ns"),
        (
            refused(|r| r.motions[0].knots[0].time_ns = MS),
            ErrorCode::InputGap,
            "floor",
            "from 1000000",
        ),
        (
            refused(|r| r.motions[0].knots[0].pose.position.x = 0.1),
            ErrorCode::InputJump,
            "floor",
            "m",
        ),
        (
            refused(|r| r.motions[0].knots[1].twist.linear.x = f64::NAN),
            ErrorCode::InputInvalid,
            "floor",
            "NaN",
        ),
        (refused(|r| r.motions[0].body = "door".into()), ErrorCode::UnknownBody, "body", "door"),
        (refused(|r| r.t1_ns = -1), ErrorCode::Malformed, "t1_ns", "-1"),
        (refused(|r| r.run_id = "run-0".into()), ErrorCode::WrongRun, "run_id", "run-0"),
        (refused(|r| r.seq = 5), ErrorCode::OutOfSequence, "seq", "window 5"),
    ];
    for (fault, code, place, found) in cases {
        assert_eq!(fault.code, code, "{fault}");
        let finding = fault.details.clone().unwrap_or_default();
        assert_eq!(finding.place, place, "{fault}");
        assert!(!finding.expected.is_empty() && finding.found.contains(found), "{finding:?}");
        let nearest = (code == ErrorCode::TimeGrid).then_some([5_000_000, 6_000_000]);
        assert_eq!(finding.nearest_ns, nearest);
        // As partners get it.
        let text = serde_json::to_string(&fault).unwrap();
        assert!(text.contains("\"place\"") && !text.contains("finding"), "{text}");
        assert_eq!(serde_json::from_str::<RequestError>(&text).unwrap(), fault);
    }
    let (mut lockstep, ticket) = lockstep();
    let deepest = ParameterUpdate { max_penetration: Some(-1.0), ..ParameterUpdate::default() };
    let fault = lockstep.set_parameters(&deepest, &ticket).unwrap_err();
    assert_eq!(fault.code, ErrorCode::ParameterInvalid, "{fault}");
    assert!(fault.details.is_some_and(|f| f.place.contains("penetration") && f.found == "-1"));
    // What was refused is not the last window that was computed.
    ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
    ask(&mut lockstep, Advance, &AdvanceRequest { t1_ns: 11 * MS + 1, ..window(2) }, &ticket)
        .unwrap_err();
    assert_eq!(lockstep.status(0).last_window.map(|cost| (cost.seq, cost.steps)), Some((1, 5)));
    // One without parts comes through, too.
    let plain = RequestError::new(ErrorCode::Busy, "someone drives");
    let text = serde_json::to_string(&plain).unwrap();
    assert_eq!(serde_json::from_str::<RequestError>(&text).unwrap(), plain);
}
