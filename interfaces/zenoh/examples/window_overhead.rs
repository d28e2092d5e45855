//! Measures the overhead of a window between two processes on the loopback and prints a CSV.
//!
//!     cargo run --release -p ballast-zenoh --example window_overhead -- [WINDOWS] > overhead.csv
//!     cargo run --release -p ballast-zenoh --example window_overhead -- WINDOWS SITE/ID > overhead.csv
//!
//! Nine stones in a separate process, whose windows of 1 ms are about as long as the overhead; or, with SITE/ID, the
//! component that `ballast serve` serves, with its hashes, checkpoints and recording, in windows of one time step in
//! which nothing moves. From each round trip is taken what the component says that computing the window took.

#[path = "../../../tests/common/mod.rs"]
mod common;

use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_protocol::description::BodyDescription;
use ballast_protocol::lockstep::Lockstep;
use ballast_protocol::messages::{BodyMotion, Digest, InterpolationMode, MotionKnot, Pose, Twist};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Client, Server, SessionConfig, Timeouts};
use std::error::Error;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

const KEY: &str = "bench/heap";
const MS: u64 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (first, component) = (arguments.next(), arguments.next());
    if first.as_deref() == Some("serve") {
        return serve();
    }
    let windows: u64 = first.map_or(Ok(3000), |n| n.parse())?;
    let times = match component {
        Some(key) => {
            let mut client = Client::attach(
                &key,
                &SessionConfig::default().or_connect_to_default(),
                "bench",
                None,
                Timeouts::default(),
            )?;
            let times = measure(&mut client, windows)?;
            client.detach()?;
            times
        }
        None => measure_separate_process(windows)?,
    };
    let of = |pick: fn(&[f64; 2]) -> f64| times.iter().map(pick).collect();
    println!("what,windows,median_us,p99_us,max_us");
    print("computing", of(|[_, own]| *own));
    print("round trip", of(|[all, _]| *all));
    print("overhead", of(|[all, own]| all - own));
    Ok(())
}

fn print(what: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!("{what},{},{:.0},{:.0},{:.0}", times.len(), at(0.5), at(0.99), at(1.0));
}

/// Measures windows of a component in another process.
fn measure_separate_process(windows: u64) -> Result<Vec<[f64; 2]>, Box<dyn Error>> {
    let mut child =
        Command::new(std::env::current_exe()?).arg("serve").stdout(Stdio::piped()).spawn()?;
    let mut endpoint = String::new();
    let stdout = child.stdout.take().ok_or("the other process has no output")?;
    BufReader::new(stdout).read_line(&mut endpoint)?;
    let link = SessionConfig::connect_to(endpoint.trim());
    let mut client = Client::attach(KEY, &link, "bench", None, Timeouts::default())?;
    let times = measure(&mut client, windows)?;
    client.shut_down()?;
    child.wait()?;
    Ok(times)
}

/// Measures the duration of each round trip and of its computation, µs.
fn measure(client: &mut Client, windows: u64) -> Result<Vec<[f64; 2]>, Box<dyn Error>> {
    let (step_ns, bodies) = {
        let description = client.describe()?;
        (description.step_ns, description.bodies)
    };
    let mut times = Vec::new();
    for _ in 0..windows {
        let t0 = client.position().now_ns;
        let t1 = t0 + step_ns;
        let motions = bodies.iter().map(|body| still(body, [t0, t1])).collect();
        let begin = Instant::now();
        client.advance_to(t1, motions, vec![])?;
        let all = begin.elapsed().as_secs_f64() * 1e6;
        let cost = client.status()?.last_window.ok_or("the status has no timing")?;
        times.push([all, cost.wall_time_ms * 1e3]);
    }
    Ok(times)
}

fn serve() -> Result<(), Box<dyn Error>> {
    let endpoint = free_endpoint()?;
    let server = Server::open(KEY, &SessionConfig::listen_on(&endpoint))?;
    println!("{endpoint}");
    server.run(Lockstep::new(component()?, "run-1", hash), &mut ())?;
    Ok(())
}

/// Nine stones in a box, a step of 1 ms.
fn component() -> Result<Component, Box<dyn Error>> {
    let mut scene = common::heap::falling(1, MS).scheduled(Schedule::Sequential, [1, 1, 1]);
    scene.model.solver.max_iterations = 10;
    Ok(Component::new(Arc::new(scene.model), scene.state, Limits::default())?)
}

fn hash(_: &Model, state: &State) -> u128 {
    let numbers = state.position.iter().chain(&state.velocity).flat_map(|v| v.iter());
    let bytes: Vec<u8> = numbers.flat_map(|x| x.to_le_bytes()).collect();
    u128::from_be_bytes(Digest::of(&bytes).0)
}

/// A body that stays where it is: an input all the same.
fn still(body: &BodyDescription, times_ns: [u64; 2]) -> BodyMotion {
    let pose = Pose { position: body.position, orientation: body.orientation };
    let knot = |ns: u64| MotionKnot { time_ns: ns as i64, pose, twist: Twist::default() };
    BodyMotion {
        body: body.name.clone(),
        interpolation: InterpolationMode::Hermite,
        allow_jump: false,
        knots: times_ns.map(knot).into(),
    }
}
