//! The order of windows: numbers, retries, redos, and a line that loses and repeats.

use crate::common::scene::Random;
use crate::{MS, ask, lockstep, straight, window};
use ballast_protocol::lockstep::ErrorCode;
use ballast_protocol::lockstep::WindowKind::{Advance, Redo};
use ballast_protocol::messages::{AdvanceRequest, ReplyStatus};
use std::ops::ControlFlow;

#[test]
fn a_retry_is_answered_from_memory_and_computes_nothing() {
    let (mut lockstep, ticket) = lockstep();
    let first = ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
    assert!(
        matches!(first.status, ReplyStatus::Ok | ReplyStatus::Warn) && first.steps == 5,
        "{first:?}"
    );
    let mut steps = 0;
    let again = lockstep.window(Advance, &window(1), &ticket, &|| 0, &mut |_| {
        steps += 1;
        ControlFlow::Continue(())
    });
    assert_eq!((again.unwrap(), steps), (first.clone(), 0));
    assert_eq!(lockstep.computed_windows(), 1);
    assert_eq!(lockstep.position().hash, first.hash.to_string());
    assert_eq!(lockstep.component().now_ns(), 5 * MS as u64);
}

#[test]
fn what_is_out_of_sequence_is_told_the_number_and_changes_nothing() {
    let (mut lockstep, ticket) = lockstep();
    let redo = ask(&mut lockstep, Redo, &window(0), &ticket).unwrap_err();
    assert_eq!((redo.code, redo.expected_seq), (ErrorCode::NothingToRedo, Some(0)));
    ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
    let before = lockstep.position();
    let late = AdvanceRequest { t0_ns: 4 * MS, ..window(2) };
    let other = AdvanceRequest { t1_ns: 4 * MS, ..window(1) };
    for wrong in [window(3), window(0), late, other, AdvanceRequest { seq: u64::MAX, ..window(2) }]
    {
        let fault = ask(&mut lockstep, Advance, &wrong, &ticket).unwrap_err();
        assert_eq!(fault.code, ErrorCode::OutOfSequence, "{fault}");
        assert_eq!((fault.expected_seq, fault.now_ns), (Some(2), Some(5 * MS as u64)));
        assert!(fault.message.contains("window 2 from 5000000 ns"), "{fault}");
        assert_eq!(lockstep.position(), before);
    }
    let run = AdvanceRequest { run_id: "run-0".into(), ..window(2) };
    let fault = ask(&mut lockstep, Advance, &run, &ticket).unwrap_err();
    assert!(fault.code == ErrorCode::WrongRun && fault.message.contains("run-0"), "{fault}");
}

#[test]
fn a_redo_takes_the_place_of_the_window() {
    let (mut lockstep, ticket) = lockstep();
    ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
    let first = ask(&mut lockstep, Advance, &window(2), &ticket).unwrap();
    let mut other = window(2);
    other.motions[0].knots[1].pose.position.z += 1e-4;
    let changed = ask(&mut lockstep, Redo, &other, &ticket).unwrap();
    assert_ne!(changed.hash, first.hash);
    assert_eq!((changed.seq, changed.t1_ns), (2, 10 * MS));
    // A retry of the redo is answered; the window itself is not the last one any more.
    assert_eq!(ask(&mut lockstep, Redo, &other, &ticket).unwrap(), changed);
    assert_eq!(
        ask(&mut lockstep, Advance, &window(2), &ticket).unwrap_err().code,
        ErrorCode::OutOfSequence
    );
    assert_eq!(ask(&mut lockstep, Redo, &window(2), &ticket).unwrap(), first);
    assert_eq!(ask(&mut lockstep, Advance, &window(3), &ticket).unwrap(), straight(3));
}

#[test]
fn a_redo_is_of_the_times_of_the_last_window() {
    let (mut lockstep, ticket) = lockstep();
    ask(&mut lockstep, Advance, &window(1), &ticket).unwrap();
    let asked = window(1);
    for (t0_ns, t1_ns) in
        [(asked.t0_ns, 2 * asked.t1_ns), (77 * MS, 3 * MS), (asked.t1_ns, 2 * asked.t1_ns)]
    {
        let other = AdvanceRequest { t0_ns, t1_ns, ..window(1) };
        let fault = ask(&mut lockstep, Redo, &other, &ticket).unwrap_err();
        assert_eq!(fault.code, ErrorCode::OutOfSequence);
        assert!(fault.to_string().contains("from 0 to"), "{fault}");
    }
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
                let _ = ask(&mut lockstep, Advance, &old[k], &ticket);
            }
            if random.next() < 0.2 {
                let _ = ask(&mut lockstep, Advance, &window(seq), "ticket of a stranger");
            }
            if random.next() < 0.3 {
                continue; // the request is lost
            }
            let answer = ask(&mut lockstep, Advance, &window(seq), &ticket);
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
