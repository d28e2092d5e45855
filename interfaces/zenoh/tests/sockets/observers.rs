//! Observers: in time, late, and such that never read.

use crate::setup::{KEY, Served, patient, step, times, undisturbed};
use ballast_protocol::from_cdr;
use ballast_protocol::messages::{Clock, StateHash, WrenchImpulse};
use ballast_zenoh::{HEARTBEAT, Line, Link};
use std::process::{Command, Stdio};
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};
use zenoh::Wait;

#[test]
fn an_observer_sees_every_window_and_a_late_one_the_last() {
    let served = Served::new();
    let mut client = served.client();
    let observer = Line::open(KEY, &served.link(), patient()).unwrap();
    observer.status().unwrap();
    let (sender, told) = channel();
    observer
        .listen(move |key, encoding, bytes| {
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
    // Comes after the last window.
    let late = Line::open(KEY, &served.link(), patient()).unwrap();
    late.status().unwrap();
    let last = late.last_told().unwrap();
    let find = |what: String| last.iter().find(|(key, ..)| *key == what).unwrap().2.clone();
    let hash: StateHash = from_cdr(&find(late.keys().out("hash"))).unwrap();
    assert_eq!(hash.to_string(), expected[29]);
    let clock: Clock = from_cdr(&find(late.keys().out("clock"))).unwrap();
    assert_eq!(clock.clock.ns() as u64, client.place().now_ns);
    // And within two heartbeats it knows what the component does.
    std::thread::sleep(2 * HEARTBEAT);
    assert_eq!(late.last_status().unwrap().place, *client.place());
}

/// Not a check of its own: an observer whose callback never returns, so that what is sent to it fills every
/// buffer on the way. In a process of its own, since sessions of one process share their threads.
#[test]
#[ignore = "the process that another test starts"]
fn never_reads() {
    let link = Link::to(std::env::var("BALLAST_TEST_ENDPOINT").unwrap());
    let session = link.open().unwrap();
    let stuck = session.declare_subscriber("ballast/**").callback(move |_| {
        loop {
            std::thread::park();
        }
    });
    stuck.background().wait().unwrap();
    std::thread::sleep(Duration::from_secs(300));
}

#[test]
fn an_observer_that_never_reads_does_not_hold_up_the_run() {
    let served = Served::new();
    let mut observer = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "observers::never_reads", "--ignored"])
        .env("BALLAST_TEST_ENDPOINT", &served.endpoint)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut client = served.client();
    let windows = times(1500);
    let mut longest = Duration::ZERO;
    for _ in 0..windows {
        let begin = Instant::now();
        step(&mut client).unwrap();
        longest = longest.max(begin.elapsed());
    }
    observer.kill().unwrap();
    observer.wait().unwrap();
    assert!(longest < Duration::from_secs(4), "a window took {longest:?}");
    assert_eq!(client.place().hash, undisturbed(windows)[windows as usize - 1]);
}
