//! Windows that are computed again after a checkpoint, and a component that is killed behind them.

use crate::serve::{KEY, Serving, attach, endpoint};
use crate::setup::Place;
use ballast_protocol::lockstep::{ComponentState, ParameterUpdate};
use ballast_protocol::messages::{BodyMotion, InterpolationMode, MotionKnot, Pose, Twist};
use ballast_zenoh::{Client, Connection, SessionConfig, Timeouts};
use std::time::Duration;

const MS: u64 = 1_000_000;

#[test]
fn a_redo_of_a_window_that_a_checkpoint_holds_survives_a_kill() {
    let place = Place::new();
    let endpoint = endpoint();
    let arguments = "--out s --checkpoint-interval 1000";
    let mut serving = Serving::start(&place, &endpoint, arguments);
    let mut client = attach(&endpoint, None).unwrap();
    client.advance_to(MS, vec![], vec![]).unwrap();
    client.advance_to(2 * MS, vec![], vec![]).unwrap();
    // Writes a checkpoint; the same window with fewer iterations leads elsewhere, as often as it is redone.
    for iterations in [3, 2] {
        let set =
            ParameterUpdate { max_iterations: Some(iterations), ..ParameterUpdate::default() };
        let kept = client.set_parameters(&set).unwrap().clone();
        client.redo([MS, 2 * MS], vec![], vec![]).unwrap();
        assert_ne!(client.position().hash, kept.hash);
    }
    let redone = client.position().clone();
    serving.child.kill().unwrap();
    serving.child.wait().unwrap();
    serving = Serving::start(&place, &endpoint, &format!("{arguments} --resume"));
    let timeouts = Timeouts { disconnect: Duration::from_secs(30), ..Timeouts::default() };
    let line = Connection::open(KEY, &SessionConfig::connect_to(&endpoint), timeouts).unwrap();
    // Its status is that of this run.
    let status = line.status().unwrap();
    assert_eq!(status.state, ComponentState::Idle);
    assert_eq!((&status.position, status.durable_seq), (&redone, redone.seq));
    client.advance_to(3 * MS, vec![], vec![]).unwrap();
    client.shut_down().unwrap();
    drop(serving);
}

/// Both tines of the case, from where they are, 20 mm towards each other until `t1`.
fn closing(client: &Client, t1: u64) -> Vec<BodyMotion> {
    let mut tines = client.describe().unwrap().bodies;
    tines.retain(|body| body.role == "tine");
    tines.sort_by(|a, b| a.position.x.total_cmp(&b.position.x));
    let [left, right] = &tines[..] else { panic!("{tines:?}") };
    let motion = |body: &ballast_protocol::description::BodyDescription, way: f64| {
        let knot = |time_ns: u64, way: f64| {
            let mut pose = Pose { position: body.position, orientation: body.orientation };
            pose.position.x += way;
            MotionKnot { time_ns: time_ns as i64, pose, twist: Twist::default() }
        };
        let knots = vec![knot(client.position().now_ns, 0.0), knot(t1, way)];
        let (body, interpolation) = (body.name.clone(), InterpolationMode::Linear);
        BodyMotion { body, interpolation, allow_jump: false, knots }
    };
    vec![motion(left, 0.02), motion(right, -0.02)]
}

#[test]
fn what_a_redone_window_had_told_is_forgotten_and_a_run_without_windows_is_no_damage() {
    let place = Place::new();
    let endpoint = endpoint();
    let serving = Serving::start(&place, &endpoint, "--out s --record s.mcap");
    // Restarted before its first window: the recording is sound and empty.
    let mut client = attach(&endpoint, None).unwrap();
    client.reset().unwrap();
    let squeeze = client.connection().keys().out_squeeze("pair_0");
    let is_told = |client: &Client| {
        let told = client.connection().last_messages().unwrap();
        told.iter().any(|(key, ..)| *key == squeeze)
    };
    let end = 100 * MS;
    let closes = closing(&client, end);
    client.advance_to(end, closes, vec![]).unwrap();
    assert!(is_told(&client));
    client.redo([0, end], vec![], vec![]).unwrap();
    assert!(!is_told(&client));
    client.shut_down().unwrap();
    serving.end().with_code(0);
    let message = place.call("verify s.mcap").with_code(1).stderr();
    assert!(message.contains("expected windows to compare, found none"), "{message}");
    place.call("verify s.2.mcap").with_code(0);
}
