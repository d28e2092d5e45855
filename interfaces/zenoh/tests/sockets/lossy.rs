//! Requests and replies that get lost, come twice, or come late.

use crate::relay::{Faults, Relay};
use crate::setup::{KEY, Served, WINDOW, attach, patient, shaking, step, times, undisturbed};
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::AdvanceRequest;
use ballast_zenoh::{Client, Error, HEARTBEAT_INTERVAL, SessionConfig, Timeouts};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Computes windows through a relay and returns the duration of each.
fn run(seed: u64, windows: u64, faults: Faults) -> Vec<Duration> {
    let served = Served::new();
    let relay = Relay::before(&served.link(), seed, faults);
    let mut client = attach(&SessionConfig::connect_to(&relay.endpoint)).unwrap();
    let mut took = vec![];
    for k in 0..windows {
        let begin = Instant::now();
        step(&mut client).unwrap_or_else(|e| panic!("seed {seed}, window {}: {e}", k + 1));
        took.push(begin.elapsed());
        // Requests that are no windows have their effect once, too.
        if k % 10 == 5 {
            client.save("here").unwrap();
            client.drop_state("here").unwrap();
        }
    }
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1], "seed {seed}");
    client.detach().unwrap();
    assert_eq!(served.stop().computed_windows(), windows, "seed {seed}");
    took
}

#[test]
fn requests_that_are_lost_and_repeated_are_computed_once() {
    let faults =
        Faults { refuse: 0.3, repeat: 0.3, echo: 0.2, lose_reply: 0.3, ..Faults::default() };
    for seed in 0..4 {
        run(seed, times(40), faults);
    }
}

#[test]
fn requests_that_vanish_are_sent_again_within_two_heartbeats() {
    // A fifth of them.
    let mut took = run(1, 10 * times(6), Faults { swallow: 0.2, ..Faults::default() });
    took.retain(|time| *time > HEARTBEAT_INTERVAL / 4);
    took.sort();
    // Some are lost once only. Half a beat of slack for a machine that does other things.
    assert!(took[took.len() / 4] < 2 * HEARTBEAT_INTERVAL + HEARTBEAT_INTERVAL / 2, "{took:?}");
    // Six in a row are worse luck than these seeds have.
    assert!(took[took.len() - 1] < 15 * HEARTBEAT_INTERVAL, "{took:?}");
}

#[test]
fn replies_that_come_late_change_nothing() {
    let faults = Faults { delay: Duration::from_millis(40), repeat: 0.2, ..Faults::default() };
    run(2, times(60), faults);
}

#[test]
fn replies_delayed_past_the_deadline_are_told_as_slow_and_got_by_asking_again() {
    let served = Served::new();
    let faults = Faults { delay: Duration::from_millis(200), ..Faults::default() };
    let relay = Relay::before(&served.link(), 3, faults);
    let hasty = Timeouts { deadline_margin: Duration::ZERO, ..patient() };
    let link = SessionConfig::connect_to(&relay.endpoint);
    let mut client = Client::attach(KEY, &link, "hasty", None, hasty).unwrap();
    let (mut late, mut windows) = (0, 0);
    while late < times(10) {
        let t0 = client.position().now_ns;
        let t1 = t0 + WINDOW;
        let request =
            AdvanceRequest { motions: shaking(t0, t1), deadline_ms: 10, ..client.next_request(t1) };
        let begin = Instant::now();
        let request = Arc::new(request);
        while let Err(error) = client.send(WindowKind::Advance, Arc::clone(&request)) {
            assert!(matches!(error, Error::Timeout { .. }), "{error}");
            assert!(begin.elapsed() < Duration::from_secs(60), "it never comes");
            late += 1;
        }
        windows += 1;
    }
    assert_eq!(client.position().hash, undisturbed(windows)[windows as usize - 1]);
    client.detach().unwrap();
    assert_eq!(served.stop().computed_windows(), windows, "each was computed once");
}
