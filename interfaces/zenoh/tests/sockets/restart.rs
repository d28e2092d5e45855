//! A component that comes back from an older state than its client has seen.

use crate::running::slowly;
use crate::setup::{KEY, Served, WINDOW, lockstep, patient, step};
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{AdvanceRequest, DeadlinePolicy, ReplyStatus};
use ballast_zenoh::{Client, Error, SessionConfig};
use std::sync::atomic::Ordering;

#[test]
fn windows_that_ran_out_of_time_end_where_they_did_when_they_are_computed_again() {
    let (served, is_let_go) = Served::dawdling();
    let link = SessionConfig::connect_to(&served.endpoint);
    let mut client = Client::attach(KEY, &link, "test", None, patient()).unwrap();
    client.advance_to(WINDOW, vec![], vec![]).unwrap();
    for (policy, status) in [
        (DeadlinePolicy::Early, ReplyStatus::Early),
        (DeadlinePolicy::Discard, ReplyStatus::Discard),
    ] {
        // A step takes 10 ms and more; these are four hundred.
        let next = client.next_request(client.position().now_ns + 80 * WINDOW);
        let request = AdvanceRequest { deadline_ms: 60, deadline_policy: policy, ..next };
        let reply = client.send(WindowKind::Advance, request).unwrap();
        assert_eq!(reply.status, status, "{}", reply.message);
    }
    is_let_go.store(true, Ordering::SeqCst);
    client.advance_to(client.position().now_ns + WINDOW, vec![], vec![]).unwrap();
    let before = client.position().clone();
    let endpoint = served.endpoint.clone();
    assert_eq!(served.stop().position(), before);
    // Back at its beginning; all windows are asked for again, with the next one.
    let served = Served::at(&SessionConfig::listen_on(endpoint), lockstep());
    client.advance_to(before.now_ns + WINDOW, vec![], vec![]).unwrap();
    let place = client.position().clone();
    assert_eq!((place.seq, place.now_ns), (5, before.now_ns + WINDOW));
    client.detach().unwrap();
    let ended = served.stop();
    assert_eq!((ended.position(), ended.computed_windows()), (place, 5));
}

#[test]
fn windows_that_are_lost_are_not_forgotten_where_time_is_let_run() {
    let served = Served::new();
    let mut client = served.client();
    (0..2).for_each(|_| step(&mut client).unwrap());
    let (endpoint, before) = (served.endpoint.clone(), client.position().clone());
    let restarted = |served: Served| {
        served.stop();
        Served::at(&SessionConfig::listen_on(endpoint.clone()), lockstep())
    };
    let served = restarted(served);
    assert_eq!(client.start_real_time(&slowly()).unwrap(), &before);
    assert_eq!(client.stop_real_time().unwrap(), &before);
    // Time stood when the component was away once more, with what it had not kept.
    let _served = restarted(served);
    let error = step(&mut client).unwrap_err();
    assert!(matches!(error, Error::Diverged { .. }), "{error}");
}
