//! Windows that are computed again after a checkpoint, and a component that is killed behind them.

use crate::serve::{KEY, Serving, attach, endpoint};
use crate::setup::Place;
use ballast_protocol::lockstep::{Activity, SetParameters};
use ballast_zenoh::{Line, Link, Patience};
use std::time::Duration;

const MS: u64 = 1_000_000;

#[test]
fn a_redo_of_a_window_that_a_checkpoint_holds_survives_a_kill() {
    let place = Place::new();
    let endpoint = endpoint();
    let arguments = "--out s --checkpoint-every 1000";
    let mut serving = Serving::start(&place, &endpoint, arguments);
    let mut client = attach(&endpoint, None).unwrap();
    client.advance_to(MS, vec![], vec![]).unwrap();
    client.advance_to(2 * MS, vec![], vec![]).unwrap();
    // Writes a checkpoint; the same window with fewer iterations leads elsewhere, as often as it is redone.
    for iterations in [3, 2] {
        let set = SetParameters { iterations: Some(iterations), ..SetParameters::default() };
        let kept = client.set_parameters(&set).unwrap().clone();
        client.redo([MS, 2 * MS], vec![], vec![]).unwrap();
        assert_ne!(client.place().hash, kept.hash);
    }
    let redone = client.place().clone();
    serving.child.kill().unwrap();
    serving.child.wait().unwrap();
    serving = Serving::start(&place, &endpoint, &format!("{arguments} --resume"));
    let patience = Patience { absence: Duration::from_secs(30), ..Patience::default() };
    let line = Line::open(KEY, &Link::to(&endpoint), patience).unwrap();
    // Ready as it says, it tells of this run.
    let status = line.status().unwrap();
    assert_eq!(status.activity, Activity::Paused);
    assert_eq!((&status.place, status.durable_seq), (&redone, redone.seq));
    client.advance_to(3 * MS, vec![], vec![]).unwrap();
    client.shut_down().unwrap();
    drop(serving);
}
