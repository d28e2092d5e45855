//! One drives: others are refused at once, and the run holds for the next one when it is gone.

use crate::setup::{
    KEY, MS, Served, WINDOW, attach, lockstep, once_free, patient, shaking, step, times,
    undisturbed, wait_for,
};
use ballast::cancel::StopReason;
use ballast_protocol::lockstep::{ComponentState, ErrorCode, WindowKind};
use ballast_protocol::messages::AdvanceRequest;
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Connection, Error, HEARTBEAT_INTERVAL, Server, SessionConfig};
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

#[test]
fn a_second_owner_is_told_who_drives() {
    let served = Served::new();
    let mut client = served.client();
    for _ in 0..times(100) {
        let busy = attach(&served.link()).err().expect("someone drives");
        let fault = busy.request_error().unwrap_or_else(|| panic!("{busy}"));
        assert_eq!((fault.code, fault.owner.as_deref()), (ErrorCode::Busy, Some(client.id())));
        assert!(fault.since_ms.is_some());
        step(&mut client).unwrap();
    }
    let windows = times(100);
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}

#[test]
fn a_second_owner_is_told_who_drives_also_while_a_window_is_computed() {
    let (served, is_let_go) = Served::dawdling();
    let observer = Connection::open(KEY, &served.link(), patient()).unwrap();
    let mut client = served.client();
    // More than a minute, unless it is let go.
    let t1 = 1500 * MS;
    let long = AdvanceRequest { motions: shaking(0, t1), ..client.next_request(t1) };
    let computing =
        std::thread::spawn(move || client.send(WindowKind::Advance, long).map(|_| client));
    let progress = wait_for(|| observer.status(), ComponentState::Running).progress.unwrap();
    // Unknown before the first step.
    assert_eq!(progress.remaining_ms.is_none(), progress.step == 0, "{progress:?}");
    let begin = Instant::now();
    let busy = attach(&served.link()).err().expect("someone drives");
    assert_eq!(busy.request_error().unwrap().code, ErrorCode::Busy, "{busy}");
    assert!(begin.elapsed() < Duration::from_secs(1), "{:?}", begin.elapsed());
    assert_eq!(
        observer.status().unwrap().state,
        ComponentState::Running,
        "it waited for the window"
    );
    is_let_go.store(true, Ordering::SeqCst);
    let client = computing.join().unwrap().unwrap();
    assert_eq!(client.position().now_ns, t1);
    client.detach().unwrap();
}

#[test]
fn when_an_owner_is_gone_the_next_one_goes_on() {
    let served = Served::new();
    let mut run = None;
    let windows = times(40);
    for _ in 0..windows {
        // The old token may not be gone yet.
        let next = || Client::attach(KEY, &served.link(), "next", run.as_deref(), patient());
        let mut client = once_free(next, Duration::from_secs(5));
        run = Some(client.position().run_id.clone());
        step(&mut client).unwrap();
        // Dropped without a word.
    }
    let lockstep = served.stop();
    assert_eq!(lockstep.position().hash, undisturbed(windows)[windows as usize - 1]);
    assert_eq!(lockstep.computed_windows(), windows);
}

#[test]
fn a_window_without_end_does_not_outlive_its_owner_for_long() {
    let served = Served::new();
    let observer = Connection::open(KEY, &served.link(), patient()).unwrap();
    let mut client = served.client();
    // 58 years of simulated time.
    let given_up = client.connection().cancel.clone();
    let forever = AdvanceRequest {
        motions: vec![],
        ..client.next_request(i64::MAX as u64 / 5 / WINDOW * WINDOW)
    };
    let computing =
        std::thread::spawn(move || client.send(WindowKind::Advance, forever).unwrap_err());
    wait_for(|| observer.status(), ComponentState::Running);
    given_up.cancel(StopReason::Cancel);
    let error = computing.join().unwrap();
    assert!(matches!(error, Error::Cancelled { .. }), "{error}");
    let begin = Instant::now();
    let mut next = once_free(|| attach(&served.link()), 20 * HEARTBEAT_INTERVAL);
    assert!(begin.elapsed() > 8 * HEARTBEAT_INTERVAL, "an owner has no time to come back");
    step(&mut next).unwrap();
    assert_eq!(next.position().hash, undisturbed(1)[0]);
    assert_eq!(served.stop().computed_windows(), 1);
}

#[test]
fn another_run_is_not_taken_up() {
    let served = Served::new();
    let error =
        Client::attach(KEY, &served.link(), "test", Some("run-0"), patient()).err().unwrap();
    assert_eq!(error.request_error().unwrap().code, ErrorCode::WrongRun, "{error}");
    assert!(error.to_string().contains("run-1"), "{error}");
}

#[test]
fn a_number_is_known_with_its_owner_its_verb_and_its_content() {
    let served = Served::new();
    let stranger = crate::hostile::Stranger::at(&served.link());
    let take = |client: &str| {
        let token = stranger.come_alive(client);
        let ask = format!("{{\"client\": \"{client}\"}}");
        let number = format!(";0123456789abcdef of {client}");
        let attached = stranger.ask("attach", ask.as_bytes(), Some(&number)).unwrap();
        // AdvanceInputs again under its number: the same ticket. Under one that others guess, nothing.
        assert_eq!(stranger.ask("attach", ask.as_bytes(), Some(&number)).unwrap(), attached);
        for guess in [";0", "", ";0123456789abcde"] {
            let fault = stranger.ask("attach", ask.as_bytes(), Some(guess)).unwrap_err();
            assert_eq!(fault.code, ErrorCode::Busy, "{guess:?}: {fault}");
        }
        let attached: serde_json::Value = serde_json::from_slice(&attached).unwrap();
        (token, attached["ticket"].as_str().unwrap().to_string())
    };
    let (alice, ticket) = take("alice");
    let pass = format!("{ticket};1");
    stranger.ask("save", br#"{"name": "here"}"#, Some(&pass)).unwrap();
    for (verb, text, code) in [
        ("restore", r#"{"name": "nowhere"}"#, ErrorCode::UnknownState),
        ("save", r#"{"name": ""}"#, ErrorCode::Malformed),
        ("drop", r#"{"name": "nowhere"}"#, ErrorCode::UnknownState),
    ] {
        let fault = stranger.ask(verb, text.as_bytes(), Some(&pass)).unwrap_err();
        assert_eq!(fault.code, code, "{verb}: {fault}");
    }
    // Dropped once, though asked for twice.
    for _ in 0..2 {
        stranger.ask("drop", br#"{"name": "here"}"#, Some(&pass)).unwrap();
    }
    stranger.ask("detach", b"", Some(&format!("{ticket};2"))).unwrap();
    drop(alice);
    let (_bob, other) = take("bob");
    assert_ne!(ticket, other);
    stranger.ask("save", br#"{"name": "here"}"#, Some(&other)).unwrap();
    stranger.ask("detach", b"", Some(&other)).unwrap();
    // The same request as before the others: its ticket of then is worth nothing.
    let (_alice, again) = take("alice");
    assert_ne!(ticket, again);
    stranger.ask("save", br#"{"name": "here"}"#, Some(&again)).unwrap();
}

#[test]
fn a_window_that_is_asked_for_without_the_ticket_is_refused_and_not_computed() {
    let served = Served::new();
    let mut client = served.client();
    step(&mut client).unwrap();
    let stranger = crate::hostile::Stranger::at(&served.link());
    let t0 = client.position().now_ns;
    let next =
        AdvanceRequest { motions: shaking(t0, t0 + WINDOW), ..client.next_request(t0 + WINDOW) };
    let text = ballast_protocol::to_json(&next).unwrap();
    for ticket in ["", "0123456789abcdef0123456789abcdef", ";;;", &"x".repeat(1000)] {
        for verb in
            ["advance", "redo", "save", "restore", "drop", "reset", "init", "detach", "shutdown"]
        {
            let payload =
                if matches!(verb, "advance" | "redo") { &text[..] } else { "{\"name\":\"x\"}" };
            let fault = stranger.ask(verb, payload.as_bytes(), Some(ticket)).unwrap_err();
            let expected =
                if ticket.len() > 200 { ErrorCode::TooLarge } else { ErrorCode::NotOwner };
            assert_eq!(fault.code, expected, "{verb}: {fault}");
        }
    }
    assert_eq!(client.status().unwrap().position, *client.position());
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(2)[1]);
}

#[test]
fn an_owner_that_leaves_does_not_wait_for_the_end_of_its_window() {
    let (served, _is_let_go) = Served::dawdling();
    let stranger = crate::hostile::Stranger::at(&served.link());
    let (_token, ticket, run_id) = stranger.attach();
    // Hours of dawdling.
    let (sender, answer) = channel();
    stranger.ask_for_long(100_000, run_id, &ticket, move |fault| drop(sender.send(fault)));
    let line = Connection::open(KEY, &served.link(), patient()).unwrap();
    wait_for(|| line.status(), ComponentState::Running);
    // What is refused ends no window.
    let fault = stranger.ask("detach", b"{\"client\": \"raw\"}", Some(&ticket)).unwrap_err();
    assert_eq!(fault.code, ErrorCode::Malformed, "{fault}");
    assert!(answer.recv_timeout(Duration::from_millis(300)).is_err(), "it is computed still");
    stranger.ask("detach", b"{}", Some(&ticket)).unwrap();
    let fault = answer.recv_timeout(Duration::from_secs(20)).expect("an answer");
    let fault = fault.expect("rolled back");
    assert!(fault.code == ErrorCode::NotOwner && fault.message.contains("detached"), "{fault}");
    // As if it had never been asked for; and the next one has its windows to itself.
    let client = served.client();
    assert_eq!((client.position().seq, client.position().now_ns), (0, 0));
}

#[test]
fn a_key_has_one_component_that_others_can_see() {
    let served = Served::new();
    let mut client = served.client();
    let here = SessionConfig::listen_on(free_endpoint().unwrap());
    let link = SessionConfig { connect: vec![served.endpoint.clone()], ..here };
    let second = Server::open(KEY, &link).unwrap();
    let refused = second.run(lockstep(), &mut ()).err().expect("the key is taken").to_string();
    assert!(refused.contains(KEY) && refused.contains("by run run-1"), "{refused}");
    step(&mut client).unwrap();
}

#[test]
fn an_owner_is_known_however_many_others_are_alive() {
    let served = Served::new();
    let stranger = crate::hostile::Stranger::at(&served.link());
    let _others: Vec<_> = (0..1005).map(|k| stranger.come_alive(&format!("other-{k}"))).collect();
    std::thread::sleep(Duration::from_millis(500));
    let mut client = served.client();
    for _ in 0..5 {
        step(&mut client).unwrap();
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(client.status().unwrap().owner.as_deref(), Some(client.id()));
    // It can be gone all the same.
    drop(client);
    let next = once_free(|| attach(&served.link()), Duration::from_secs(5));
    assert_eq!(next.position().seq, 5);
}
