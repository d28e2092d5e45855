//! A component that comes back from an older state than its client has seen.

use crate::setup::{KEY, Served, WINDOW, lockstep, patient};
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{AdvanceRequest, DeadlinePolicy, Status};
use ballast_zenoh::{Client, Link};
use std::sync::atomic::Ordering;

#[test]
fn windows_that_ran_out_of_time_end_where_they_did_when_they_are_computed_again() {
    let (served, is_let_go) = Served::dawdling();
    let link = Link::to(&served.endpoint);
    let mut client = Client::attach(KEY, &link, "test", None, patient()).unwrap();
    client.advance_to(WINDOW, vec![], vec![]).unwrap();
    for (policy, status) in
        [(DeadlinePolicy::Early, Status::Early), (DeadlinePolicy::Discard, Status::Discard)]
    {
        // A step takes 10 ms and more; these are four hundred.
        let next = client.next(client.place().now_ns + 80 * WINDOW);
        let request = AdvanceRequest { deadline_ms: 60, deadline_policy: policy, ..next };
        let reply = client.send(WindowKind::Advance, request).unwrap();
        assert_eq!(reply.status, status, "{}", reply.message);
    }
    is_let_go.store(true, Ordering::SeqCst);
    client.advance_to(client.place().now_ns + WINDOW, vec![], vec![]).unwrap();
    let before = client.place().clone();
    let endpoint = served.endpoint.clone();
    assert_eq!(served.stop().place(), before);
    // Back at its beginning; all windows are asked for again, with the next one.
    let served = Served::at(&Link::listening(endpoint), lockstep());
    client.advance_to(before.now_ns + WINDOW, vec![], vec![]).unwrap();
    let place = client.place().clone();
    assert_eq!((place.seq, place.now_ns), (5, before.now_ns + WINDOW));
    client.detach().unwrap();
    let ended = served.stop();
    assert_eq!((ended.place(), ended.answered_count()), (place, 5));
}
