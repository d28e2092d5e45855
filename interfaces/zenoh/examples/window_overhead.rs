//! What a window costs beside its computing, between two processes on the loopback: prints a CSV.
//!
//!     cargo run --release -p ballast-zenoh --example window_overhead -- [WINDOWS] > overhead.csv
//!
//! The same windows of 1 ms are computed in this process first, then by another one over Zenoh; window by
//! window the difference is what numbering, messages, sockets, hashes and status cost.

#[path = "../../../tests/common/mod.rs"]
mod common;

use ballast::component::{Component, Limits};
use ballast::model::{Model, Schedule};
use ballast::state::State;
use ballast_protocol::lockstep::Lockstep;
use ballast_protocol::messages::{
    AdvanceRequest, BodyInput, Digest, Interpolation, Knot, Point, Pose, Quaternion, Twist,
};
use ballast_zenoh::link::free_endpoint;
use ballast_zenoh::{Client, Link, Patience, Server};
use std::error::Error;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Instant;

const KEY: &str = "bench/heap";
const MS: u64 = 1_000_000;

fn main() -> Result<(), Box<dyn Error>> {
    let argument = std::env::args().nth(1);
    if argument.as_deref() == Some("serve") {
        return serve();
    }
    let windows: u64 = argument.map_or(Ok(3000), |n| n.parse())?;
    let computing = alone(windows)?;
    let round_trip = over_zenoh(windows)?;
    let overhead =
        round_trip.iter().zip(&computing).map(|(all, own)| (all - own).max(0.0)).collect();
    println!("what,windows,median_us,p99_us,max_us");
    for (what, times) in
        [("computing", computing), ("round trip", round_trip), ("overhead", overhead)]
    {
        print(what, times);
    }
    Ok(())
}

fn print(what: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    println!("{what},{},{:.0},{:.0},{:.0}", times.len(), at(0.5), at(0.99), at(1.0));
}

/// The times of the windows in this process, µs.
fn alone(windows: u64) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut component = component()?;
    (1..=windows)
        .map(|k| {
            let (t0_ns, t1_ns) = (((k - 1) * MS) as i64, (k * MS) as i64);
            let request =
                AdvanceRequest { t0_ns, t1_ns, motions: still(k), ..AdvanceRequest::default() };
            let inputs = request.inputs()?;
            let begin = Instant::now();
            component.advance_to(k * MS, &inputs.motions[..])?;
            Ok(begin.elapsed().as_secs_f64() * 1e6)
        })
        .collect()
}

/// The times of the windows in another process, µs.
fn over_zenoh(windows: u64) -> Result<Vec<f64>, Box<dyn Error>> {
    let mut child =
        Command::new(std::env::current_exe()?).arg("serve").stdout(Stdio::piped()).spawn()?;
    let mut endpoint = String::new();
    let told = child.stdout.take().ok_or("the other process tells nothing")?;
    BufReader::new(told).read_line(&mut endpoint)?;
    let link = Link::to(endpoint.trim());
    let mut client = Client::attach(KEY, &link, "bench", None, Patience::default())?;
    let mut times = Vec::new();
    for k in 1..=windows {
        let motions = still(k);
        let begin = Instant::now();
        client.advance_to(k * MS, motions, vec![])?;
        times.push(begin.elapsed().as_secs_f64() * 1e6);
    }
    client.shut_down()?;
    child.wait()?;
    Ok(times)
}

fn serve() -> Result<(), Box<dyn Error>> {
    let endpoint = free_endpoint()?;
    let server = Server::open(KEY, &Link::listening(&endpoint))?;
    println!("{endpoint}");
    server.run(Lockstep::new(component()?, "run-1", hash), &mut ())?;
    Ok(())
}

/// Nine stones in a box, a step of 1 ms.
fn component() -> Result<Component, Box<dyn Error>> {
    let mut scene = common::heap::falling(1, MS).scheduled(Schedule::Sequential, [1, 1, 1]);
    scene.model.solver.iterations = 10;
    Ok(Component::new(Arc::new(scene.model), scene.state, Limits::default())?)
}

fn hash(_: &Model, state: &State) -> u128 {
    let numbers = state.position.iter().chain(&state.velocity).flat_map(|v| v.iter());
    let bytes: Vec<u8> = numbers.flat_map(|x| x.to_le_bytes()).collect();
    u128::from_be_bytes(Digest::of(&bytes).0)
}

/// The floor stays where it is through window `k`: an input all the same.
fn still(k: u64) -> Vec<BodyInput> {
    let knot = |time_ns: u64| Knot {
        time_ns: time_ns as i64,
        pose: Pose {
            position: Point::default(),
            orientation: Quaternion { w: 1.0, ..Quaternion::default() },
        },
        twist: Twist::default(),
    };
    let (body, interpolation) = ("floor".into(), Interpolation::Hermite);
    let knots = vec![knot((k - 1) * MS), knot(k * MS)];
    vec![BodyInput { body, interpolation, rebase: false, knots }]
}
