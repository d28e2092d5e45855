//! Observers: in time, late, and such that never read.

use crate::setup::{KEY, Served, WINDOW, patient, shaking, step, times, undisturbed};
use ballast_protocol::from_cdr;
use ballast_protocol::lockstep::StatusReport;
use ballast_protocol::messages::{
    Clock, InterpolationMode, Log, PointCloud2, ReplyStatus, SceneUpdate, StateHash, WrenchImpulse,
};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Connection, HEARTBEAT_INTERVAL, Server, SessionConfig};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};
use zenoh::Wait;

#[test]
fn an_observer_sees_every_window_and_a_late_one_the_last() {
    let served = Served::new();
    let mut client = served.client();
    let observer = Connection::open(KEY, &served.link(), patient()).unwrap();
    observer.status().unwrap();
    let (sender, told) = channel();
    observer
        .subscribe(move |key, encoding, bytes| {
            let _ = sender.send((key.to_string(), encoding.to_string(), bytes.to_vec()));
        })
        .unwrap();
    // The first messages may come before the component knows of the observer.
    let expected = undisturbed(30);
    for _ in 0..10 {
        step(&mut client).unwrap();
        std::thread::sleep(Duration::from_millis(20));
    }
    while told.try_recv().is_ok() {}
    for _ in 0..20 {
        step(&mut client).unwrap();
    }
    let hash_key = observer.keys().out("hash");
    let (mut hashes, mut impulses, mut beats) = (vec![], 0, 0);
    let begin = Instant::now();
    while hashes.len() < 20 || beats < 2 {
        let left = Duration::from_secs(20).saturating_sub(begin.elapsed());
        let (key, encoding, bytes) = told.recv_timeout(left).expect("all windows and two beats");
        if key == hash_key {
            assert!(encoding.contains("StateHash"), "{encoding}");
            hashes.push(from_cdr::<StateHash>(&bytes).unwrap().to_string());
        } else if key == observer.keys().out_body("floor", "impulse") {
            assert_eq!(from_cdr::<WrenchImpulse>(&bytes).unwrap().body, "floor");
            impulses += 1;
        } else if key == observer.keys().out("status") {
            beats += 1;
        }
    }
    assert_eq!((&hashes[..], impulses), (&expected[10..], 20));
    // Those who come after the last window.
    let look = || {
        let late = Connection::open(KEY, &served.link(), patient()).unwrap();
        late.status().unwrap();
        let last = late.last_messages().unwrap();
        let find = |what: String| last.iter().find(|(key, ..)| *key == what).unwrap().2.clone();
        let hash: StateHash = from_cdr(&find(late.keys().out("hash"))).unwrap();
        assert_eq!(hash.to_string(), expected[29]);
        let clock: Clock = from_cdr(&find(late.keys().out("clock"))).unwrap();
        assert_eq!(clock.clock.ns() as u64, client.position().now_ns);
        let status: StatusReport =
            serde_json::from_slice(&find(late.keys().out("status"))).unwrap();
        assert_eq!(status.position, *client.position());
        late
    };
    (1..times(3)).for_each(|_| drop(look()));
    let late = look();
    // And within two heartbeats it knows what the component does.
    std::thread::sleep(2 * HEARTBEAT_INTERVAL);
    assert_eq!(late.last_status().unwrap().position, *client.position());
    // Of a run that has begun again, nothing of the previous one is published.
    let begin = client.reset().unwrap().clone();
    let last = late.last_messages().unwrap();
    let told = |what: String| last.iter().find(|(key, ..)| *key == what).map(|t| &t.2[..]);
    let clock: Clock = from_cdr(told(late.keys().out("clock")).unwrap()).unwrap();
    assert_eq!((clock.clock.ns(), begin.now_ns), (0, 0));
    let hash: StateHash = from_cdr(told(late.keys().out("hash")).unwrap()).unwrap();
    assert_eq!(hash.to_string(), begin.hash);
    assert_eq!(told(late.keys().out_body("floor", "impulse")), None);
}

#[test]
fn of_a_window_that_was_taken_back_only_that_is_told() {
    let served = Served::new();
    let mut client = served.client();
    // Until the stones lie on the floor.
    (0..100).for_each(|_| step(&mut client).unwrap());
    let late = Connection::open(KEY, &served.link(), patient()).unwrap();
    late.status().unwrap();
    let find = |what: String| {
        let last = late.last_messages().unwrap();
        last.iter().find(|(key, ..)| *key == what).map(|told| told.2.clone())
    };
    let impulse = late.keys().out_body("floor", "impulse");
    let (before, t0) = (find(impulse.clone()).unwrap(), client.position().now_ns);
    let borne: WrenchImpulse = from_cdr(&before).unwrap();
    assert!(borne.mean.force.z != 0.0, "{borne:?}");
    // The floor is to be a metre away after one step.
    let mut away = shaking(t0, t0 + WINDOW);
    away[0].interpolation = InterpolationMode::Linear;
    away[0].knots[1].pose.position.x += 1.0;
    let reply = client.advance_to(t0 + WINDOW, away.clone(), vec![]).unwrap();
    assert_eq!((reply.status, &reply.code[..]), (ReplyStatus::Discard, "over_speed"));
    assert_eq!(find(impulse.clone()), Some(before));
    let log: Log = from_cdr(&find(late.keys().out("log")).unwrap()).unwrap();
    assert!(log.msg.contains("rolled back (discard)"), "{}", log.msg);
    let hash = || from_cdr::<StateHash>(&find(late.keys().out("hash")).unwrap()).unwrap();
    assert_eq!(hash().to_string(), client.position().hash);
    // With a redo the window that stood is gone: forces at its end are no longer published.
    let stood = client.advance_to(t0 + WINDOW, vec![], vec![]).unwrap();
    assert!(stood.status.is_kept() && find(impulse.clone()).is_some());
    let reply = client.redo([t0, t0 + WINDOW], away, vec![]).unwrap();
    assert_eq!((reply.status, client.position().now_ns), (ReplyStatus::Discard, t0));
    assert_eq!((find(impulse), hash().to_string()), (None, client.position().hash.clone()));
}

/// Not a separate check: an observer whose callback never returns, so that what is sent to it fills every
/// buffer on the way. In a separate process, since sessions of one process share their threads.
#[test]
#[ignore = "the process that another test starts"]
fn never_reads() {
    let link = SessionConfig::connect_to(std::env::var("BALLAST_TEST_ENDPOINT").unwrap());
    let session = link.open().unwrap();
    let stuck = session.declare_subscriber("ballast/**").callback(move |_| {
        loop {
            std::thread::park();
        }
    });
    stuck.background().wait().unwrap();
    std::thread::sleep(Duration::from_secs(300));
}

/// Most processes that never read at a time: each is waited for a second before it is cut off.
const AT_ONCE: u64 = 4;

/// The process that never reads what it is sent from an endpoint.
fn stuck_at(endpoint: &str) -> Child {
    Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "observers::never_reads", "--ignored"])
        .env("BALLAST_TEST_ENDPOINT", endpoint)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Windows beside processes that never read, some at a time, each for so long that every buffer on the way is full;
/// how many there were, and how long the longest took.
fn with_stuck(client: &mut Client, endpoint: &str) -> (u64, Duration) {
    let (mut windows, mut longest) = (0, Duration::ZERO);
    let mut left = times(1);
    while left > 0 {
        let stuck: Vec<Child> = (0..left.min(AT_ONCE)).map(|_| stuck_at(endpoint)).collect();
        left -= stuck.len() as u64;
        for _ in 0..1500 {
            let begin = Instant::now();
            step(client).unwrap();
            longest = longest.max(begin.elapsed());
            windows += 1;
        }
        for mut process in stuck {
            process.kill().unwrap();
            process.wait().unwrap();
        }
    }
    (windows, longest)
}

/// Served with a picture per window; the endpoint of the pictures.
fn with_viewer() -> (Served, String) {
    let viz = free_endpoint().unwrap();
    let link = SessionConfig::listen_on(free_endpoint().unwrap());
    let server = Server::open(KEY, &link).unwrap();
    let server = server.with_viewer(&SessionConfig::listen_on(&viz), Duration::ZERO).unwrap();
    (Served::by(server), viz)
}

#[test]
fn a_viewer_sees_stones_and_scene() {
    let (served, viz) = with_viewer();
    let mut client = served.client();
    assert_eq!(client.describe().unwrap().viewer_endpoints, std::slice::from_ref(&viz));
    let session = SessionConfig::connect_to(&viz).open().unwrap();
    let (sender, told) = channel();
    let viewer = session.declare_subscriber(format!("ballast/1/{KEY}/viz/*"));
    let viewer = viewer.callback(move |sample| {
        let bytes = sample.payload().to_bytes().into_owned();
        let _ = sender.send((sample.key_expr().to_string(), bytes));
    });
    let _viewer = viewer.wait().unwrap();
    let begin = Instant::now();
    let (mut cloud, mut scene) = (None, None);
    let mut windows = 0;
    while cloud.is_none() || scene.is_none() {
        step(&mut client).unwrap();
        windows += 1;
        std::thread::sleep(Duration::from_millis(10));
        while let Ok((key, bytes)) = told.try_recv() {
            if key.ends_with("grains") {
                cloud = Some(from_cdr::<PointCloud2>(&bytes).unwrap());
            } else {
                scene = Some(from_cdr::<SceneUpdate>(&bytes).unwrap());
            }
        }
        assert!(begin.elapsed() < Duration::from_secs(20), "no pictures");
    }
    assert_eq!(cloud.unwrap().width, 18);
    assert_eq!(scene.unwrap().entities[0].id, "grains");
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}

#[test]
fn a_viewer_that_never_reads_does_not_hold_up_the_run() {
    let (served, viz) = with_viewer();
    let mut client = served.client();
    let (windows, longest) = with_stuck(&mut client, &viz);
    // Not even for the time after which an observer of the run itself is cut off.
    assert!(longest < Duration::from_millis(900), "a window took {longest:?}");
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}

#[test]
fn an_observer_that_never_reads_does_not_hold_up_the_run() {
    let served = Served::new();
    let mut client = served.client();
    let (windows, longest) = with_stuck(&mut client, &served.endpoint);
    assert!(longest < Duration::from_secs(3 + AT_ONCE), "a window took {longest:?}");
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
}
