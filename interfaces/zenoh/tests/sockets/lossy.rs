//! Requests and replies that get lost, come twice, or come late.

use crate::relay::{Faults, Relay};
use crate::setup::{Served, attach, step, times, undisturbed};
use ballast_zenoh::{HEARTBEAT, Link};
use std::time::{Duration, Instant};

/// So many windows through a relay; the longest that one took.
fn run(seed: u64, windows: u64, faults: Faults) -> Duration {
    let served = Served::new();
    let relay = Relay::before(&served.link(), seed, faults);
    let mut client = attach(&Link::to(&relay.endpoint)).unwrap();
    let mut longest = Duration::ZERO;
    for k in 0..windows {
        let begin = Instant::now();
        step(&mut client).unwrap_or_else(|e| panic!("seed {seed}, window {}: {e}", k + 1));
        longest = longest.max(begin.elapsed());
        // Requests that are no windows have their effect once, too.
        if k % 10 == 5 {
            client.save("here").unwrap();
            client.drop_state("here").unwrap();
        }
    }
    assert_eq!(client.place().hash, undisturbed(windows)[windows as usize - 1], "seed {seed}");
    client.detach().unwrap();
    assert_eq!(served.stop().answered_count(), windows, "seed {seed}");
    longest
}

#[test]
fn requests_that_are_lost_and_repeated_are_computed_once() {
    let faults =
        Faults { refuse: 0.3, repeat: 0.3, echo: 0.2, lose_reply: 0.3, ..Faults::default() };
    for seed in 0..times(4) {
        run(seed, 40, faults);
    }
}

#[test]
fn requests_that_vanish_are_sent_again_within_two_heartbeats_or_so() {
    let longest = run(1, times(30), Faults { swallow: 0.2, ..Faults::default() });
    // Each loss costs two to three heartbeats; several in a row are bad luck.
    assert!(longest < 12 * HEARTBEAT, "{longest:?}");
}

#[test]
fn replies_that_come_late_change_nothing() {
    let faults = Faults { delay: Duration::from_millis(40), repeat: 0.2, ..Faults::default() };
    run(2, times(60), faults);
}
