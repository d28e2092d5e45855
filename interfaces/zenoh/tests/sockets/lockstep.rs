//! Equality with the states of one process, and the effect of every request.

use crate::setup::{KEY, Served, WINDOW, lockstep, patient, shaking, step, undisturbed};
use ballast_protocol::lockstep::{ComponentState, ErrorCode, WindowKind};
use ballast_protocol::messages::{AdvanceRequest, DeadlinePolicy, ReplyStatus, Twist};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Connection, Error, Server, SessionConfig, Timeouts};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

#[test]
fn windows_of_a_millisecond_over_a_socket_give_the_states_of_one_process() {
    let served = Served::new();
    let mut client = served.client();
    for (k, expected) in undisturbed(60).iter().enumerate() {
        step(&mut client).unwrap();
        assert_eq!(&client.position().hash, expected, "window {}", k + 1);
    }
    let place = client.position().clone();
    client.detach().unwrap();
    let lockstep = served.stop();
    assert_eq!(lockstep.position(), place);
    assert_eq!(lockstep.computed_windows(), 60);
}

#[test]
fn a_component_says_what_it_is_and_what_it_waits_for() {
    let served = Served::new();
    let line = Connection::open(KEY, &served.link(), patient()).unwrap();
    // The thread that serves may not have got that far yet.
    let begin = Instant::now();
    let description = loop {
        match line.describe() {
            Ok(description) => break description,
            Err(error) => {
                assert_eq!(
                    error.request_error().map(|f| f.code),
                    Some(ErrorCode::Preparing),
                    "{error}"
                );
                assert!(begin.elapsed() < Duration::from_secs(20), "never ready");
            }
        }
    };
    assert_eq!((description.key.as_str(), description.step_ns), (KEY, WINDOW / 5));
    assert!(description.bodies.iter().any(|b| b.name == "floor" && b.dof_modes[2] == "prescribed"));
    let floor = description.bodies.iter().find(|b| b.name == "floor").unwrap();
    assert_eq!((floor.stiffness, floor.mass_kg), ([0.0; 6], None));
    assert_eq!(
        (description.continuity.distance_m, description.continuity.angular_velocity),
        (1e-6, 1e-3)
    );
    assert_eq!(description.parameters["schedule"], "synchronous");
    let status = line.status().unwrap();
    assert_eq!(status.state, ComponentState::Idle);
    assert_eq!(status.waiting_for.as_deref(), Some("an owner to attach"));
    let mut client = served.client();
    let reply = client.advance_to(WINDOW, shaking(0, WINDOW), vec![]).unwrap();
    // Where bodies are is where the last window has brought them, whoever asks.
    let now = line.describe().unwrap();
    let place = &now.bodies.iter().find(|b| b.name == "floor").unwrap().position;
    let moved = reply.bodies.iter().find(|b| b.body == "floor").unwrap().pose.position;
    assert_eq!(*place, moved);
    assert_ne!(*place, floor.position);
    let shaken = now.bodies.iter().find(|b| b.name == "floor").unwrap().twist;
    let last = shaking(0, WINDOW)[0].knots.last().unwrap().twist;
    assert_eq!((floor.twist, shaken), (Some(Twist::default()), Some(last)));
    let status = client.status().unwrap();
    let who = format!("window 2 from {}", client.id());
    assert_eq!((status.waiting_for, status.owner.as_deref()), (Some(who), Some(client.id())));
    assert_eq!(status.position, *client.position());
    let cost = status.last_window.expect("a window was computed");
    assert_eq!((cost.seq, cost.steps), (1, 5));
    let phases = cost.phases_ms.values().sum::<f64>();
    assert!(0.0 < cost.phases_ms["solve"] && phases <= cost.wall_time_ms, "{cost:?}");
    let first = status.waiting_since_ms.unwrap();
    std::thread::sleep(Duration::from_millis(60));
    assert!(client.status().unwrap().waiting_since_ms.unwrap() >= first + 50);
}

#[test]
fn what_is_asked_and_answered_is_what_the_published_schema_says() {
    use crate::hostile::Stranger;
    let served = Served::new();
    let stranger = Stranger::at(&served.link());
    let line = Connection::open(KEY, &served.link(), patient()).unwrap();
    let mut compiler = boon::Compiler::new();
    let url = "http://localhost/protocol.json";
    compiler.add_resource(url, line.schema().unwrap()).unwrap();
    let mut schemas = boon::Schemas::new();
    let mut check = |name: &str, bytes: &[u8]| {
        let index = compiler.compile(&format!("{url}#/$defs/{name}"), &mut schemas).unwrap();
        let value = serde_json::from_slice(bytes).unwrap();
        schemas.validate(&value, index).unwrap_or_else(|e| panic!("{name}: {e:#}\n{value:#}"));
        value
    };
    let _token = stranger.come_alive("raw");
    let ask = br#"{"client":"raw"}"#;
    check("attach.request", ask);
    let attached = check("attach.reply", &stranger.ask("attach", ask, None).unwrap());
    let ticket = attached["ticket"].as_str();
    let request = AdvanceRequest {
        run_id: attached["run_id"].as_str().unwrap().into(),
        seq: 1,
        t1_ns: WINDOW as i64,
        motions: shaking(0, WINDOW),
        record_steps: true,
        ..AdvanceRequest::default()
    };
    let text = ballast_protocol::to_json(&request).unwrap();
    check("advance.request", text.as_bytes());
    check("advance.reply", &stranger.ask("advance", text.as_bytes(), ticket).unwrap());
    for (verb, ask) in [
        ("save", &br#"{"name":"here"}"#[..]),
        ("restore", br#"{"name":"here"}"#),
        ("drop", br#"{"name":"here"}"#),
        ("param", br#"{"max_iterations":20}"#),
        ("reset", b"{}"),
        ("status", b"{}"),
        ("detach", b"{}"),
    ] {
        check(&format!("{verb}.request"), ask);
        check(&format!("{verb}.reply"), &stranger.ask(verb, ask, ticket).unwrap());
    }
    let fault = stranger.ask("advance", text.as_bytes(), ticket).unwrap_err();
    check("refusal", &serde_json::to_vec(&fault).unwrap());
    check("describe.reply", &serde_json::to_vec(&line.describe().unwrap()).unwrap());
}

#[test]
fn states_are_kept_and_taken_up_and_a_window_redone() {
    let served = Served::new();
    let mut client = served.client();
    let expected = undisturbed(3);
    step(&mut client).unwrap();
    client.save("one").unwrap();
    step(&mut client).unwrap();
    let second = client.position().clone();
    let ends = [WINDOW, 2 * WINDOW];
    let mut other = shaking(ends[0], ends[1]);
    other[0].knots[1].pose.position.z += 1e-4;
    let redone = client.redo(ends, other, vec![]).unwrap();
    assert_ne!(redone.hash.to_string(), second.hash);
    assert_eq!(client.restore("one").unwrap().hash, expected[0]);
    step(&mut client).unwrap();
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, expected[2]);
    client.drop_state("one").unwrap();
    let gone = client.restore("one").unwrap_err();
    assert_eq!(gone.request_error().unwrap().code, ErrorCode::UnknownState);
    let run = client.position().run_id.clone();
    let fresh = client.reset().unwrap().clone();
    assert_ne!(fresh.run_id, run);
    assert_eq!((fresh.seq, fresh.now_ns), (0, 0));
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, expected[0]);
    client.shut_down().unwrap();
    assert!(served.stop().status(0).state == ComponentState::ShuttingDown);
}

#[test]
fn a_window_comes_with_its_steps_where_that_is_asked_for() {
    let served = Served::new();
    let mut client = served.client();
    let next = client.next_request(WINDOW);
    let request = AdvanceRequest { motions: shaking(0, WINDOW), record_steps: true, ..next };
    let reply = client.send(WindowKind::Advance, request).unwrap();
    let floor = reply.step_series.bodies.iter().find(|b| b.body == "floor").unwrap();
    assert_eq!((reply.step_series.time_ns.len(), floor.impulse.len()), (5, 5));
    assert_eq!(client.position().hash, undisturbed(1)[0]);
}

#[test]
fn what_is_refused_says_why_and_changes_nothing() {
    let served = Served::new();
    let mut client = served.client();
    step(&mut client).unwrap();
    let before = client.position().clone();
    let mut unknown = shaking(WINDOW, 2 * WINDOW);
    unknown[0].body = "flor".into();
    let mut unwritten = shaking(WINDOW, 2 * WINDOW);
    unwritten[0].body = "flo\0r".into();
    let good = shaking(WINDOW, 2 * WINDOW);
    let next = client.next_request(2 * WINDOW);
    for (request, code, word) in [
        (AdvanceRequest { motions: unknown, ..next.clone() }, ErrorCode::UnknownBody, "flor"),
        (AdvanceRequest { motions: unwritten, ..next.clone() }, ErrorCode::Malformed, "advance: "),
        (
            AdvanceRequest { seq: 9, motions: good.clone(), ..next.clone() },
            ErrorCode::OutOfSequence,
            "9",
        ),
        (AdvanceRequest { run_id: "run-0".into(), ..next.clone() }, ErrorCode::WrongRun, "run-0"),
        (AdvanceRequest { t1_ns: next.t1_ns + 1, ..next.clone() }, ErrorCode::TimeGrid, "1000000"),
    ] {
        let error = client.send(WindowKind::Advance, request).unwrap_err();
        let fault = error.request_error().unwrap_or_else(|| panic!("{error}"));
        assert!(fault.code == code && error.to_string().contains(word), "{error}");
        assert_eq!((client.position(), client.has_pending()), (&before, false));
        assert_eq!(client.status().unwrap().position, before);
    }
    step(&mut client).unwrap();
    assert_eq!(client.position().hash, undisturbed(2)[1]);
}

#[test]
fn a_deadline_ends_a_window_and_a_late_reply_is_asked_for_again() {
    let (served, is_let_go) = Served::dawdling();
    let mut client = served.client();
    // Two thousand steps: 20 s, unless it is let go.
    let long = 400 * WINDOW;
    let motions = shaking(0, long);
    let request = AdvanceRequest {
        motions: motions.clone(),
        deadline_ms: 30,
        deadline_policy: DeadlinePolicy::Early,
        ..client.next_request(long)
    };
    let early = client.send(WindowKind::Advance, request).unwrap();
    assert!(
        early.status == ReplyStatus::Early && early.t1_ns > 0 && early.t1_ns < long as i64,
        "{early:?}"
    );
    // To the end, but the client does not wait for it: slow, not lost; asking again gets the answer.
    client.reset().unwrap();
    let hasty = Timeouts { deadline_margin: Duration::ZERO, ..patient() };
    let run = client.position().run_id.clone();
    client.detach().unwrap();
    let mut client = Client::attach(KEY, &served.link(), "hasty", Some(&run), hasty).unwrap();
    let request =
        Arc::new(AdvanceRequest { motions, deadline_ms: 30, ..client.next_request(long) });
    let begin = Instant::now();
    let mut late = 0;
    let whole = loop {
        match client.send(WindowKind::Advance, Arc::clone(&request)) {
            Ok(reply) => break reply,
            Err(error @ Error::Timeout { .. }) => {
                late += 1;
                assert!(error.to_string().contains("is alive"), "{error}");
                is_let_go.store(true, Ordering::SeqCst);
            }
            Err(error) => panic!("{error}"),
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "it never ends");
    };
    assert!(late > 0 && whole.t1_ns == long as i64, "{late}: {whole:?}");
    client.detach().unwrap();
    // Reset, once early, once whole: retries have computed nothing.
    assert_eq!(served.stop().computed_windows(), 2);
}

#[test]
fn nobody_there_is_told_within_two_heartbeats_of_silence() {
    let link = SessionConfig::connect_to(free_endpoint().unwrap());
    let begin = Instant::now();
    let Err(error) = Client::attach(KEY, &link, "test", None, Timeouts::default()) else {
        panic!("attached to no component");
    };
    assert!(matches!(error, Error::Disconnected { .. }), "{error}");
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
    assert!(error.to_string().contains(KEY), "{error}");
    for bad in ["yard", "yard/*", "a/b/c"] {
        assert!(matches!(attach_to(bad, &link), Err(Error::InvalidName { .. })));
    }
    let error = Server::open(KEY, &SessionConfig::listen_on("tcp/300.0.0.1:1")).err().unwrap();
    assert!(error.to_string().contains("300.0.0.1"), "{error}");
}

fn attach_to(name: &str, link: &SessionConfig) -> Result<Client, Error> {
    Client::attach(name, link, "test", None, Timeouts::default())
}

#[test]
fn who_comes_while_the_bed_is_prepared_is_told_so_and_waits() {
    let server = Server::open(KEY, &SessionConfig::listen_on(free_endpoint().unwrap())).unwrap();
    let link = SessionConfig::connect_to(&server.endpoints()[0]);
    let line = Connection::open(KEY, &link, patient()).unwrap();
    assert_eq!(line.status().unwrap().state, ComponentState::Preparing);
    assert_eq!(line.describe().unwrap_err().request_error().unwrap().code, ErrorCode::Preparing);
    let other = link.clone();
    // Shorter than the preparation: signs of life keep it waiting.
    let timeouts = Timeouts { disconnect: Duration::from_millis(1500), ..Timeouts::default() };
    let waits = std::thread::spawn(move || {
        let mut client = Client::attach(KEY, &other, "early", None, timeouts)?;
        step(&mut client)?;
        client.shut_down()
    });
    std::thread::sleep(Duration::from_secs(3));
    assert!(!waits.is_finished());
    server.run(lockstep(), &mut ()).unwrap();
    let place = waits.join().unwrap().unwrap();
    assert_eq!(place.hash, undisturbed(1)[0]);
    assert!(matches!(attach_to(KEY, &link), Err(Error::Disconnected { .. })));
}
