//! Real-time mode over sockets.

use crate::hostile::Stranger;
use crate::setup::{KEY, Served, WINDOW, attach, hash, knot, lockstep, once_free, step, wait_for};
use ballast_protocol::lockstep::{ComponentState, ErrorCode};
use ballast_protocol::messages::AdvanceRequest;
use ballast_protocol::real_time::RealTimeMode;
use ballast_zenoh::{Client, ServerHooks, SessionConfig, Timeouts};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A tenth of the wall clock's pace: busy machines keep it.
pub fn slowly() -> RealTimeMode {
    RealTimeMode {
        real_time_factor: 0.1,
        window_ns: WINDOW,
        latency_ns: 4 * WINDOW,
        max_sample_age_ms: 300,
        bodies: vec!["floor".into()],
        ..RealTimeMode::default()
    }
}

/// Sends samples, one per window.
fn shake(client: &Client, from: u64, samples: u64) {
    for k in from..from + samples {
        client.put_motion("floor", &knot(k * WINDOW)).unwrap();
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Keeps what was computed.
struct Keeps {
    stop: Arc<AtomicBool>,
    windows: Arc<Mutex<Vec<(AdvanceRequest, String)>>>,
}

impl ServerHooks for Keeps {
    fn window_computed(
        &mut self,
        _: &ballast_protocol::lockstep::Lockstep,
        _: ballast_protocol::lockstep::WindowKind,
        request: &AdvanceRequest,
        reply: &ballast_protocol::messages::AdvanceReply,
    ) -> bool {
        self.windows.lock().unwrap().push((request.clone(), reply.hash.to_string()));
        false
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }
}

#[test]
fn time_runs_starves_goes_on_and_stops_and_can_be_computed_again() {
    let windows = Arc::new(Mutex::new(vec![]));
    let stop = Arc::new(AtomicBool::new(false));
    let keeps = Keeps { stop: Arc::clone(&stop), windows: Arc::clone(&windows) };
    let served = Served::hosted(keeps, stop);
    let mut client = served.client();
    client.start_real_time(&slowly()).unwrap();
    let status = wait_for(|| client.status(), ComponentState::WaitingForInput);
    let who = format!("samples of floor from {}", client.id());
    assert_eq!((status.waiting_for, status.position.now_ns), (Some(who), 0));
    // What is not the owner's, or no motion, is not heard.
    let stranger = Stranger::at(&served.link());
    stranger.put_motion("floor", &knot(0));
    // Everything else waits until time stands.
    let refused = step(&mut client).unwrap_err();
    assert_eq!(refused.request_error().unwrap().code, ErrorCode::RealTimeActive, "{refused}");
    assert_eq!(
        client.reset().unwrap_err().request_error().unwrap().code,
        ErrorCode::RealTimeActive
    );
    // A busy machine may pause for longer than the greatest age, here or there: samples until it runs.
    let begin = Instant::now();
    let mut sent = 0;
    loop {
        shake(&client, sent, 20);
        sent += 20;
        let status = client.status().unwrap();
        if status.state == ComponentState::Running && status.position.now_ns >= 10 * WINDOW {
            assert_eq!(status.real_time.unwrap().real_time_factor, 0.1);
            break;
        }
        assert!(begin.elapsed() < Duration::from_secs(60), "{status:?}");
    }
    let mut status = wait_for(|| client.status(), ComponentState::WaitingForInput);
    while status.waiting_since_ms < Some(300) {
        status = wait_for(|| client.status(), ComponentState::WaitingForInput);
    }
    let first = status.position;
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(client.status().unwrap().position, first, "time stands");
    while client.status().unwrap().position.now_ns == first.now_ns {
        shake(&client, 100_000 + sent, 20);
        sent += 20;
        assert!(begin.elapsed() < Duration::from_secs(60), "time stands");
    }
    let place = client.stop_real_time().unwrap().clone();
    assert!(client.status().unwrap().real_time.is_none());
    client.detach().unwrap();
    served.stop();
    // The same inputs in one process: the same states.
    let (mut again, windows) = (lockstep(), windows.lock().unwrap());
    let ask =
        ballast_protocol::lockstep::AttachRequest { client: "me".into(), ..Default::default() };
    again.attach(&ask, "t".into(), 0).unwrap();
    for (request, hash) in windows.iter() {
        use ballast_protocol::lockstep::WindowKind;
        use std::ops::ControlFlow;
        let reply = again
            .window(WindowKind::Advance, request, "t", &|| 0, &mut |_| ControlFlow::Continue(()))
            .unwrap();
        assert_eq!(reply.hash.to_string(), *hash);
    }
    assert_eq!(again.position().hash, place.hash);
}

#[test]
fn when_the_owner_is_gone_time_stands() {
    let served = Served::new();
    let mut client = served.client();
    client.start_real_time(&slowly()).unwrap();
    shake(&client, 0, 30);
    drop(client);
    let client = once_free(|| attach(&served.link()), Duration::from_secs(10));
    let status = client.status().unwrap();
    assert!(status.state == ComponentState::Idle && status.real_time.is_none(), "{status:?}");
    let bad = RealTimeMode { bodies: vec!["flor".into()], ..slowly() };
    let mut client = client;
    let refused = client.start_real_time(&bad).unwrap_err();
    assert_eq!(refused.request_error().unwrap().code, ErrorCode::UnknownBody, "{refused}");
    assert_eq!(client.status().unwrap().state, ComponentState::Idle);
}

#[test]
fn who_sends_samples_is_told_when_nobody_heeds_them() {
    let seen = |client: &Client, code: &str| {
        let begin = Instant::now();
        loop {
            let seen = client.put_motion("floor", &knot(0));
            if seen.as_ref().is_err_and(|error| error.code() == code) {
                break;
            }
            assert!(begin.elapsed() < Duration::from_secs(60), "{seen:?}");
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    let served = Served::new();
    let endpoint = served.endpoint.clone();
    let link = served.link();
    let mut client = Client::attach(KEY, &link, "test", None, Timeouts::default()).unwrap();
    client.start_real_time(&slowly()).unwrap();
    shake(&client, 0, 150);
    served.stop();
    seen(&client, "disconnected");
    // Another one in its place does not know of this client.
    let _served = Served::at(&SessionConfig::listen_on(endpoint), lockstep());
    seen(&client, "not_owner");
}

#[test]
fn samples_that_cannot_be_read_are_counted() {
    let served = Served::new();
    let stranger = Stranger::at(&served.link());
    let (_token, ticket, _run) = stranger.attach();
    let ask = serde_json::json!({ "real_time": slowly() }).to_string();
    stranger.ask("param", ask.as_bytes(), Some(&ticket)).unwrap();
    let good = serde_json::to_vec(&knot(0)).unwrap();
    for (bytes, ticket) in [
        (good, &ticket),
        (b"{}".to_vec(), &ticket),
        (vec![b' '; 5000], &ticket),
        (b"\xff".to_vec(), &ticket),
        // Not the owner's: ignored.
        (b"{}".to_vec(), &"0123456789abcdef".to_string()),
    ] {
        stranger.put("floor", bytes, ticket);
    }
    let begin = Instant::now();
    loop {
        let status = stranger.ask("status", b"", None).unwrap();
        let status: serde_json::Value = serde_json::from_slice(&status).unwrap();
        if status["real_time"]["dropped_samples"] == 3 {
            break;
        }
        assert!(begin.elapsed() < Duration::from_secs(10), "{status:#}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn what_is_not_prepared_does_not_run_by_itself() {
    let unconfigured = ballast_protocol::lockstep::Lockstep::unconfigured(hash).unwrap();
    let endpoint = ballast_zenoh::session::free_endpoint().unwrap();
    let served = Served::at(&ballast_zenoh::SessionConfig::listen_on(endpoint), unconfigured);
    let refused = served.client().start_real_time(&slowly()).unwrap_err();
    assert_eq!(refused.request_error().unwrap().code, ErrorCode::Unconfigured, "{refused}");
}
