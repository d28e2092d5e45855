//! A component on a real socket: a floor on a mass and a spring presses a heap of stones from below.

use crate::common;
use crate::press::Press;
use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_coupling::{Coupling, CouplingSettings, Error};
use ballast_protocol::lockstep::Lockstep;
use ballast_protocol::messages::{AdvanceRequest, Digest};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Server, SessionConfig, Timeouts};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

const KEY: &str = "yard/bed";
const STEP_NS: u64 = 200_000;

fn hash(model: &Model, state: &State) -> u128 {
    u128::from_be_bytes(Digest::of(format!("{:?} {state:?}", model.solver).as_bytes()).0)
}

fn component() -> Component {
    let mut scene = common::heap::falling(1, STEP_NS).scheduled(Schedule::Synchronous, [2, 1, 1]);
    scene.model.solver.max_iterations = 300;
    scene.model.solver.tolerance = Some(1e-8);
    Component::new(Arc::new(scene.model), scene.state, Limits::default()).expect("a scene")
}

/// Serves until a client shuts the component down.
fn serve() -> (String, JoinHandle<Lockstep>) {
    let endpoint = SessionConfig::listen_on(free_endpoint().unwrap());
    let server = Server::open(KEY, &endpoint).expect("a free port");
    let endpoint = server.endpoints()[0].clone();
    let lockstep = Lockstep::new(component(), "run-1", hash);
    let thread = std::thread::spawn(move || server.run(lockstep, &mut ()).expect("serves"));
    (endpoint, thread)
}

fn attach(endpoint: &str) -> Client {
    let timeouts = Timeouts { disconnect: Duration::from_secs(20), ..Timeouts::default() };
    let link = SessionConfig::connect_to(endpoint);
    Client::attach(KEY, &link, "press", None, timeouts).unwrap()
}

#[test]
fn windows_over_a_socket_converge_to_the_states_of_one_process() {
    let (endpoint, server) = serve();
    let settings = CouplingSettings { window_steps: 5, tolerance: 1e-8, ..Default::default() };
    let press = Press { mass: 4.0, ..Press::new("floor", 0.4) };
    let mut coupling = Coupling::new(attach(&endpoint), press, settings).unwrap();
    let mut local = component();
    let mut before = [0.0; 12];
    let (mut largest, mut repeated) = (0.0_f64, 0);
    for _ in 0..60 {
        let window = coupling.advance().unwrap();
        assert!(window.is_converged, "{}", window.residual);
        assert!(window.energy_residual().abs() < 1e-4, "{}", window.energy_residual());
        repeated += u32::from(window.iterations > 2);
        let body = window.reply.bodies.iter().find(|b| b.body == "floor").unwrap();
        largest = largest.max(-body.mean.force.z);
        // The motion that the coupling found, computed once.
        let end = window.motion["floor"];
        let [t0_ns, t1_ns] = [window.reply.t0_ns, window.reply.t1_ns];
        let motions = vec![floor_motion([t0_ns, t1_ns], [before, end])];
        let request = AdvanceRequest { t0_ns, t1_ns, motions, ..AdvanceRequest::default() };
        local.advance_to(t1_ns as u64, &request.inputs().unwrap().motions[..]).unwrap();
        let expected = format!("{:032x}", hash(local.model(), local.state()));
        assert_eq!(window.reply.hash.to_string(), expected);
        before = end;
    }
    assert!(largest > 20.0 && repeated > 5, "{largest} N, {repeated} windows repeated");
    coupling.into_sides().0.shut_down().unwrap();
    assert_eq!(server.join().unwrap().position().seq, 60);
}

#[test]
fn a_refused_window_changes_neither_side() {
    let (endpoint, server) = serve();
    let settings = CouplingSettings { window_steps: 5, ..Default::default() };
    let mut coupling =
        Coupling::new(attach(&endpoint), Press::new("floor", 1e6), settings).unwrap();
    let before = coupling.simulation().position().clone();
    for _ in 0..2 {
        let error = coupling.advance().unwrap_err();
        assert!(matches!(error, Error::Window(_) | Error::Request(_)), "{error}");
        assert_eq!(coupling.partner().state, [0.0; 2]);
        let after = coupling.simulation().position();
        assert_eq!((after.now_ns, &after.hash), (before.now_ns, &before.hash));
    }
    coupling.into_sides().0.shut_down().unwrap();
    server.join().unwrap();
}

/// Returns the vertical motion of the floor between two rows.
fn floor_motion(times: [i64; 2], rows: [[f64; 12]; 2]) -> ballast_protocol::messages::BodyMotion {
    use ballast_protocol::messages::{
        BodyMotion, InterpolationMode, MotionKnot, Point, Pose, Twist, Vector3,
    };
    let knot = |k: usize| {
        let position = Point { z: rows[k][2], ..Point::default() };
        let linear = Vector3 { z: rows[k][8], ..Vector3::default() };
        MotionKnot {
            time_ns: times[k],
            pose: Pose { position, ..Pose::default() },
            twist: Twist { linear, ..Twist::default() },
        }
    };
    BodyMotion {
        body: "floor".into(),
        interpolation: InterpolationMode::Hermite,
        allow_jump: false,
        knots: vec![knot(0), knot(1)],
    }
}
